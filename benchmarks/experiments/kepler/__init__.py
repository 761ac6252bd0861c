"""Kepler orbits beside the established integrators."""
