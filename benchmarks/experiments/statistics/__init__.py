"""Experiment: statistics of chaotic orbits (averages), and the largest steps at which integrators give them right."""
