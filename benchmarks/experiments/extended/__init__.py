"""Experiment: are the explicit methods in extended phase space what their papers claim?"""
