"""Certified end states: `make` computes them, `stored` stores and finds them, `check` verifies them independently."""
