"""How a certified end state is computed.

The state is that of a Taylor run in quadruple precision.  Its uncertainty is the distance from the same run at a
tolerance 50 times as large, which changes order, steps and round-off, and the rounding of the stored text.  Beside it
run long double (the distance is the uncertainty of `taylor.reference`), Gauss's method of order 16 in long double over
steps of two sizes (`gauss`), and IAS15 in double at two tolerances where REBOUND can do the problem.  A solver's
own uncertainty is `SAFETY` times the difference of its two runs, since both carry round-off of the same size, and the
round-off eps n^(1/2) of a random walk of n steps, grown as neighbouring trajectories part: it checks the equations and
the solvers to its precision, not all digits.

All distances are the largest on a grid up to a time.  The horizon is where long double leaves `LIMIT`, relative to the
state: errors of trajectories are not to be reported later.  How neighbouring trajectories part is measured by a run
displaced by `SHIFT`; growth faster than t^`FASTEST` is called exponential.
"""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal

import numpy as np

from phasebench.integrators.errors import InvalidInput
from phasebench.reference.solvers import gauss, taylor

from . import stored
from .stored import Certificate, Check, End

#: The other tolerance of quadruple precision, whose epsilon is 1.9e-34.
COARSER = "1e-32"
LIMIT = 1e-13
#: Points of the grid on which distances are followed.
GRID = 400
SAFETY = 4.0
#: Gauss's steps: the Taylor run's, each in so many parts, but none above the span's share.
PARTS, SHARE = (2, 3), 1 / 400
#: The relative displacement of the neighbouring run, the relative distance at which it is lost, and the exponent.
SHIFT, LOST, FASTEST = 2.0**-47, 1e-3, 3.0
GAUSS, IAS15 = "Gauss of order 16, long double", "IAS15, double"
TOLERANCES = (1e-9, 1e-11)


def certify(problem, times: Sequence[float], grid_points: int = GRID) -> Certificate:
    """Compute the certified states of a problem's orbit at ``times``, increasing and positive; the last is the end.

    Raises
    ------
    InvalidInput
        For times that do not increase from above 0.
    ReferenceFailed
        Where a run does not reach the end.
    """
    times = [float(t) for t in times]
    if not times or not np.isfinite(times).all() or times[0] <= 0 or (np.diff(times) <= 0).any():
        raise InvalidInput(f"the times are {times}; they must be positive, finite and increase")
    system, d, q0, p0, t_end = problem.system, problem.system.d, problem.q0, problem.p0, times[-1]
    long, quad = taylor.extended()
    grid = sorted({*times, *(t_end * (i + 1) / grid_points for i in range(grid_points - 1))})
    truth = taylor.states(system, quad, q0, p0, grid)
    coarser = taylor.states(system, quad, q0, p0, grid, COARSER)
    near = taylor.states(system, long, q0, p0, grid)
    size = np.array([max(abs(float(x)) for x in row) for row in truth])
    text = [[f"{Decimal(str(x)):.{stored.DIGITS - 1}e}" for x in row] for row in truth]
    uncertainty = _upto(_distances(coarser, truth, quad)) + size * 10.0 ** (1 - stored.DIGITS)
    off = _upto(_distances(near, truth, quad))
    apart = _neighbour(problem, grid, near, long)
    unit = np.maximum(_upto(size), apart / SHIFT)
    growth, rate = _growth(grid, apart, size)
    beyond, own = _gauss(problem, grid, truth, unit, long, quad)
    ias15 = _ias15(problem, times, np.array([unit[grid.index(t)] for t in times]))
    ends = []
    for t in times:
        i = grid.index(t)
        beside = [Check(GAUSS, float(beyond[i]), float(own[i]))]
        if ias15 is not None:
            beside.append(_compared(ias15, times.index(t), [truth[grid.index(s)] for s in times], quad))
        q, p = tuple(text[i][:d]), tuple(text[i][d:])
        change = stored.energy_change(problem, q, p)
        ends.append(End(t, q, p, float(uncertainty[i]), float(off[i]), change, tuple(beside)))
    return Certificate(
        problem=problem.label,
        orbit=problem.start.name,
        parameters=dict(problem.parameters),
        q0=tuple(map(float, q0)),
        p0=tuple(map(float, p0)),
        fingerprint=stored.fingerprint(problem),
        t_end=t_end,
        limit=LIMIT,
        spacing=t_end / grid_points,
        horizon=_horizon(grid, off, size),
        digits_horizon=_horizon(grid, uncertainty, size),
        growth=growth,
        rate=rate,
        ends=tuple(ends),
    )


def versions() -> dict[str, str | None]:
    """The packages that the digits come from."""
    from phasebench.reference.tables import version_of

    return {name: version_of(name) for name in ("heyoka", "numpy", "sympy", "mpmath", "rebound")}


def _distances(rows, truth, quad) -> np.ndarray:
    """The max norm over (q, p) of rows of any precision minus the quadruple run's, array (n,)."""
    return np.array([_norm(x, y, quad) for x, y in zip(rows, truth, strict=True)])


def _norm(x, y, quad) -> float:
    return max(abs(float(quad(a) - b)) for a, b in zip(x, y, strict=True))


def _upto(values) -> np.ndarray:
    return np.maximum.accumulate(values)


def _horizon(grid, distance, size) -> float:
    bad = np.flatnonzero(~(distance <= LIMIT * size))
    last = bad[0] - 1 if len(bad) else len(grid) - 1
    return float(grid[last]) if last >= 0 else 0.0


def _gauss(problem, grid, truth, unit, long, quad):
    """(distances on the grid, uncertainties) of Gauss's method; ``unit`` is what a relative error of 1 grows to."""
    system, q0, p0, t_end = problem.system, problem.q0, problem.p0, grid[-1]
    ends = taylor.step_ends(system, long, q0, p0, t_end)
    runs = []
    for parts in PARTS:
        marks = []
        for a, b in zip([0.0, *ends[:-1]], ends, strict=True):
            pieces = parts * max(1, int(np.ceil((b - a) / (SHARE * t_end))))
            marks += [a + (b - a) * (k + 1) / pieces for k in range(pieces)]
        runs.append(gauss.run(system, q0, p0, marks, grid))
    walk = np.sqrt(np.arange(1, len(grid) + 1) / len(grid) * len(marks))
    difference = np.array([float(x) for x in np.abs(runs[1] - runs[0]).max(axis=1)])
    own = SAFETY * _upto(difference) + float(gauss.EPS) * walk * unit
    return _upto(_distances(runs[1], truth, quad)), own


def _ias15(problem, times, unit):
    """(states at the times at the finer tolerance, uncertainties) of REBOUND's IAS15, or None where it cannot."""
    from phasebench.reference.peers import BY_ID, integrate_peer

    peer = BY_ID.get("rebound-ias15")
    # Of one degree of freedom the acceleration vanishes on the way, and IAS15's steps with it.
    if peer is None or problem.system.d == 1 or peer.lacks(problem, problem.system):
        return None
    runs = []
    for tol in TOLERANCES:
        solutions = [integrate_peer(problem, peer, tol=tol, t_end=t) for t in times]
        if any(s.status != "ok" for s in solutions):
            return None
        runs.append([np.concatenate([s.q[-1], s.p[-1]]) for s in solutions])
    steps = np.array([s.counts["steps"] for s in solutions])
    difference = _upto([np.abs(a - b).max() for a, b in zip(*runs, strict=True)])
    return runs[1], SAFETY * difference + np.finfo(float).eps * np.sqrt(steps) * unit


def _compared(ias15, i: int, truth, quad) -> Check:
    rows, own = ias15
    return Check(
        IAS15, max(_norm(x, y, quad) for x, y in zip(rows[: i + 1], truth[: i + 1], strict=True)), float(own[i])
    )


def _neighbour(problem, grid, near, long) -> np.ndarray:
    """The largest distance so far of a trajectory that starts with relative displacements of `SHIFT`, array (n,)."""
    start = np.array([float(x) for x in (*problem.q0, *problem.p0)])
    shifted = start * (1 + SHIFT * (-1.0) ** np.arange(len(start)))
    d = problem.system.d
    other = taylor.states(problem.system, long, shifted[:d], shifted[d:], grid)
    return _upto(np.abs(other - near).max(axis=1).astype(float))


def _growth(grid, apart, size) -> tuple[float, float | None]:
    """(exponent of t over the later three quarters until the neighbour is lost, rate where that is exponential)."""
    lost = np.flatnonzero(apart > LOST * size)
    last = max(1, (lost[0] if len(lost) else len(grid)) - 1)
    first = int(np.searchsorted(grid, grid[last] / 4))
    if first >= last or not apart[first] > 0:
        return float("nan"), None
    gained = float(np.log(apart[last] / apart[first]))
    exponent = gained / float(np.log(grid[last] / grid[first]))
    return exponent, gained / (grid[last] - grid[first]) if exponent > FASTEST else None
