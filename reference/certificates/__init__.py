"""Certified end states: `make` computes them, `stored` keeps and finds them, `check` measures whether they hold."""
