"""Rows that other languages' integrators made on their own machine, beside this suite's methods."""
