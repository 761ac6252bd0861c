"""The packages whose import a quick command must avoid."""

HEAVY = ("sympy", "numba", "heyoka", "rebound", "scipy", "pandas", "matplotlib")
