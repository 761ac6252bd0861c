"""Options with which Numba compiles functions."""

from __future__ import annotations

#: For every function: "contract" lets the compiler fuse a product and a sum, as C compilers do by default.  It reorders
#: nothing, so that compensated sums stay exact.
COMMON = {"error_model": "numpy", "fastmath": {"contract"}}
#: For overloads, which compiled code alone calls: no entries for Python and for C.
UNCALLED = {"no_cfunc_wrapper": True, "no_cpython_wrapper": True}
#: For functions whose values are tuples: the compiler refuses code that would allocate, and arrays are not
#: reference-counted, which would cost more than a gradient.
TUPLES = COMMON | {"_nrt": False}
#: For functions whose values are arrays (large d), whose operations return new arrays.  `_nrt` is stated because an
#: option that is not set is inherited from the caller.
ARRAYS = COMMON | {"_nrt": True}
