"""Kepler orbits: this project's methods compared with the established integrators."""
