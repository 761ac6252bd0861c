"""Experiment: are the established integrators of other packages what their packages claim?"""
