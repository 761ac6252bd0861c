"""Advice: which integrator to use for a problem, a span and an accuracy, confirmed by a run against a reference."""
