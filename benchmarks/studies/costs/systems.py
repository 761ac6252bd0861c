"""Lattices and gravitating bodies of any size: Hamiltonian as a formula and as loops, initial values, steps in C.

Up to `codegen.TUPLE_LIMIT` degrees of freedom a system is derived from its formula; above, it runs on the hand-written
loops of its problem's module, without a formula.  The loops in C have neither compensated sums nor checks, and are
compiled by `gcc -O3 -march=native`.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
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
#: In C: the gradient g of V at q or, for RK4, the field g at q, p, from constants c.
SLOPE = """#include <math.h>
static void slope(long d, const double *c, const double *restrict q, const double *restrict p, double *restrict g) {
"""
FPU = """
  long m = d / 2;
  double s = q[0] - q[m], left = s * s * s;
  for (long i = 0; i < m; i++) {
    s = i + 1 < m ? q[i + 1] - q[m + i + 1] - q[i] - q[m + i] : -q[i] - q[m + i];
    double right = s * s * s;
    g[i] = left - right;
    g[m + i] = c[0] * q[m + i] - left - right;
    left = right;
  }
}
"""
TODA = """
  double left = exp(q[d - 1] - q[0]);
  for (long i = 0; i < d; i++) {
    double right = exp(q[i] - q[i + 1 < d ? i + 1 : 0]);
    g[i] = right - left;
    left = right;
  }
}
"""
KLEIN_GORDON = """
  long n = d / 2;
  double a = c[0], b = c[1];
  for (long j = 0; j < n; j++) {
    long left = (j ? j : n) - 1, right = j + 1 < n ? j + 1 : 0;
    double m = 1 + 2 * a + b * (q[j] * q[j] + q[n + j] * q[n + j]);
    g[j] = m * q[j] - a * (q[left] + q[right]);
    g[n + j] = m * q[n + j] - a * (q[n + left] + q[n + right]);
  }
}
"""
N_BODY = """
  for (long i = 0; i < d; i++) g[i] = 0;
  for (long i = 0; i < d; i += 3)
    for (long j = i + 3; j < d; j += 3) {
      double x = q[j] - q[i], y = q[j + 1] - q[i + 1], z = q[j + 2] - q[i + 2];
      double s = x * x + y * y + z * z, a = c[0] / (s * sqrt(s));
      g[i] -= a * x; g[i + 1] -= a * y; g[i + 2] -= a * z;
      g[j] += a * x; g[j + 1] += a * y; g[j + 2] += a * z;
    }
}
"""
NLS = """
  double a = c[0], b = c[1];
  for (long j = 0; j < d; j++) {
    long left = (j ? j : d) - 1, right = j + 1 < d ? j + 1 : 0;
    double s = b * (q[j] * q[j] + p[j] * p[j]);
    g[j] = a * (2 * p[j] - p[left] - p[right]) - s * p[j];
    g[d + j] = s * q[j] - a * (2 * q[j] - q[left] - q[right]);
  }
}
"""
VERLET, RK4 = "stormer-verlet", "rk4"
#: Stormer-Verlet with one gradient a step, and the classical RK4; ``work`` has 6 d numbers.
STEPS = {
    VERLET: """
void steps(long d, long n, double h, const double *c, double *q, double *p, double *g) {
  slope(d, c, q, p, g);
  while (n--) {
    for (long i = 0; i < d; i++) { p[i] -= 0.5 * h * g[i]; q[i] += h * p[i]; }
    slope(d, c, q, p, g);
    for (long i = 0; i < d; i++) p[i] -= 0.5 * h * g[i];
  }
}
""",
    RK4: """
void steps(long d, long n, double h, const double *c, double *q, double *p, double *work) {
  double *k = work, *x = work + 2 * d, *sum = work + 4 * d;
  static const double at[4] = {0, 0.5, 0.5, 1}, weight[4] = {1 / 6.0, 1 / 3.0, 1 / 3.0, 1 / 6.0};
  while (n--) {
    for (long i = 0; i < 2 * d; i++) sum[i] = 0;
    for (int s = 0; s < 4; s++) {
      for (long i = 0; i < d; i++) {
        x[i] = s ? q[i] + at[s] * h * k[i] : q[i];
        x[d + i] = s ? p[i] + at[s] * h * k[d + i] : p[i];
      }
      slope(d, c, x, x + d, k);
      for (long i = 0; i < 2 * d; i++) sum[i] += weight[s] * k[i];
    }
    for (long i = 0; i < d; i++) { q[i] += h * sum[i]; p[i] += h * sum[d + i]; }
  }
}
""",
}


@dataclass(frozen=True)
class Large:
    """A Hamiltonian system that can have any number d of degrees of freedom.

    Attributes
    ----------
    name, module : name of the problem, and the module that defines it
    unit : number of which d is a multiple
    method, h : Stormer-Verlet, with one gradient a step, or RK4, with four vector fields; step size
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
        loop = load_source(f"{SLOPE}{self.C}{STEPS[self.method]}").steps
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


def _wave(module: ModuleType, unit: int, method: str, C: str) -> Large:
    """A wave on a grid, with ``unit`` degrees of freedom a point."""

    def on_grid(what: str) -> Callable:
        return lambda d: getattr(module, what)(d // unit, SPACING * (d // unit))

    name = module.__name__.rpartition(".")[2].replace("_", "-")
    return Large(name, module, unit, method, 0.02, on_grid("formula"), on_grid("constants"), C)


SYSTEMS = {
    s.name: s
    for s in (
        Large(
            "fpu", fpu, 2, VERLET, 0.002, lambda d: fpu.formula(OMEGA, d // 2), lambda d: (Fraction(OMEGA) ** 2,), FPU
        ),
        Large("toda", toda, 1, VERLET, 0.02, toda.formula, lambda d: (), TODA),
        _wave(klein_gordon, 2, VERLET, KLEIN_GORDON),
        _wave(nls, 1, RK4, NLS),
        Large("n-body", n_body, 3, VERLET, 1e-3, _bodies, lambda d: (Fraction(3, d),), N_BODY, pairs=True),
    )
}
