"""Experiment: where do integrators for highly oscillatory systems resonate?"""
