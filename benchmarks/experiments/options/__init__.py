"""Experiment: what do the options of methods gain, and what do they cost?"""
