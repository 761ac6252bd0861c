"""Experiment: which integrator is the fastest at each accuracy?"""
