"""Experiment: which methods are symplectic and symmetric?"""
