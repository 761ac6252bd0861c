"""Experiment: the time of one integration step of each method, and its ratio to a C loop and to other methods."""
