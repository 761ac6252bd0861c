"""Experiment: do measurements of every method on every problem agree with its declared properties?"""
