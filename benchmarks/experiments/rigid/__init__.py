"""Experiment: what methods for rigid bodies preserve, how accurate the attitude is, and gains near a symmetric body."""
