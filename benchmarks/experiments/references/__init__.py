"""Experiment: are the stated uncertainties of the certified reference states true, and their horizons?

A horizon is the time up to which a run rounded to long double stays close to the exact orbit.
"""
