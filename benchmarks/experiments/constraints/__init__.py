"""Experiment: do methods for constraints stay on the manifold, and keep the energy?"""
