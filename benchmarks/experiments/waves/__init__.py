"""Experiment: which invariants and local conservation laws of discretized wave equations integrators preserve."""
