"""Experiment: the time until the first result of an integration, with compilation (cold) and without (warm)."""
