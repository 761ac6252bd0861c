r"""Solvers of the stage equations of a Gauss method: fixed point or Newton, starting values, tolerances.

The solver inside the integrators (the engine) offers no choice: it iterates the fixed point from a start extrapolated
over five steps, changes to Newton's method if that does not contract, and always goes to round-off.  The same equations
for the slopes, :math:`K_i = f(y + h\sum_j a_{ij}K_j)`, are therefore solved here in a plain loop that counts
evaluations:

- fixed point: K is replaced by the right-hand side;
- simplified Newton: :math:`(1 - hA\otimes J)\,\Delta K = f - K` with the Jacobian J at the start of the step;
- Newton: the same with the Jacobian at each stage, in every iteration.

Jacobians are forward differences, and count one evaluation per variable.  Starts: zero; the extrapolated polynomial of
the last step; the differences of the last five steps at the same stage, as in the engine.
Source: E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration (2006), VIII.5-6.
"""

from __future__ import annotations

from collections.abc import Callable
from math import comb
from typing import NamedTuple

import numpy as np

from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import Cell, ProblemKey, Rows, content
from phasebench.integrators.coefficients.tableaus import LEVELS, runge_kutta
from phasebench.integrators.driver import NOT_CONVERGED, OK, integrate
from phasebench.integrators.registry import method

TABLE, STAGES, FINE = "knobs_solvers", 3, "gauss-8"
METHOD = f"gauss-{STAGES}"
FIXED, SIMPLE, NEWTON, ENGINE = "fixed point", "simplified Newton", "Newton", "engine"
ZERO, POLYNOMIAL, FIVE = "zero", "last polynomial", "five steps"
#: Tolerances relative to the state, at which an iteration ends; with `ROUND_OFF` it ends when changes stop falling.
ROUND_OFF = 0.0
TOLERANCES = (1e-3, 1e-6, 1e-9, 1e-12)
#: (solver, start, tolerance) of the loop: every pair to round-off, and every tolerance from the start `FIVE`.
SETTINGS = (
    *((solver, start, ROUND_OFF) for solver in (FIXED, SIMPLE, NEWTON) for start in (ZERO, POLYNOMIAL, FIVE)),
    *((solver, FIVE, tol) for solver in (FIXED, SIMPLE) for tol in TOLERANCES),
)
STEPS, MOST, EPS = 200, 60, float(np.finfo(float).eps)


class Pace(NamedTuple):
    """A problem with its orbit (``problem``), and the step sizes to integrate it with (``sizes``)."""

    problem: str
    sizes: tuple[float, ...]


SCENES = (
    Pace("pendulum:swinging", (0.1, 1.0)),
    Pace("henon-heiles:box", (0.1, 1.0)),
    Pace("perturbed-kepler", (0.02, 0.1)),
    Pace("fpu", (0.005, 0.1)),
)


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`), one for each orbit; none if ``quick``."""
    return [] if quick else [_cell(k) for k in range(len(SCENES))]


def _cell(k: int) -> Cell:
    scene = SCENES[k]
    used = (method(METHOD), method(FINE), ProblemKey(scene.problem))
    needs = content("solvers", tuple(scene), SETTINGS, STEPS, *used, code=[__name__])
    names = frozenset({METHOD, scene.problem.partition(":")[0]})
    return Cell("options", (TABLE,), {"scene": scene.problem}, measure_rows, (k,), needs, names)


class Gauss:
    """The s-stage Gauss tableau in doubles, and the weights that extrapolate the last step's polynomial.

    Attributes
    ----------
    A, b, c : coefficients (s, s), weights (s,) and nodes (s,)
    forward : matrix (s, s) from the slopes of the last step to extrapolated slopes of the next
    """

    def __init__(self, s: int) -> None:
        A, _, b, c = runge_kutta("gauss", s)
        self.A = np.array(A.tolist(), float)
        self.b, self.c = np.array(list(b), float), np.array(c, float)
        V = np.vander(self.c, s, increasing=True)
        self.forward = np.vander(1 + self.c, s, increasing=True) @ np.linalg.inv(V)


def jacobian(f: Callable, y: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Compute the Jacobian of f at y by forward differences, with ``at`` = f(y): one evaluation per variable."""
    steps = EPS**0.5 * np.maximum(np.abs(y), np.abs(y).max())
    return np.array([(f(y + step * e) - at) / step for step, e in zip(steps, np.eye(len(y)), strict=True)]).T


class Loop:
    """A run of the Gauss method, with a choice of solver, starting values and tolerance.

    ``f`` is the vector field, ``y0`` the initial state (2 d,) and ``h`` the step; ``solver`` is `FIXED`, `SIMPLE` or
    `NEWTON`, ``start`` is `ZERO`, `POLYNOMIAL` or `FIVE` (as told in the module), and ``tol`` is relative to the state.

    Attributes
    ----------
    y : the current state (2 d,)
    evaluations, iterations : numbers of evaluations of f and of iterations so far
    """

    def __init__(self, f: Callable, y0: np.ndarray, h: float, solver: str, start: str, tol: float) -> None:
        self.f, self.y, self.h = f, np.array(y0, float), h
        self.solver, self.start, self.tol = solver, start, tol
        self.gauss, self.last = Gauss(STAGES), []
        self.evaluations = self.iterations = 0

    def slopes(self, K: np.ndarray) -> np.ndarray:
        """Compute the right-hand sides f(y + h A K) of the stage equations at the slopes K, array (s, 2 d)."""
        self.evaluations += STAGES
        return np.array([self.f(y) for y in self.y + self.h * self.gauss.A @ K])

    def first(self) -> np.ndarray:
        """Return the starting values of the slopes K for the iteration of the next step, array (s, 2 d)."""
        if not self.last or self.start == ZERO:
            return np.zeros((STAGES, len(self.y)))
        if self.start == POLYNOMIAL:
            return self.gauss.forward @ self.last[0]
        m = len(self.last)
        return sum((-1) ** j * comb(m, j + 1) * K for j, K in enumerate(self.last))

    def matrix(self, K: np.ndarray) -> np.ndarray | None:
        """Compute the matrix of Newton's linear equations at the slopes K; None for the fixed-point iteration."""
        if self.solver == FIXED:
            return None
        if self.solver == SIMPLE:
            at = self.f(self.y)
            self.evaluations += 1 + len(self.y)
            return np.eye(K.size) - self.h * np.kron(self.gauss.A, jacobian(self.f, self.y, at))
        blocks = [jacobian(self.f, y, self.f(y)) for y in self.y + self.h * self.gauss.A @ K]
        self.evaluations += STAGES * len(self.y)
        rows = [np.hstack([a * J for a in row]) for row, J in zip(self.gauss.A, blocks, strict=True)]
        return np.eye(K.size) - self.h * np.vstack(rows)

    def step(self) -> bool:
        """Take a step of the Gauss method; return False if its stage equations are not solved."""
        K, last, size = self.first(), np.inf, np.abs(self.y).max()
        matrix = self.matrix(K)
        for k in range(MOST):
            if k and self.solver == NEWTON:
                matrix = self.matrix(K)
            change = self.slopes(K) - K
            if matrix is not None:
                change = np.linalg.solve(matrix, change.ravel()).reshape(K.shape)
            K = K + change
            self.iterations += 1
            moved = self.h * np.abs(change).max()
            if not np.isfinite(moved):
                return False
            stalled = moved >= 0.5 * last and moved <= 64 * EPS * size
            if moved <= max(self.tol, EPS / 4) * size or stalled:
                self.y = self.y + self.h * self.gauss.b @ K
                self.last = [K, *self.last][:LEVELS]
                return True
            last = moved
        return False

    def run(self, steps: int) -> bool:
        """Take up to ``steps`` steps; return False if the equations of one of them are not solved."""
        with np.errstate(all="ignore"):
            try:
                return all(self.step() for _ in range(steps))
            except np.linalg.LinAlgError:
                return False


def measure_rows(k: int) -> Rows:
    """Measure evaluations and error of a Gauss method with every way to solve its equations, on orbit ``SCENES[k]``.

    A way is a solver, a start and a tolerance.  Returns {`TABLE`: rows}: a row for each way at each step size, and one
    more for each step size with the counts of the solver inside the integrators.
    """
    name, sizes = SCENES[k]
    made = problem(name)
    field = made.system.vector_field()
    y0, rows = np.array([*made.q0, *made.p0]), []
    for h in sizes:
        fine = integrate(made, FINE, h=h / 4, steps=4 * STEPS, save_every=0)
        true = np.concatenate([fine.q[-1], fine.p[-1]])
        head = {"scene": name, "h": h, "steps": STEPS}
        for solver, start, tol in SETTINGS:
            loop = Loop(lambda y: field(0.0, y), y0, h, solver, start, tol)
            solved = loop.run(STEPS)
            row = head | {"solver": solver, "start": start, "tol": tol, "status": OK if solved else NOT_CONVERGED}
            if solved:
                row |= {"evaluations": loop.evaluations / STEPS, "iterations": loop.iterations / STEPS}
                row["error"] = float(np.abs(loop.y - true).max())
            rows.append(row)
        own = integrate(made, METHOD, h=h, steps=STEPS, save_every=0)
        row = head | {"solver": ENGINE, "start": FIVE, "tol": ROUND_OFF, "status": own.status}
        error = float(np.abs(np.concatenate([own.q[-1], own.p[-1]]) - true).max())
        rows.append(row | {"evaluations": own.counts["gradient"] / STEPS, "iterations": None, "error": error})
    return {TABLE: rows}
