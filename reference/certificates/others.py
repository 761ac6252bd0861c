"""Comparison of an orbit with other solvers: Gauss's method, which shares no code with the Taylor runs, and IAS15.

A solver's uncertainty has two terms: `SAFETY` times the difference of its two runs (with two step sizes or tolerances),
as both have errors of similar size; and the round-off eps n^(1/2) of a random walk of n steps, grown like the distance
of neighbouring trajectories.  The comparison verifies the equations and the solvers to this precision, not all digits.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from phasebench.reference.solvers import gauss, taylor

from . import horizon
from .along import Along, norm, upto
from .stored import Check

SAFETY = 4.0
#: Gauss's steps: each step of the Taylor run in 2 or 3 parts, and none longer than this share of the span.
PARTS, SHARE = (2, 3), 1 / 400
GAUSS, IAS15 = "Gauss of order 16, long double", "IAS15, double"
TOLERANCES = (1e-9, 1e-11)


def words(problem: Any, times: Sequence[float], path: Along, apart: np.ndarray) -> list[tuple[Check, ...]]:
    """Compare a certified orbit, ``path``, with the orbits that other solvers compute, at each of the times.

    Returns a tuple for each time, with one `Check` (distance and uncertainty) for each solver.  ``apart`` has the
    orbit's distances from a neighbouring one (`horizon.neighbour`) at the times of ``path.grid``.
    """
    unit = np.maximum(upto(path.size), apart / horizon.SHIFT)
    if problem.system.constrained:
        # Round-off leaves the hidden constraint, and off it orbits part faster than the neighbours that are on it.
        off = horizon.neighbour(problem, path.grid, path.near, everywhere=True)
        unit = np.maximum(unit, off / horizon.SHIFT)
    beyond, own = _gauss(problem, path, unit)
    at = [path.grid.index(t) for t in times]
    said = [[Check(GAUSS, float(beyond[i]), float(own[i]))] for i in at]
    ias15 = _ias15(problem, times, unit[at])
    if ias15 is not None:
        rows, uncertainty = ias15
        number = taylor.Bits(path.precision.bits)
        far = upto([norm(x, path.rows[i], number) for x, i in zip(rows, at, strict=True)])
        for checks, distance, mine in zip(said, far, uncertainty, strict=True):
            checks.append(Check(IAS15, float(distance), float(mine)))
    return [tuple(checks) for checks in said]


def _gauss(problem: Any, path: Along, unit: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Integrate the problem by Gauss's method, with two step sizes, and compare the finer run with the orbit ``path``.

    Returns two arrays (n,), at the times of ``path.grid``: the distances, and the uncertainties of the finer run.
    ``unit`` is, at each time, the factor by which a relative error at the start is multiplied to give the absolute
    error that it has grown to.
    """
    system, q0, p0, t_end = problem.system, problem.q0, problem.p0, path.grid[-1]
    ends = taylor.step_ends(system, np.longdouble, q0, p0, t_end)
    runs = []
    for parts in PARTS:
        marks = []
        for a, b in zip([0.0, *ends[:-1]], ends, strict=True):
            pieces = parts * max(1, int(np.ceil((b - a) / (SHARE * t_end))))
            marks += [a + (b - a) * (k + 1) / pieces for k in range(pieces)]
        runs.append(gauss.run(system, q0, p0, marks, path.grid))
    walk = np.sqrt(np.arange(1, len(path.grid) + 1) / len(path.grid) * len(marks))
    difference = np.abs(runs[1] - runs[0]).max(axis=1).astype(float)
    return path.distances(runs[1]), uncertainty(difference, float(gauss.EPS) * walk * unit)


def _ias15(problem: Any, times: Sequence[float], unit: np.ndarray) -> tuple[list[np.ndarray], np.ndarray] | None:
    """Integrate by REBOUND's IAS15: (states at the times, at the finer of two tolerances; their uncertainties).

    ``unit`` is, at each time, the factor by which a relative error at the start is multiplied to give the absolute
    error that it has grown to.  None if IAS15 is not applicable, or a run of it fails.
    """
    from phasebench.reference.peers import BY_ID, integrate_peer

    peer = BY_ID.get("rebound-ias15")
    # With one degree of freedom the acceleration vanishes along the way, and with it IAS15's step.
    if peer is None or problem.system.d == 1 or peer.lacks(problem, problem.system):
        return None
    runs = []
    for tol in TOLERANCES:
        solutions = [integrate_peer(problem, peer, tol=tol, t_end=t) for t in times]
        if any(s.status != "ok" for s in solutions):
            return None
        runs.append([np.concatenate([s.q[-1], s.p[-1]]) for s in solutions])
    steps = np.array([s.counts["steps"] for s in solutions])
    difference = [np.abs(a - b).max() for a, b in zip(*runs, strict=True)]
    return runs[1], uncertainty(difference, np.finfo(float).eps * np.sqrt(steps) * unit)


def uncertainty(difference: Sequence[float] | np.ndarray, round_off: np.ndarray | float) -> np.ndarray:
    """A solver's uncertainty at each time: `SAFETY` times the running maximum of ``difference``, plus ``round_off``.

    ``difference`` is the distance of the solver's two runs.
    """
    return SAFETY * upto(difference) + round_off
