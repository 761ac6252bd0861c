"""Certified states of orbits: digits in quadruple precision with a bound of their error.

`make` computes them, `stored` stores and finds them, `check` verifies them independently.
"""
