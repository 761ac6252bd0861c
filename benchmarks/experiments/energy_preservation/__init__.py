"""Experiment: do Schemes IV and V keep the energy, and at which cost?

They are one-step schemes with a parameter lambda, which they choose in each step so that the energy is conserved.
"""
