"""Experiment: do Schemes IV and V, which choose a parameter lambda in each step, keep the energy, and at which cost?"""
