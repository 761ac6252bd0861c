r"""Hamiltonians whose functions are loops written by hand: lattices and semi-discretized wave equations.

The formula of H stays (peers and rare kernels derive from it what they need); the functions that every step calls are
not derived from it: at hundreds of variables their text would be long and slow to compile.  Tests compare them with
the derived ones at a small size.
"""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable, Mapping
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
from numba import types

from phasebench.integrators.engine import codegen, machine
from phasebench.integrators.engine.codegen import DOUBLE
from phasebench.integrators.engine.lazy import sympy as sp
from phasebench.integrators.errors import InvalidInput

from .hamiltonian import Hamiltonian, _symbols


@lru_cache(maxsize=256)
def _compiled(loop: Callable, constants: tuple[float, ...], signature, d: int):
    """The loop compiled for these constants, once in a process."""
    source = Path(inspect.getfile(loop)).read_bytes()  # of helpers too
    content = f"{loop.__qualname__}|{constants}|{hashlib.sha256(source).hexdigest()}"
    return machine.compiled(loop(*constants), signature, codegen.options(d), f"loop|{content}")


class HandHamiltonian(Hamiltonian):
    """The canonical system of H(q, p) with loops for its functions.

    Parameters
    ----------
    q, p : sequences of symbols or names, of equal length d, more than `codegen.TUPLE_LIMIT`
    H : expression; it is trusted to be what the loops compute
    loops : name -> a function of the constants that returns the loop: "field" for (q, p, h, lam) -> (H_p, -H_q) and
        "energy" for (q, p) -> (H, M) as `energy`; for H = |p|^2 / 2 + V(q) also "grad_V" for q -> grad V(q).  Loops
        take and return arrays (d,), and must run uncompiled on object arrays.
    constants : exact numbers (integers, fractions), handed to the loops in the arithmetic at hand
    degree : of a polynomial H
    invariants : expressions, or functions of the rows Q, P
    singular : distances that vanish where H is singular, as expressions or functions of the rows Q, P

    Raises
    ------
    InvalidInput
        If d is so small that compiled states are tuples.
    """

    separable = False

    def __init__(
        self,
        *,
        q,
        p,
        H,
        loops: Mapping[str, Callable],
        constants=(),
        degree: int | None = None,
        invariants=(),
        singular=(),
    ):
        self.q, self.p = _symbols(q), _symbols(p)
        self.d = len(self.q)
        if codegen.value_kind(self.d) == "tuple":
            raise InvalidInput(f"loops need more than {codegen.TUPLE_LIMIT} degrees of freedom; d is {self.d}")
        self.H, self.loops, self.constants = H, loops, tuple(constants)
        self.singular, self.invariants, self.frequencies, self.kepler = tuple(singular), tuple(invariants), (), None
        self.polynomial_degree = degree
        self.separable = self.quadratic_kinetic = self.unit_mass = "grad_V" in loops
        self._functions: dict = {}

    @cached_property
    def dq(self) -> tuple[sp.Expr, ...]:
        """H_p, derived when asked for."""
        return tuple(sp.diff(self.H, x) for x in self.p)

    @cached_property
    def dp(self) -> tuple[sp.Expr, ...]:
        """-H_q, derived when asked for."""
        return tuple(-sp.diff(self.H, x) for x in self.q)

    def _loop(self, name: str, signature, arithmetic: str):
        constants = tuple(codegen.exactly(c, arithmetic) for c in self.constants)
        if arithmetic == DOUBLE and codegen.compiled():
            return _compiled(self.loops[name], constants, signature, self.d)
        if ("loop", name, arithmetic) not in self._functions:
            self._functions["loop", name, arithmetic] = self.loops[name](*constants)
        return self._functions["loop", name, arithmetic]

    def field(self, arithmetic: str = DOUBLE, order: int = 1):
        """The loop; of ``order`` > 1, derived from the formula."""
        if order > 1:
            return super().field(arithmetic, order)
        T, number = codegen.value_type(self.d), types.float64
        return self._loop("field", types.Tuple((T, T))(T, T, number, number), arithmetic)

    def grad_V(self, arithmetic: str = DOUBLE):
        """The loop."""
        T = codegen.value_type(self.d)
        return self._loop("grad_V", T(T), arithmetic)

    def energy(self, arithmetic: str = DOUBLE):
        """The loop."""
        T = codegen.value_type(self.d)
        return self._loop("energy", types.UniTuple(types.float64, 2)(T, T), arithmetic)

    def speed(self, Q, P):
        """By the loop of the field."""
        field = self.field()
        rows = zip(np.ascontiguousarray(Q, float), np.ascontiguousarray(P, float), strict=True)
        return np.array([np.linalg.norm(field(q, p, 0.0, 0.0)[0]) for q, p in rows])

    def scale(self, Q, P):
        """A third of what the loop says the round-off of H is in units of: of quadratic terms their size."""
        Q, P = np.ascontiguousarray(Q, float), np.ascontiguousarray(P, float)
        energy = self.energy()
        with np.errstate(all="ignore"):
            return np.array([energy(q, p)[1] for q, p in zip(Q, P, strict=True)], float) / 3

    def energies(self, Q, P):
        """By the loop."""
        Q, P = np.ascontiguousarray(Q, float), np.ascontiguousarray(P, float)
        energy = self.energy()
        with np.errstate(all="ignore"):
            return np.array([energy(q, p)[0] for q, p in zip(Q, P, strict=True)], float)

    def observe(self, expression, Q, P):
        """As of every system; H by its loop, and ``expression`` may be a function of the rows."""
        Q, P = np.ascontiguousarray(Q, float), np.ascontiguousarray(P, float)
        if expression is self.H:
            return self.energies(Q, P)
        if callable(expression) and not isinstance(expression, sp.Basic):
            with np.errstate(all="ignore"):
                return np.asarray(expression(Q, P), float)
        return super().observe(expression, Q, P)
