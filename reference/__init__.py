"""What methods are compared with: exact solutions, certified states, other packages (peers), stored error tables.

A certified state is one in extended precision with a bound of its error.  Modules take a problem as an argument; they
import no module that defines problems.  Importing this package is cheap: heyoka, REBOUND, SciPy, mpmath and pandas are
imported by the functions that need them.
"""
