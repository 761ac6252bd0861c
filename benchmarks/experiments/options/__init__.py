"""Experiment: what do the options of the methods (such as lambda, order, nodes, solver) gain, and what do they cost?"""
