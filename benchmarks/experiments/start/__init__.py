"""Experiment: how long does it take to the first result?"""
