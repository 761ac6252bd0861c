r"""Step-size resonances of the Fermi-Pasta-Ulam problem with two stiff springs, over (h omega_1, h omega_2).

On a spring alone a step with matrix M is a rotation by an angle :math:`\theta(h\omega)`, 2 cos(theta) = tr M.  The soft
springs couple the rotations.  At a step-size resonance,

.. math::
    k_1\theta_1 + k_2\theta_2 = 2\pi n,\qquad n \ne 0,

errors add up from step to step.  (With n = 0 springs exchange energy in the problem itself.)  Resonant strips are
narrow: the angles of the grid are multiples of pi / `NODES`, so that lines of low order :math:`|k_1| + |k_2|` pass
exactly through its nodes.

Drift is measured in the energy that the step keeps between resonances, in which a spring has the part
:math:`J\theta/h`, J its action: the area of the ellipse that M keeps, over 2 pi.  Means over `WINDOWS` parts of a run
remove oscillation.

Sources: Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), XIII.2 (h = 0.02 there) and XIII.9; M.
Mandziuk, T. Schlick, Chem. Phys. Lett. 237 (1995) 525-535 (h omega = sqrt 2 and sqrt 3 of Stormer-Verlet).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import sympy as sp

from phasebench.benchmarks.measure import oscillator
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.problems.fpu import formula, soft_springs
from phasebench.benchmarks.store.cells import Cell, ProblemKey, Rows, content
from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.families.trigonometric import with_filters
from phasebench.integrators.prepared import lay_out
from phasebench.integrators.stepping.kernel import prepare
from phasebench.integrators.systems.hamiltonian import Hamiltonian

from .methods import record

H, WINDOWS = 0.02, 8
#: The largest h omega, the smallest angle in grid units, the points from which theta(h omega) is interpolated.
LAST, LEAST, POINTS = 6.2, 4, 2400
#: (method, grid intervals in an angle of pi, steps of a run)
RUNS = (
    ("stormer-verlet", 48, 3000),
    ("blanes-moan-s6", 48, 3000),
    ("deuflhard", 36, 3000),
    ("mollified-impulse", 36, 3000),
    ("scheme-i", 36, 1600),
    ("gauss-2", 36, 800),
)
NODES = {id: nodes for id, nodes, _ in RUNS}
#: Positions and momenta of the soft springs; each stiff one begins with the energy 1.
SOFT_Q, SOFT_P = (1.0, 0.3), (1.0, -0.2)
TABLES = ("extremes_springs",)


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements to make (`Cell`), one for each method; none if ``quick``."""
    return [] if quick else [_cell(*run) for run in RUNS]


def _cell(id: str, nodes: int, steps: int) -> Cell:
    needs = content("springs", record(id), nodes, steps, ProblemKey("fpu"), code=[__name__])
    return Cell("extremes", TABLES, {"method": id}, measure_rows, (id, nodes, steps), needs, frozenset({id, "fpu"}))


class Turns:
    """A method's step on a spring (the oscillator) as a rotation of (omega q, p).

    Attributes
    ----------
    z : the values of h omega, as far as the method is stable
    matrices, angles : at each z the 2 x 2 matrix of the step, and the angle in radians by which it rotates
    """

    def __init__(self, id: str, z: Sequence[float] | np.ndarray) -> None:
        chosen = integrator(id)
        found = [oscillator.matrix(chosen, float(x)) for x in z]
        stable = [abs(np.trace(M)) < 2 + oscillator.SAME for M in found]
        end = stable.index(False) if False in stable else len(stable)
        self.z, self.matrices = np.asarray(z)[:end], found[:end]
        angles = [np.arctan2(_sine(M), np.trace(M) / 2) for M in self.matrices]
        self.angles = np.unwrap(np.array(angles) % (2 * np.pi))

    def energy(self, k: int, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Compute the energy J theta / h, which the step keeps, of a spring with the k-th h omega; J is its action.

        x = omega q and p are arrays of equal shape, as is the result.
        """
        M, s = self.matrices[k], _sine(self.matrices[k])
        if abs(s) < 1e-6:  # a rotation by pi: every ellipse is kept
            action = (p**2 + x**2) / 2
        else:
            action = (M[0, 1] * p**2 + (M[0, 0] - M[1, 1]) * x * p - M[1, 0] * x**2) / (2 * s)
        return action * self.angles[k] / self.z[k]


def _sine(M: np.ndarray) -> float:
    """Compute the sine, with its sign, of the angle by which the 2 x 2 step matrix M rotates."""
    return float(np.sqrt(max(0.0, 1 - (np.trace(M) / 2) ** 2)) * np.sign(M[0, 1] - M[1, 0]))


def grid(id: str, nodes: int) -> np.ndarray:
    """Find the values of h omega, rising, at which one step rotates the oscillator by a multiple of pi / ``nodes``.

    They end at `LAST` or where the method becomes unstable.
    """
    curve = Turns(id, np.linspace(LAST / POINTS, LAST, POINTS))
    angles = np.arange(LEAST, int(curve.angles[-1] / np.pi * nodes) + 1) * np.pi / nodes
    return np.interp(angles, curve.angles, curve.z)


class Springs:
    """Runs of a method on the Fermi-Pasta-Ulam problem for any two stiff frequencies, compiled only once.

    A trigonometric method is given the frequencies as data.  For all others they are two extra coordinates that do not
    move, so that the compiled functions do not depend on them.
    """

    def __init__(self, id: str) -> None:
        q, p, H_ = formula(1.0, 2)
        w = sp.symbols("w1 w2", real=True)
        self.method = record(id)
        self.told = self.method.family == "trigonometric"
        if self.told:
            self.system = Hamiltonian(q=q, p=p, H=H_, frequencies=[0, 0, 1, 1])
        else:
            stiff = sum((v**2 - 1) * x**2 / 2 for v, x in zip(w, q[2:], strict=True))
            still = sp.symbols("v1 v2", real=True)
            self.system = Hamiltonian(q=[*q, *w], p=[*p, *still], H=H_ + sp.expand_mul(stiff))
        self.prepared = prepare(self.method, self.system)

    def __call__(self, w: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray]:
        """Integrate with the stiff frequencies w, array (2,), over ``steps`` steps: (q, p), arrays (4, steps + 1).

        The columns are the start and the state after each step; NaN from the first step on that fails.
        """
        q, p, prepared = [*SOFT_Q, *(1 / w)], [*SOFT_P, 1.0, 1.0], self.prepared
        if self.told:
            frequencies = (sp.S.Zero, sp.S.Zero, *(sp.Rational(float(x)) for x in w))
            prepared = replace(prepared, begin=partial(with_filters, frequencies, self.method.data, DOUBLE))
        else:
            q, p = [*q, *w], [*p, 0.0, 0.0]
        Q, P = (np.full((steps + 1, self.system.d), np.nan) for _ in "qp")
        Q[0], P[0] = q, p
        layout = lay_out(prepared, self.system.d, H, q, p)
        with np.errstate(all="ignore"):
            layout(Q[1:], P[1:], np.full((steps, 1), np.nan), 1)
        return Q.T[:4].copy(), P.T[:4].copy()


def drift(Q: np.ndarray, P: np.ndarray, fast: np.ndarray) -> float:
    """Compute the largest change of the mean energy over `WINDOWS` parts of a run, relative to the energy at the start.

    Changes are from the first part; inf if they are not finite.  Q and P are the states, arrays (4, n), of which the
    soft springs' energy is computed; ``fast`` (n,) is the energy of the stiff springs.
    """
    with np.errstate(all="ignore"):
        squares = [s * s for s in soft_springs(Q[:2], Q[2:])]
        energy = sum(s * s for s in squares) / 4 + (P[0] ** 2 + P[1] ** 2) / 2 + fast
        size = len(energy) // WINDOWS
        means = energy[: size * WINDOWS].reshape(WINDOWS, size).mean(axis=1)
        change = float(np.abs(means - means[0]).max() / energy[0])
    return change if np.isfinite(change) else np.inf


def measure_rows(id: str, nodes: int, steps: int) -> Rows:
    """Measure the energy drift of a chain with two stiff springs: a row for each pair of their frequencies.

    The frequencies are those at which a step turns a spring by a multiple of pi / ``nodes``; rows are by table name.
    """
    run, turns, rows = Springs(id), Turns(id, grid(id, nodes)), []
    for i in range(len(turns.z)):
        for j in range(i, len(turns.z)):
            w = turns.z[[i, j]] / H
            Q, P = run(w, steps)
            with np.errstate(all="ignore"):
                fast = turns.energy(i, w[0] * Q[2], P[2]) + turns.energy(j, w[1] * Q[3], P[3])
            row = {"method": id, "h omega 1": float(turns.z[i]), "h omega 2": float(turns.z[j])}
            row |= {"node 1": LEAST + i, "node 2": LEAST + j, "nodes": nodes, "steps": steps}
            rows.append(row | {"drift": drift(Q, P, fast)})
    return {TABLES[0]: rows}
