"""Lattices and gravitating bodies of any size: Hamiltonian as a formula and as loops, initial values, steps in C.

Up to `codegen.TUPLE_LIMIT` degrees of freedom a system is derived from its formula; above, it runs on the hand-written
loops of its problem's module, without a formula.  The loops in C are in lattices.c, compiled by `gcc -O3
-march=native`.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import sympy as sp

from phasebench.benchmarks.measure.c_loop import load_source
from phasebench.benchmarks.problems import fpu, klein_gordon, n_body, nls, toda
from phasebench.integrators.compile.codegen import value_kind
from phasebench.integrators.systems.hamiltonian import Hamiltonian
from phasebench.integrators.systems.hand import HandHamiltonian

#: Distance of a wave's grid points, frequency of the stiff springs, seed of the initial values.
SPACING, OMEGA, SEED = 0.5, 50.0, 7
#: Stormer-Verlet, with one gradient a step, and the classical RK4, with four vector fields.
VERLET, RK4 = "stormer-verlet", "rk4"


@dataclass(frozen=True)
class Large:
    """A Hamiltonian system that can have any number d of degrees of freedom.

    Attributes
    ----------
    name, module : name of the problem, and the module that defines it
    unit : number of which d is a multiple
    method, h : `VERLET` or `RK4`; step size
    formula : function d -> (q, p, H): lists of symbols, and an expression in them
    constants : function d -> the numbers that the hand-written loops, and those in C, take as constants
    pairs : whether all pairs interact, so that a step costs O(d^2)
    """

    name: str
    module: ModuleType
    unit: int
    method: str
    h: float
    formula: Callable
    constants: Callable
    pairs: bool = False

    def size(self, d: int) -> int:
        """The number of degrees of freedom nearest to d that the system can have."""
        return self.unit * max(1 if self.unit > 1 and not self.pairs else 2, round(d / self.unit))

    def start(self, d: int) -> tuple[np.ndarray, np.ndarray]:
        """Initial values q, p, (d,), of a magnitude that does not depend on d."""
        if self.pairs:
            return tuple(map(np.array, n_body.plummer(d // self.unit)))
        return tuple(0.1 * np.random.default_rng(SEED).normal(size=(2, d)))

    def from_formula(self, d: int) -> SimpleNamespace:
        """The problem with functions derived from its formula."""
        q, p, H = self.formula(d)
        return self._problem(Hamiltonian(q=q, p=p, H=H), d)

    def by_hand(self, d: int) -> SimpleNamespace:
        """The problem with functions from hand-written loops."""
        names = ("field", "energy") if self.module is nls else ("field", "grad_V", "energy")
        loops = {name: getattr(self.module, name) for name in names}
        q, p = ([f"{x}{i}" for i in range(d)] for x in "qp")
        return self._problem(HandHamiltonian(q=q, p=p, loops=loops, constants=self.constants(d)), d)

    def fastest_form(self, d: int) -> SimpleNamespace:
        """The problem in its faster form: derived for small d, from loops for large d."""
        return (self.from_formula if value_kind(d) == "tuple" else self.by_hand)(d)

    def _problem(self, system: Hamiltonian, d: int) -> SimpleNamespace:
        q, p = self.start(d)
        return SimpleNamespace(id=self.name, system=system, q0=tuple(q), p0=tuple(p))

    def prepare_c(self, d: int) -> Callable[[float, int], tuple[np.ndarray, np.ndarray]]:
        """A function (h, n) -> the state (q, p) after n steps in C; raises RuntimeError without a compiler."""
        chosen = "".join(f"#define {name.upper().replace('-', '_')}\n" for name in (self.name, self.method))
        loop = load_source(chosen + Path(__file__).with_name("lattices.c").read_text(encoding="utf-8")).steps
        loop.argtypes = [ctypes.c_long, ctypes.c_long, ctypes.c_double, *[ctypes.c_void_p] * 4]
        start, constants = self.start(d), np.array([*map(float, self.constants(d)), 0.0])

        def run(h: float, n: int) -> tuple[np.ndarray, np.ndarray]:
            (q, p), work = map(np.copy, start), np.zeros(6 * d)
            loop(d, n, h, *(x.ctypes.data for x in (constants, q, p, work)))
            return q, p

        return run


def _bodies(d: int) -> tuple[list[sp.Symbol], list[sp.Symbol], sp.Expr]:
    """N = d / 3 gravitating bodies of mass 1 / N, with H and p divided by the mass."""
    N = d // 3
    q, p, _, distances, _ = n_body.bodies(N, "xyz")
    return q, p, sp.Add(*(x**2 / 2 for x in p), *(-sp.Rational(1, N) / r for r in distances))


def _wave(name: str, module: ModuleType, unit: int, method: str) -> Large:
    """A wave on a grid, with ``unit`` degrees of freedom a point."""

    def on_grid(what: str) -> Callable:
        return lambda d: getattr(module, what)(d // unit, SPACING * (d // unit))

    return Large(name, module, unit, method, 0.02, on_grid("formula"), on_grid("constants"))


_ALL = (
    Large("fpu", fpu, 2, VERLET, 0.002, lambda d: fpu.formula(OMEGA, d // 2), lambda d: (Fraction(OMEGA) ** 2,)),
    Large("toda", toda, 1, VERLET, 0.02, toda.formula, lambda d: ()),
    _wave("klein-gordon", klein_gordon, 2, VERLET),
    _wave("nls", nls, 1, RK4),
    Large("n-body", n_body, 3, VERLET, 1e-3, _bodies, lambda d: (Fraction(3, d),), pairs=True),
)
SYSTEMS = {system.name: system for system in _ALL}
