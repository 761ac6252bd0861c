"""States on the manifold of a constrained system, to all digits of the working precision."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import mpmath
import sympy as sp

if TYPE_CHECKING:
    from phasebench.integrators.systems.constrained import ConstrainedHamiltonian

#: Newton steps: from round-off of doubles two give 60 digits.
STEPS = 10


def nearest_state(system: ConstrainedHamiltonian, state: Sequence[Any]) -> list[mpmath.mpf]:
    """Find the state near ``state`` at which all constraints, and the hidden ones, vanish; mpmath's precision.

    It is that of Newton's method with the least changes (Gauss-Newton).

    Parameters
    ----------
    state : q and p in one sequence of 2 d numbers
    """
    bound = [*system.constraints, *system.hidden]
    names = [*system.q, *system.p]
    f = sp.lambdify([names], bound, "mpmath")
    J = sp.lambdify([names], [[e.diff(x) for x in names] for e in bound], "mpmath")
    y = mpmath.matrix([mpmath.mpf(x) for x in state])
    for _ in range(STEPS):
        A = mpmath.matrix(J(list(y)))
        y = y - A.T * mpmath.lu_solve(A * A.T, mpmath.matrix(f(list(y))))
    return list(y)
