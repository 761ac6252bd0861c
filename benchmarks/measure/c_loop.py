r"""A bare C loop of Stormer-Verlet for a problem's formula of H, the yardstick for the speed of compiled steps.

.. math::
    p \leftarrow p - \tfrac h2 g,\quad q \leftarrow q + h\,\nabla T(p),\quad g \leftarrow \nabla V(q),\quad
    p \leftarrow p - \tfrac h2 g

One gradient a step, no compensated summation, no function pointer, no output; `gcc -O3 -march=native`.  The gradients
are the same statements as in the compiled kernels.  With merged kicks the last kick of a step and the first of the next
are one, as in the compiled kernels.
"""

from __future__ import annotations

import ctypes
import time
from typing import TYPE_CHECKING

import numpy as np
import sympy as sp

from phasebench.reference.native import compiler, load_source, statements

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem
    from phasebench.integrators.systems.hamiltonian import Hamiltonian

__all__ = ["Loop", "compiler", "load_source", "source"]


def source(system: Hamiltonian, merged: bool = False) -> str:
    """Return the C source of ``leapfrog(steps, h, state)``, Stormer-Verlet steps on state = (q, p).

    H is separable with a quadratic T; ``merged`` joins the last half kick of a step with the first of the next.
    """
    of_V, forces = statements([sp.diff(system.potential, x) for x in system.q], ("q", system.q))
    of_T, velocities = statements([sp.diff(system.kinetic, x) for x in system.p], ("p", system.p))
    d = range(system.d)
    gradient = " ".join([of_V, *(f"g_{i} = {part};" for i, part in enumerate(forces))])
    drift = " ".join([of_T, *(f"q_{i} += h * ({v});" for i, v in enumerate(velocities))])
    declared = ", ".join(f"q_{i} = y[{i}], p_{i} = y[{i + system.d}], g_{i}" for i in d)
    half, whole, undone = (
        " ".join(f"p_{i} {sign} {part}h * g_{i};" for i in d)
        for sign, part in (("-=", "0.5 * "), ("-=", ""), ("+=", "0.5 * "))
    )
    first, last = ("", whole) if merged else (half, half)
    back = " ".join(f"y[{i}] = q_{i}; y[{i + system.d}] = p_{i};" for i in d)
    return f"""#include <math.h>
void leapfrog(long steps, double h, double *y) {{
  double {declared};
  {{ {gradient} }}
  {half if merged else ""}
  for (long n = 0; n < steps; n++) {{
    {first}
    {{ {drift} }}
    {{ {gradient} }}
    {last}
  }}
  {undone if merged else ""}
  {back}
}}
"""


class Loop:
    """A problem's compiled Stormer-Verlet loop in C; RuntimeError if it does not compile or T is not quadratic."""

    def __init__(self, problem: Problem, merged: bool = False) -> None:
        if not getattr(problem.system, "quadratic_kinetic", False):
            raise RuntimeError("the C loop is written for a separable H with a quadratic T")
        self.problem = problem
        self._leapfrog = load_source(source(problem.system, merged)).leapfrog
        self._leapfrog.argtypes = [ctypes.c_long, ctypes.c_double, ctypes.c_void_p]
        self._leapfrog.restype = None

    def run(self, h: float, steps: int) -> tuple[float, np.ndarray]:
        """Run the loop from the initial state; return (seconds taken, final state (q, p) as an array (2 d,))."""
        y = np.array([*self.problem.q0, *self.problem.p0])
        started = time.perf_counter()
        self._leapfrog(steps, h, y.ctypes.data)
        return time.perf_counter() - started, y
