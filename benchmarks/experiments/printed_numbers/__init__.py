"""Experiment: do measurements here reproduce numbers that papers print on integrators?"""
