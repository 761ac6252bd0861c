"""Experiment: the figures and statements of two talks on symplectic integration, measured again."""
