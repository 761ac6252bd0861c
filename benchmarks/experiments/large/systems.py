"""Lattices and gravitating bodies of any size: Hamiltonian as a formula and as loops, initial values, gradient in C.

Up to `codegen.TUPLE_LIMIT` degrees of freedom a system is derived from its formula; above, it runs on the hand-written
loops of its problem's module, without a formula.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from types import ModuleType, SimpleNamespace

import numpy as np
import sympy as sp

from phasebench.benchmarks.problems import fpu, klein_gordon, n_body, nls, toda
from phasebench.integrators.compile.codegen import value_kind
from phasebench.integrators.systems.hamiltonian import Hamiltonian
from phasebench.integrators.systems.hand import HandHamiltonian

from . import c

#: Distance of a wave's grid points, frequency of the stiff springs, seed of the initial values.
SPACING, OMEGA, SEED = 0.5, 50.0, 7


@dataclass(frozen=True)
class Large:
    """A Hamiltonian system that can have any number d of degrees of freedom.

    Attributes
    ----------
    name, module : name of the problem, and the module that defines it
    unit : number of which d is a multiple
    method : id of the method: Stormer-Verlet, with one gradient a step, or RK4, with four vector fields
    h : step size
    formula : function d -> (q, p, H): lists of symbols, and an expression in them
    constants : function d -> the numbers that the hand-written loops, and those in C, take as constants
    C : C source of the gradient, or of the vector field
    pairs : whether all pairs interact, so that a step costs O(d^2)
    """

    name: str
    module: ModuleType
    unit: int
    method: str
    h: float
    formula: Callable
    constants: Callable
    C: str
    pairs: bool = False

    def size(self, d: int) -> int:
        """Return the number of degrees of freedom nearest to d that the system can have."""
        return self.unit * max(1 if self.unit > 1 and not self.pairs else 2, round(d / self.unit))

    def start(self, d: int) -> tuple[np.ndarray, np.ndarray]:
        """Return initial values q, p, (d,), from a fixed seed, of a magnitude that does not depend on d."""
        if self.pairs:
            return tuple(map(np.array, n_body.plummer(d // self.unit)))
        return tuple(0.1 * np.random.default_rng(SEED).normal(size=(2, d)))

    def from_formula(self, d: int) -> SimpleNamespace:
        """Build the problem of d degrees of freedom with functions derived from its formula."""
        q, p, H = self.formula(d)
        return self._problem(Hamiltonian(q=q, p=p, H=H), d)

    def by_hand(self, d: int) -> SimpleNamespace:
        """Build the problem of d degrees of freedom with functions from hand-written loops."""
        names = ("field", "energy") if self.module is nls else ("field", "grad_V", "energy")
        loops = {name: getattr(self.module, name) for name in names}
        q, p = ([f"{x}{i}" for i in range(d)] for x in "qp")
        return self._problem(HandHamiltonian(q=q, p=p, loops=loops, constants=self.constants(d)), d)

    def fastest_form(self, d: int) -> SimpleNamespace:
        """Build the problem of d degrees of freedom in its faster form: derived for small d, from loops for large d."""
        return (self.from_formula if value_kind(d) == "tuple" else self.by_hand)(d)

    def _problem(self, system: Hamiltonian, d: int) -> SimpleNamespace:
        q, p = self.start(d)
        return SimpleNamespace(id=self.name, system=system, q0=tuple(q), p0=tuple(p))


def _bodies(d: int) -> tuple[list[sp.Symbol], list[sp.Symbol], sp.Expr]:
    """Return the formula (q, p, H) of N = d / 3 gravitating bodies of mass 1 / N, with H and p divided by the mass."""
    N = d // 3
    q, p, _, distances, _ = n_body.bodies(N, "xyz")
    return q, p, sp.Add(*(x**2 / 2 for x in p), *(-sp.Rational(1, N) / r for r in distances))


def _waves(module: ModuleType, unit: int) -> tuple[Callable, Callable]:
    """Return (formula, constants) of a wave equation on a grid, the two functions of d that `Large` takes.

    ``module`` defines the equation; it has ``unit`` degrees of freedom a grid point.
    """

    def formula(d: int) -> tuple[list[sp.Symbol], list[sp.Symbol], sp.Expr]:
        return module.formula(d // unit, SPACING * (d // unit))

    def constants(d: int) -> tuple[Fraction, Fraction]:
        return module.constants(d // unit, SPACING * (d // unit))

    return formula, constants


VERLET = "stormer-verlet"
SYSTEMS = {
    s.name: s
    for s in (
        Large(
            "fpu", fpu, 2, VERLET, 0.002, lambda d: fpu.formula(OMEGA, d // 2), lambda d: (Fraction(OMEGA) ** 2,), c.FPU
        ),
        Large("toda", toda, 1, VERLET, 0.02, toda.formula, lambda d: (), c.TODA),
        Large("klein-gordon", klein_gordon, 2, VERLET, 0.02, *_waves(klein_gordon, 2), c.KLEIN_GORDON),
        Large("nls", nls, 1, "rk4", 0.02, *_waves(nls, 1), c.NLS),
        Large("n-body", n_body, 3, VERLET, 1e-3, _bodies, lambda d: (Fraction(3, d),), c.N_BODY, pairs=True),
    )
}
