"""Loose types for the annotations of compiled code: `Number`, `Value`, `Condition`, `Function` and others.

Numba finds the actual types when it compiles, and one source serves several kinds of numbers; so these names inform the
reader, and a type checker learns little from them.  Modules import them under ``if TYPE_CHECKING:``.

Functions that Numba chooses by the types of their arguments (`vector.dispatch_on_none`, `vector.in_place` and the like)
have no annotations: Numba compares their signatures, annotations included, with those of generated functions.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

#: One number: a double, SIMD lanes (a double for each of several orbits or stages), or an MPFR number.
Number: TypeAlias = Any
#: d numbers, such as q, p, a gradient or an increment: a tuple for small d, an array (d,) for large d.
Value: TypeAlias = Any
#: A condition: True or False, or one of them for each lane.
Condition: TypeAlias = Any
#: A compiled function, such as a gradient or the equation of a stage.
Function: TypeAlias = Callable[..., Any]
#: A Numba signature: the types of the arguments and of the result.
Signature: TypeAlias = Any
#: What `numba.njit` returns: a function that Python calls, with its machine code.
Dispatcher: TypeAlias = Any
