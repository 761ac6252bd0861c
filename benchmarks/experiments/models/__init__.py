"""Experiment: which simplified model of a physical system suffices at which accuracy?"""
