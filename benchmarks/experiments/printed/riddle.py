r"""Every root of the energy equation of Schemes IV and V, by exhaustive scan: the riddle of the printed column.

The talk prints Scheme IV as first order; its own theorem (lambda = 1/2 + O(h)) makes it second order, and so it is on
the root nearest 1/2.  Is there another branch?  For each step of a trajectory the stage equations

.. math::
    k = -\nabla U\bigl(q + (1-\lambda)\,ch\,v + \lambda(1-\lambda)(ch)^2 M^{-1}k\bigr)

are followed by continuation in lambda from 1/2 outwards (Newton with the Hessian, all steps at once in NumPy) to
``reach`` or to the fold where they lose their solution, and every change of sign of E is a root.  This shares no code
with the kernels' root finder.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import sympy as sp

from phasebench.benchmarks.measure.accuracy import end_state
from phasebench.benchmarks.measure.metrics import refinement_difference
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.base import Problem
from phasebench.benchmarks.rows.cells import Cell, Rows, content
from phasebench.benchmarks.rows.cells import Problem as About
from phasebench.integrators.driver import integrate
from phasebench.integrators.record import Method
from phasebench.integrators.registry import method

from .printed import AGREEMENT, PRINTED, RIDDLE, STEPS, unit

#: The substeps' signs: lambda_s = 1/2 + sign (lambda - 1/2).
SIGNS = {"scheme-iv": (1,), "scheme-v": (-1, 1)}


@dataclass(frozen=True)
class Scan:
    """What a scan found.

    Attributes
    ----------
    roots : for each step the roots lambda, sorted by distance from 1/2
    low, high : for each step how far the continuation reached below and above 1/2
    """

    h: float
    roots: list[np.ndarray]
    low: np.ndarray
    high: np.ndarray


class _Forces:
    """The gradient and Hessian of U and the mass matrix of a problem with quadratic T, on columns."""

    def __init__(self, found: Problem):
        self.system = system = found.system
        if not getattr(system, "quadratic_kinetic", False):
            raise ValueError("the scan is written for a separable H with quadratic T")
        self.first = [sp.diff(system.potential, x) for x in system.q]
        self.second = [[sp.diff(g, y) for y in system.q] for g in self.first]
        self.inverse_mass = np.array(sp.hessian(system.kinetic, system.p).tolist(), float)

    def gradient(self, Q):
        return np.stack([self.system.observe(e, Q, Q) for e in self.first], axis=1)

    def hessian(self, Q):
        return np.stack([np.stack([self.system.observe(e, Q, Q) for e in row], axis=1) for row in self.second], axis=1)


def _substep(forces: _Forces, Q, P, h, lam, k):
    """Newton from k at every row: (Q, P after the substep, k, whether it is solved and short of the fold)."""
    M, d = forces.inverse_mass, Q.shape[1]
    b = lam * (1 - lam) * h * h
    V = P @ M
    good = np.ones(len(Q), bool)
    with np.errstate(all="ignore"):
        for _ in range(8):
            at = Q + (1 - lam) * h * V + b * (k @ M)
            J = np.eye(d) + b * forces.hessian(at) @ M
            good &= np.linalg.det(J) > 1e-4
            J[~good] = np.eye(d)
            move = np.linalg.solve(J, (k + forces.gradient(at))[..., None])[..., 0]
            k = np.where(good[:, None], k - move, k)
            if not good.any() or np.abs(move[good]).max() <= 1e-12:
                break
        good &= np.abs(move).sum(1) <= 1e-10 * (1 + np.abs(k).sum(1))
    return Q + h * (V + lam * h * (k @ M)), P + h * k, k, good


def scan(found: Problem, scheme: str, h: float, Q, P, H0: float, reach: float = 60.0, spacing: float = 0.02) -> Scan:
    """Every root lambda in [1/2 - reach, 1/2 + reach] of the steps from the rows of Q, P (each of shape (n, d))."""
    forces, signs = _Forces(found), SIGNS[scheme]
    n = len(Q)
    roots: list[list[float]] = [[] for _ in range(n)]
    ends = {}
    for side in (-1, 1):
        ks = [-forces.gradient(Q) for _ in signs]
        alive, end, before = np.ones(n, bool), np.full(n, 0.5), None
        for i in range(round(reach / spacing) + 1):
            # Half a cell off 1/2, so that no grid point is the root itself.
            x = side * (i - 0.5) * spacing
            q, p = Q, P
            for s, sign in enumerate(signs):
                q, p, ks[s], good = _substep(forces, q, p, h / len(signs), 0.5 + sign * x, ks[s])
                alive &= good
            if not alive.any():
                break
            E = found.system.observe(found.system.H, q, p) - H0
            if before is not None:
                for row in np.flatnonzero(alive & ((E > 0) != (before > 0))):
                    share = before[row] / (before[row] - E[row])
                    roots[row].append(0.5 + x + side * spacing * (share - 1))
            end[alive] = 0.5 + x
            before = E
        ends[side] = end
    # The innermost cell is scanned from both sides: keep its roots once.
    merged = []
    for r in roots:
        r = sorted(r, key=lambda lam: abs(lam - 0.5))
        merged.append(np.array([x for i, x in enumerate(r) if i == 0 or abs(x - r[i - 1]) > 1e-9]))
    return Scan(h, merged, ends[-1], ends[1])


def along(found: Problem, scheme: str, h: float, t_end: float, every: int = 1, **options) -> Scan:
    """The scan of every ``every``-th step of the scheme's own trajectory."""
    path = integrate(found, scheme, h=h, t_end=t_end)
    H0 = float(found.system.observe(found.system.H, path.q[:1], path.p[:1])[0])
    return scan(found, scheme, path.h, path.q[:-1:every], path.p[:-1:every], H0, **options)


def rootless(found: Problem, scheme: str, h: float, t_end: float, limit: int = 200, **options):
    """(Solution, steps without a root as the finder says, their scan): the scan must find none within its radius."""
    path = integrate(found, scheme, h=h, t_end=t_end)
    H0 = float(found.system.observe(found.system.H, path.q[:1], path.p[:1])[0])
    steps = np.flatnonzero(np.isnan(path.parameter))
    some = steps[:limit]
    return path, steps, scan(found, scheme, path.h, path.q[some], path.p[some], H0, **options)


@dataclass(frozen=True)
class Recipe:
    """How a column might have been made: a method, a number of steps beyond t = 1, and whether q alone is compared."""

    name: str
    method: Method
    beyond: int = 0
    q_alone: bool = False

    def column(self, found: Problem) -> list[float]:
        """The refinement differences for the talk's steps."""
        kept = slice(found.system.d if self.q_alone else None)
        states = [
            end_state(integrate(found, self.method, h=h, steps=round(1 / h) + self.beyond, save_every=0)) for h in STEPS
        ]
        return [float(refinement_difference(a[kept], b[kept])) for a, b in pairwise(states)]


def scheme_i(lam: str) -> Method:
    """Scheme I at a constant parameter."""
    return method("scheme-i", lam=lam)


#: The consistent root, constant parameters, and the nearest misses that are known.
RECIPES = (
    Recipe("Scheme IV, root nearest 1/2", method("scheme-iv")),
    *(Recipe(f"Scheme I, lambda = {lam}", scheme_i(lam)) for lam in ("-2/5", "0", "1", "29/20", "3/2")),
    Recipe("implicit midpoint", method("implicit-midpoint")),
    Recipe("Scheme IV, one step more", method("scheme-iv"), beyond=1),
    Recipe("Scheme I, lambda = -51/50, in q alone", scheme_i("-51/50"), q_alone=True),
)
CLAIM = "printed for Scheme IV"


def agreeing(column: Sequence[float]) -> int:
    """How many entries of a column are the printed ones of Scheme IV, each within `AGREEMENT` of its last digit."""
    return sum(abs(x - float(t)) <= AGREEMENT * unit(t) for x, t in zip(column, PRINTED[RIDDLE], strict=True))


def columns() -> list[dict]:
    """The printed column beside what `RECIPES` give, on the talk's test."""
    found = problem("henon-heiles:chaotic")
    known = {CLAIM: [float(t) for t in PRINTED[RIDDLE]]} | {r.name: r.column(found) for r in RECIPES}
    heads = [f"{h:g}" for h in STEPS[1:]]
    return [
        {"recipe": name, **dict(zip(heads, column, strict=True)), "entries that agree": agreeing(column)}
        for name, column in known.items()
    ]


def summary(scans: list[Scan]) -> list[dict]:
    """A row per h: steps, how many have how many roots, the range of the nearest and of the far ones, the reach."""
    out = []
    for s in scans:
        nearest = np.array([r[0] for r in s.roots if len(r)])
        far = np.concatenate([r[1:] for r in s.roots] or [np.array([])])
        counts = np.bincount([len(r) for r in s.roots], minlength=2)
        out.append(
            {
                "h": s.h,
                "steps": len(s.roots),
                "without a root": int(counts[0]),
                "with one": int(counts[1]),
                "with more": int(counts[2:].sum()),
                "nearest root, least": nearest.min() if len(nearest) else np.nan,
                "nearest root, greatest": nearest.max() if len(nearest) else np.nan,
                "far roots": len(far),
                "far root closest to 1/2": far[np.abs(far - 0.5).argmin()] if len(far) else np.nan,
                "scanned from": float(s.low.max()),
                "scanned to": float(s.high.min()),
            }
        )
    return out


def cells(quick: bool = False) -> list[Cell]:
    """A cell for the scan of each printed step, and one for the recipes; none of the quick tier."""
    scheme, problem_of = method("scheme-iv"), About("henon-heiles:chaotic")
    names = frozenset({"henon-heiles", "scheme-iv"})

    def cell(tables, key, measure, arguments):
        about = content(measure.__name__, key, scheme, problem_of, code=[__name__])
        return Cell("printed", tables, key, measure, arguments, about, names)

    if quick:
        return []
    scans = [cell(("riddle", "riddle_roots"), {"h": h}, scanned, (h,)) for h in STEPS]
    return [*scans, cell(("riddle_columns",), {}, recipes, ())]


def scanned(h: float) -> Rows:
    """Every root of every step of Scheme IV, and their summary."""
    s = along(problem("henon-heiles:chaotic"), "scheme-iv", h, 1.0)
    roots = [{"h": h, "t": i * s.h, "lambda": float(lam)} for i, r in enumerate(s.roots) for lam in r[1:]]
    return {"riddle": [row | {"h": h} for row in summary([s])], "riddle_roots": roots}


def recipes() -> Rows:
    """The recipes beside the printed column."""
    return {"riddle_columns": columns()}
