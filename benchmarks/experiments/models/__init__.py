"""Experiment: which model of a scene suffices, at which accuracy?"""
