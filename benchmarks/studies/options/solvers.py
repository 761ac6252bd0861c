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

import numpy as np

from phasebench.benchmarks.problems import problem as problem_of
from phasebench.integrators.coefficients.tableaus import LEVELS, runge_kutta
from phasebench.integrators.driver import NOT_CONVERGED, OK, integrate

TABLE, STAGES, FINE = "knobs_solvers", 3, "gauss-8"
METHOD = f"gauss-{STAGES}"
FIXED, SIMPLE, NEWTON, ENGINE = "fixed point", "simplified Newton", "Newton", "engine"
ZERO, POLYNOMIAL, FIVE = "zero", "last polynomial", "five steps"
#: Tolerances relative to the state, at which an iteration ends; with `ROUND_OFF` it ends when changes stop falling.
ROUND_OFF, TOLERANCES = 0.0, (1e-3, 1e-6, 1e-9, 1e-12)
#: (Solver, start, tolerance) of the loop: every pair to round-off, and every tolerance from the start `FIVE`.
SETTINGS = (
    *((solver, start, ROUND_OFF) for solver in (FIXED, SIMPLE, NEWTON) for start in (ZERO, POLYNOMIAL, FIVE)),
    *((solver, FIVE, tol) for solver in (FIXED, SIMPLE) for tol in TOLERANCES),
)
STEPS, MOST, EPS = 200, 60, float(np.finfo(float).eps)
#: Orbit -> steps.
SCENES = {
    "pendulum:swinging": (0.1, 1.0),
    "henon-heiles:box": (0.1, 1.0),
    "perturbed-kepler": (0.02, 0.1),
    "fpu": (0.005, 0.1),
}


def jacobian(f: Callable, y: np.ndarray, at: np.ndarray) -> np.ndarray:
    """The Jacobian of f at y by forward differences, with ``at`` = f(y): one evaluation per variable."""
    steps = EPS**0.5 * np.maximum(np.abs(y), np.abs(y).max())
    return np.array([(f(y + step * e) - at) / step for step, e in zip(steps, np.eye(len(y)), strict=True)]).T


class Loop:
    """A run of the Gauss method in doubles from the state ``y0``, array (2 d,), with a choice of solver and start."""

    def __init__(self, f: Callable, y0: np.ndarray, h: float, solver: str, start: str, tol: float) -> None:
        self.f, self.y, self.h = f, np.array(y0, float), h
        self.solver, self.start, self.tol, self.last = solver, start, tol, []
        self.evaluations = self.iterations = 0
        A, _, b, c = runge_kutta("gauss", STAGES)
        self.A, self.b, self.c = np.array(A.tolist(), float), np.array(list(b), float), np.array(c, float)
        V, ahead = (np.vander(x, STAGES, increasing=True) for x in (self.c, 1 + self.c))
        self.forward = ahead @ np.linalg.inv(V)  # from the last step's slopes to the next one's, extrapolated

    def slopes(self, K: np.ndarray) -> np.ndarray:
        """The right-hand sides f(y + h A K) of the stage equations at the slopes K, array (stages, 2 d)."""
        self.evaluations += STAGES
        return np.array([self.f(y) for y in self.y + self.h * self.A @ K])

    def first(self) -> np.ndarray:
        """The starting values of K for the next step."""
        if not self.last or self.start == ZERO:
            return np.zeros((STAGES, len(self.y)))
        if self.start == POLYNOMIAL:
            return self.forward @ self.last[0]
        m = len(self.last)
        return sum((-1) ** j * comb(m, j + 1) * K for j, K in enumerate(self.last))

    def matrix(self, K: np.ndarray) -> np.ndarray | None:
        """The matrix of Newton's linear equations at K; None for the fixed-point iteration."""
        if self.solver == FIXED:
            return None
        if self.solver == SIMPLE:
            at = self.f(self.y)
            self.evaluations += 1 + len(self.y)
            return np.eye(K.size) - self.h * np.kron(self.A, jacobian(self.f, self.y, at))
        blocks = [jacobian(self.f, y, self.f(y)) for y in self.y + self.h * self.A @ K]
        self.evaluations += STAGES * len(self.y)
        rows = [np.hstack([a * J for a in row]) for row, J in zip(self.A, blocks, strict=True)]
        return np.eye(K.size) - self.h * np.vstack(rows)

    def step(self) -> bool:
        """Take a step; False if its equations are not solved."""
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
                self.y = self.y + self.h * self.b @ K
                self.last = [K, *self.last][:LEVELS]
                return True
            last = moved
        return False

    def run(self, steps: int) -> bool:
        """Take the steps; False if the equations of one of them are not solved."""
        with np.errstate(all="ignore"):
            try:
                return all(self.step() for _ in range(steps))
            except np.linalg.LinAlgError:
                return False


def solvers(scene: str) -> list[dict]:
    """Evaluations and error at each step: a row for each of `SETTINGS`, and one for the engine."""
    made, rows = problem_of(scene), []
    field, y0 = made.system.vector_field(), np.array([*made.q0, *made.p0])
    for h in SCENES[scene]:
        fine = integrate(made, FINE, h=h / 4, steps=4 * STEPS, save_every=0)
        own = integrate(made, METHOD, h=h, steps=STEPS, save_every=0)
        true, end = (np.concatenate([s.q[-1], s.p[-1]]) for s in (fine, own))
        for solver, start, tol in SETTINGS:
            loop = Loop(lambda y: field(0.0, y), y0, h, solver, start, tol)
            row = {"h": h, "steps": STEPS, "solver": solver, "start": start, "tol": tol}
            if loop.run(STEPS):
                row |= {"status": OK, "evaluations": loop.evaluations / STEPS, "iterations": loop.iterations / STEPS}
                rows.append(row | {"error": float(np.abs(loop.y - true).max())})
            else:
                rows.append(row | {"status": NOT_CONVERGED})
        row = {"h": h, "steps": STEPS, "solver": ENGINE, "start": FIVE, "tol": ROUND_OFF, "status": own.status}
        row |= {"evaluations": own.counts["gradient"] / STEPS, "iterations": None}
        rows.append(row | {"error": float(np.abs(end - true).max())})
    return rows
