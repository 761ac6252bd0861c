"""Splittings through many parts around black holes: energy, orders, and what their authors claim."""
