"""Measurements: mostly pure functions of trajectories and integrators."""
