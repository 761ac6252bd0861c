"""Experiment: results of integrators in other languages, from other machines, beside this suite's methods."""
