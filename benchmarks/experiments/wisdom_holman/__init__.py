"""Experiment: this project's Wisdom-Holman splittings compared with REBOUND's, in accuracy and in speed."""
