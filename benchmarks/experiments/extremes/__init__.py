"""Experiment: how far can a method be pushed; where is it stable, where does it fail, and how?"""
