"""The truth: exact solutions, certified extended-precision references, peers from elsewhere, stored error tables.

Every module takes a problem as an argument and knows none by import.  Importing this package costs nothing; heyoka,
REBOUND, SciPy, mpmath and pandas load in the functions that need them.
"""
