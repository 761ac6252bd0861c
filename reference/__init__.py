"""References: exact solutions, certified extended-precision states, other packages (peers), stored error tables.

Modules take a problem as an argument and import none.  Importing this package is cheap: heyoka, REBOUND, SciPy, mpmath
and pandas are imported by the functions that need them.
"""
