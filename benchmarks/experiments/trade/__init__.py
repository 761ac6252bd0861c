"""Experiment: the fastest integrator at each accuracy, that is the trade between error and time."""
