"""Experiment: this project's methods on Kepler orbits, compared with the established integrators."""
