"""Experiment: the figures and statements of two talks on symplectic integration, reproduced by measurements."""
