r"""Chaotic scenes whose statistics are known: ensembles on a surface of constant energy, and averages over it.

Starts are drawn from the microcanonical distribution :math:`\delta(E - H)`, which the flow does not change, chaotic or
not: an average over starts and times is the average over the surface at every time.  With two degrees of freedom and
:math:`H = \tfrac12 p\cdot M(q)^{-1}p + V(q)` the coordinates have the density :math:`\sqrt{\det M(q)}` where V < E,
and the direction of :math:`L^{-1}p`, :math:`M = LL^T`, is uniform; averages are sums over a fine grid.  Crossings of a
plane have the uniform density in (q, p) on it, for unit masses.

Atoms have conserved momenta besides the energy, and Lyapunov exponents no closed form: there the reference is a run
from the same starts, orbit by orbit, by the method of order 8 and the small steps of `FINE`.

Source: V. I. Arnold, Mathematical Methods of Classical Mechanics (1989), section 16 (Liouville's theorem).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from phasebench.benchmarks.problems import problem

SEED = 34
#: Points of a grid in each coordinate.
GRID = 2000
#: The method, and the number of its steps between rows, whose averages are references where no closed form is known.
FINE = ("kahan-li-8", 16)
MEAN, SECTION, EXPONENT = "mean", "section", "exponent"


@dataclass(frozen=True)
class Scene:
    """A statistic of an ensemble of orbits, to be computed by integrators.

    Attributes
    ----------
    id, problem : the scene's name, and that of the problem
    kind : `MEAN` of a formula in q and p; `SECTION`, the share of crossings of a plane where the formula is positive;
        or `EXPONENT`, the mean of the largest Lyapunov exponents over the span
    formula : the quantity, in the problem's variables; "" for an exponent
    energy : E of all orbits; None for the atoms, which start at the problem's positions with random momenta
    span, row : the time of a run, and the time between two output rows
    orbits : the number of orbits
    plane : the coordinate that is 0 on the plane of a `SECTION`
    """

    id: str
    problem: str
    kind: str
    formula: str
    energy: float | None
    span: float
    row: float
    orbits: int
    plane: str = ""

    @property
    def known(self) -> bool:
        """True if the statistic of the exact flow is known; else a run of `FINE` from the same starts replaces it."""
        return self.kind != EXPONENT and self.energy is not None


SCENES = {
    s.id: s
    for s in (
        Scene("henon-heiles-mean", "henon-heiles", MEAN, "q2**2", 0.16, 300.0, 1.0, 32768),
        Scene("henon-heiles-section", "henon-heiles", SECTION, "q2", 0.16, 300.0, 1.0, 32768, "q1"),
        Scene("henon-heiles-exponent", "henon-heiles", EXPONENT, "", 0.163, 500.0, 0.5, 4096),
        Scene("double-pendulum-mean", "double-pendulum", MEAN, "2 + 2*cos(q1) + cos(q2)", 2.0, 500.0, 0.5, 1024),
        Scene("quadrupole-boson-mean", "quadrupole-boson", MEAN, "q0**2 + q2**2", 60.0, 100.0, 0.1, 1024),
        Scene("quadrupole-boson-section", "quadrupole-boson", SECTION, "q0", 60.0, 100.0, 0.1, 65536, "q2"),
        Scene("argon-mean", "lennard-jones", MEAN, "kinetic", None, 20.0, 0.05, 2048),
    )
}
#: Problems whose H is not separable: methods that need that are left out there.
COUPLED = ("double-pendulum",)
#: Problem -> half the side of a square that holds all coordinates with V < E.
BOXES = {"henon-heiles": 1.0, "double-pendulum": np.pi, "quadrupole-boson": 6.0}


def _formula(scene: Scene) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Return the scene's formula as a function of q and p, arrays (..., d), whose value is an array (...)."""
    import sympy as sp

    from phasebench.integrators.systems.formula import parse

    system = problem(scene.problem).system
    if scene.formula == "kinetic":
        return lambda q, p: (p**2).sum(axis=-1) / 2
    names = {str(x): x for x in (*system.q, *system.p)}
    compiled = sp.lambdify([system.q, system.p], parse(scene.formula, names), modules="numpy")
    return lambda q, p: compiled(np.moveaxis(q, -1, 0), np.moveaxis(p, -1, 0))


def quantity(scene: Scene) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Return the quantity to be averaged, as a function of q and p, arrays (..., d), whose value is an array (...).

    It is the formula for a `MEAN` scene; else 1 where the formula is positive and 0 elsewhere.
    """
    found = _formula(scene)
    return found if scene.kind == MEAN else lambda q, p: (found(q, p) > 0).astype(float)


@lru_cache(maxsize=8)
def _energies(name: str) -> tuple[Callable[[np.ndarray], np.ndarray], Callable[[np.ndarray], np.ndarray]]:
    """Return two functions of coordinates q, array (n, d): the potential V(q), (n,), and mass matrices M(q), (n, d, d).

    ``name`` is the problem's.
    """
    import sympy as sp

    system = problem(name).system
    matrix = sp.hessian(system.H, system.p)
    rest = sp.simplify(system.H.subs(dict.fromkeys(system.p, 0)))
    V = sp.lambdify([system.q], rest, modules="numpy")
    inverse = sp.lambdify([system.q], matrix, modules="numpy")

    def masses(q: np.ndarray) -> np.ndarray:
        rows = inverse(q.T)
        found = np.array([[np.broadcast_to(x, len(q)) for x in row] for row in rows], dtype=float)
        return np.linalg.inv(np.moveaxis(found, -1, 0))

    return lambda q: np.broadcast_to(V(q.T), len(q)), masses


def start(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Draw the ensemble's initial states: (q, p), arrays (orbits, d), from a generator with the seed `SEED`."""
    draw, made, n = np.random.default_rng(SEED), problem(scene.problem), scene.orbits
    if scene.energy is None:
        q = np.tile(made.q0, (n, 1))
        p = draw.normal(size=q.shape).reshape(n, -1, 2)
        p -= p.mean(axis=1, keepdims=True)
        p = p.reshape(n, -1)
        return q, p * np.sqrt((np.array(made.p0) ** 2).sum() / (p**2).sum(axis=1))[:, None]
    V, masses = _energies(scene.problem)
    side, kept = BOXES[scene.problem], []
    top = np.sqrt(np.linalg.det(masses(np.array([[0.0, np.pi / 2]])))).max()
    while sum(map(len, kept)) < n:
        q = draw.uniform(-side, side, (4 * n, 2))
        density = np.where(V(q) < scene.energy, np.sqrt(np.linalg.det(masses(q))), 0.0)
        kept.append(q[_inside(scene, q) & (draw.uniform(0, top, len(q)) < density)])
    q = np.concatenate(kept)[:n]
    angle = draw.uniform(0, 2 * np.pi, n)
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=1) * np.sqrt(2 * (scene.energy - V(q)))[:, None]
    return q, np.einsum("nij,nj->ni", np.linalg.cholesky(masses(q)), direction)


def _inside(scene: Scene, q: np.ndarray) -> np.ndarray:
    """Return whether coordinates q, array (n, 2), are in the bounded part of V < E: booleans, array (n,).

    On Henon-Heiles that is the triangle around the minimum; on other problems every point passes.
    """
    if scene.problem != "henon-heiles":
        return np.ones(len(q), bool)
    x, y = q.T
    return (y > -0.5) & (y < 1 - np.sqrt(3) * np.abs(x))


def exact(scene: Scene) -> float:
    """Compute the exact statistic of a scene by a sum over a grid.

    It is the average over the surface of constant energy, or the share of crossings of the plane.
    """
    V, masses = _energies(scene.problem)
    side = BOXES[scene.problem]
    x = (np.arange(GRID) + 0.5) / GRID * 2 * side - side
    if scene.kind == MEAN:
        q = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1).reshape(-1, 2)
        q = q[(V(q) < scene.energy) & _inside(scene, q)]
        weights = np.sqrt(np.linalg.det(masses(q)))
        return float(np.average(_formula(scene)(q, np.zeros_like(q)), weights=weights))
    system = problem(scene.problem).system
    across = [str(v) for v in system.q].index(scene.plane)
    fine = np.linspace(-side, side, GRID**2 // 4 + 1)
    q = np.zeros((len(fine), 2))
    q[:, 1 - across] = fine
    q = q[(V(q) < scene.energy) & _inside(scene, q)]
    width = np.sqrt(2 * (scene.energy - V(q)))
    return float(np.average(_formula(scene)(q, np.zeros_like(q)) > 0, weights=width))
