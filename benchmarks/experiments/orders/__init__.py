"""Experiment: does every method have its declared order?"""
