"""Experiment: do methods for systems with constraints stay on the manifold, and keep the energy?"""
