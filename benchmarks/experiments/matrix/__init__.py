"""Experiment: do measurements of every method on every problem agree with the method's declared properties?"""
