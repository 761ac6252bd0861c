"""Experiment: which methods have symplectic, symmetric and volume-preserving step maps."""
