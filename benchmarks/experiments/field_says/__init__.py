"""Experiment: do the guides of software packages say what is true of integrators, on the problems that they name?"""
