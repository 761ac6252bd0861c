"""Experiment: the figures and statements of the two talks."""
