"""Experiment: does what packages' guides say of integrators hold on the problems that they name?"""
