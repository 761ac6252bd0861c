"""Experiment on rigid bodies: what their methods keep, what an attitude costs, what a nearly symmetric body gains."""
