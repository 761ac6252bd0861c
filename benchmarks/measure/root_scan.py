r"""Finds every value of lambda with which a step of Scheme IV or V conserves H, by exhaustive scan.

Schemes IV and V are methods with a parameter lambda, for which they choose in each step the value nearest 1/2 with
which H is the same after the step.  For each step of a trajectory the stage equations

.. math::
    k = -\nabla U\bigl(q + (1-\lambda)\,ch\,v + \lambda(1-\lambda)(ch)^2 M^{-1}k\bigr)

(ch is the size of a substep, U the potential, M the mass matrix, v the velocity) are solved by continuation in lambda
from 1/2 outwards (Newton with the Hessian, all steps at once in NumPy) up to a given distance from 1/2, or to the fold
at which the solution ceases to exist.  Where the energy error changes sign along lambda, there is a root: a lambda with
which the step conserves H.
The scan shares no code with the kernels' root finder.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import sympy as sp

from phasebench.benchmarks.problems.base import Problem
from phasebench.integrators.driver import integrate

#: Signs of the substeps: lambda_s = 1/2 + sign (lambda - 1/2).
SIGNS = {"scheme-iv": (1,), "scheme-v": (-1, 1)}


@dataclass(frozen=True)
class Scan:
    """The values of lambda with which a step conserves H, for each step of a trajectory.

    Attributes
    ----------
    h, roots : the step size; for each of n steps the values of lambda, an array sorted by distance from 1/2
    low, high : arrays (n,), the lambda that the continuation reached below and above 1/2 in each step
    """

    h: float
    roots: list[np.ndarray]
    low: np.ndarray
    high: np.ndarray


class _Forces:
    """The gradient (n, d) and Hessian (n, d, d) of U at rows Q (n, d), for H = T(p) + U(q), T quadratic."""

    def __init__(self, found: Problem) -> None:
        self.system = system = found.system
        if not getattr(system, "quadratic_kinetic", False):
            raise ValueError("the scan is written for a separable H with quadratic T")
        self.first = [sp.diff(system.potential, x) for x in system.q]
        self.second = [[sp.diff(g, y) for y in system.q] for g in self.first]
        self.inverse_mass = np.array(sp.hessian(system.kinetic, system.p).tolist(), float)

    def gradient(self, Q: np.ndarray) -> np.ndarray:
        return np.stack([self.system.observe(e, Q, Q) for e in self.first], axis=1)

    def hessian(self, Q: np.ndarray) -> np.ndarray:
        return np.stack([np.stack([self.system.observe(e, Q, Q) for e in row], axis=1) for row in self.second], axis=1)


def _substep(
    forces: _Forces, Q: np.ndarray, P: np.ndarray, h: float, lam: float, k: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Take a substep from every row of Q, P (n, d); the stage equation is solved for k by Newton's method.

    Returns (Q, P, k, boolean array (n,): True where k converged and is not past the fold at which the solution ends).
    """
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


def scan(
    found: Problem,
    scheme: str,
    h: float,
    Q: np.ndarray,
    P: np.ndarray,
    H0: float,
    reach: float = 60.0,
    spacing: float = 0.02,
) -> Scan:
    """Find every lambda in [1/2 - reach, 1/2 + reach] with which a step of a scheme conserves H, from n states.

    Q, P are arrays (n, d), H0 is the energy that a step must have at its end, ``spacing`` that of the scan.
    """
    forces, signs = _Forces(found), SIGNS[scheme]
    n = len(Q)
    roots: list[list[float]] = [[] for _ in range(n)]
    ends = {}
    for side in (-1, 1):
        ks = [-forces.gradient(Q) for _ in signs]
        alive, end, before = np.ones(n, bool), np.full(n, 0.5), None
        for i in range(round(reach / spacing) + 1):
            # Offset the grid by half a cell, since lambda = 1/2 may itself be the root.
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
    # The innermost cell is scanned from both sides, so its roots appear twice: keep one of each.
    merged = []
    for r in roots:
        r = sorted(r, key=lambda lam: abs(lam - 0.5))
        merged.append(np.array([x for i, x in enumerate(r) if i == 0 or abs(x - r[i - 1]) > 1e-9]))
    return Scan(h, merged, ends[-1], ends[1])


def along(found: Problem, scheme: str, h: float, t_end: float, every: int = 1, **options: float) -> Scan:
    """Integrate by a scheme to ``t_end``, and `scan` every Nth step (``every``) for all lambda that conserve H."""
    path = integrate(found, scheme, h=h, t_end=t_end)
    H0 = float(found.system.observe(found.system.H, path.q[:1], path.p[:1])[0])
    return scan(found, scheme, path.h, path.q[:-1:every], path.p[:-1:every], H0, **options)


def summary(scans: list[Scan]) -> list[dict]:
    """Make the rows of a table of the roots, one for each scan (a step size h).

    They have the numbers of steps without a root, with one and with more; the range of the roots nearest to 1/2; the
    number of all others ("far"), and which of these is closest to 1/2; and the range of lambda scanned in every step.
    """
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
