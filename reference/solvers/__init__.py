"""Solvers for references: Taylor series in extended precision, Gauss's method in long double, exact solutions."""
