"""Measures: pure functions of trajectories and of integrators."""
