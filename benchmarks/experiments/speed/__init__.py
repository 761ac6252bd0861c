"""Experiment: how long does a step take?"""
