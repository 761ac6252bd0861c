"""Experiment: what does the integration of one orbit cost in an ensemble of thousands?"""
