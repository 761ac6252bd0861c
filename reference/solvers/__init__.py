"""Solvers of the truth: Taylor series in extended precision, Gauss's method in long double, exact solutions."""
