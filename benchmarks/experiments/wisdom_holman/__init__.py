"""Experiment: Wisdom-Holman splittings beside REBOUND's, in accuracy and in speed."""
