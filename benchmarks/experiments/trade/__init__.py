"""Experiment: which integrator is the fastest at each accuracy (the trade between error and time)?"""
