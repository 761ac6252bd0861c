"""Certified end states: `make` computes them, `stored` keeps and finds them, `check` says whether they still hold."""
