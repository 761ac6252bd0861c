"""Experiment: are explicit methods for two copies of the state (extended phase space) what their papers claim?"""
