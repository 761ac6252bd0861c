"""Advice: which integrator for a problem, a span and an accuracy; what is recommended was run against a reference."""
