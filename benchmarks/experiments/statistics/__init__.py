"""Experiment: statistics of chaotic orbits, and the largest steps at which integrators still give them."""
