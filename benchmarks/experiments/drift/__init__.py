"""Experiment: do the confidence intervals of an estimated energy drift cover the true drift?"""
