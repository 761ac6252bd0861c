"""Experiment: splittings of H into many parts around black holes: energy, orders, and their authors' claims."""
