r"""Where an integrator is stable on the harmonic oscillator: all intervals of z = h omega, their ends to ten digits.

Most step maps of the oscillator are linear, y -> M(z) y.  The columns of M are the images of the unit vectors,
`linear_stability` scans its margins, and every end is then refined on the margins without their allowances: there
|tr M| passes 2, or det M passes 1.  Where the trace comes to 2 or -2 and turns back (a double root of tr^2 - 4), no
interval ends: these places are listed as touches, a window of instability whose trace exceeds 2 by less than
`linear_stability.SLACK` among them.

A map that is not linear, or not at every step (a projection, a parameter that is chosen in every step, a step that
keeps more than the state) is judged by long runs: stable where the run ends well and its size stays below `GROWN` times
the first; the end is then known to a part in `SHARPNESS`.

Source: Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), I.5 and IX.3.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np

from phasebench.benchmarks.problems import problem as problem_of
from phasebench.integrators.driver import OK
from phasebench.integrators.engine import kernel
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.prepared import PreparedRun, prepare
from phasebench.integrators.record import Method

from . import linear_stability
from .integrator import Integrator, integrator

PROBLEM = "harmonic-oscillator"
#: Where the second scan of what is stable all through the first one ends, and the distance of its points.
FAR, WIDE = 100.0, 0.25
#: Maps that differ by less than this are the same: of two steps and one taken twice, of a sum and its parts.
SAME = 1e-9
#: A margin is told from round-off at so many units of it, times the square of the matrix's size.
NOISE = 64 * np.finfo(float).eps
#: How far from its first estimate an end is looked for.
NEAR = 1e-3
#: A trace within this of 2 at its turning point touches it.
TOUCH = 1e-9
#: Long runs: their steps, those of the run that is tried first, the growth that they may show, the scan's spacing, how
#: sharp its ends are, after how many points without a stable one it ends.
LONG, FIRST, GROWN, COARSE, SHARPNESS, HOPELESS = 10_000, 100, 10.0, 0.25, 1e-3, 8
#: Steps below this are not looked at.
LEAST = 1e-3
#: Steps z at which a map is asked whether it is linear.
ASKED = (0.3, 0.9)
TRACE, RUNS = "trace of the step map", "long runs"

StepMatrix = Callable[[float], "np.ndarray | None"]


@dataclass(frozen=True)
class Found:
    """Where an integrator is stable.

    Attributes
    ----------
    intervals : pairs (from, to) of z in order; ``to`` is None where the interval goes on to the end of the scan
    touches : where the trace of a linear map comes to 2 or -2 within an interval and turns back
    scanned : how far it was looked
    how : `TRACE` or `RUNS`
    reason : why the scan ended early, or how the first unstable run failed
    """

    intervals: tuple[tuple[float, float | None], ...]
    touches: tuple[float, ...]
    scanned: float
    how: str
    reason: str = ""

    @property
    def limit(self) -> float | None:
        """The end of the interval that begins at 0: 0 where there is none, None where it has no end."""
        return self.intervals[0][1] if self.intervals and self.intervals[0][0] == 0 else 0.0


@lru_cache(maxsize=1)
def _oscillator():
    return problem_of(PROBLEM)


_last: list = [None, None]


def _prepared(record: Method) -> PreparedRun:
    """The method on the oscillator, ready to run; the last one is kept."""
    if _last[0] is not record:
        _last[:] = record, prepare(_oscillator(), record)
    return _last[1]


def end(chosen: Integrator, z: float, steps: int, state=(1.0, 0.0)) -> np.ndarray | None:
    """The state (q, p) after ``steps`` steps of z, whatever it is worth; None where one of them cannot be taken."""
    if isinstance(chosen.record, Method):
        run = _prepared(chosen.record)
        try:
            with np.errstate(all="ignore"):
                q, p, code = run(z, steps, state[:1], state[1:])
        except InvalidInput:  # the method is not defined at this step: a resonance of its filter
            return None
        return None if code == run.STALLED else np.concatenate([q, p])
    s = chosen.run(_oscillator(), h=z, steps=steps, q0=state[:1], p0=state[1:], save_every=0)
    return np.concatenate([s.q[-1], s.p[-1]]) if len(s.t) > 1 else None


def matrix(chosen: Integrator, z: float) -> np.ndarray | None:
    """The matrix of a step, where its map is linear; None where the step cannot be taken."""
    columns = [end(chosen, z, 1, state) for state in ((1.0, 0.0), (0.0, 1.0))]
    return None if any(c is None for c in columns) else np.array(columns).T


def linear(chosen: Integrator) -> bool:
    """Whether the step map is linear and all that goes on from a step to the next is the state.

    A method of this project that may miss what it promises in a step (`Prepared.missed`) has no one step map.
    """
    if isinstance(chosen.record, Method) and kernel.prepare(chosen.record, _oscillator().system).missed:
        return False
    for z in ASKED:
        M = matrix(chosen, z)
        if M is None:
            return True
        other = np.array([0.6, -0.8])
        two, one = end(chosen, z, 2), end(chosen, z, 1, tuple(other))
        if two is None or one is None:
            return False
        if max(np.abs(two - (M @ M)[:, 0]).max(), np.abs(one - M @ other).max()) > SAME:
            return False
    return True


def find(chosen: Integrator) -> Found:
    """Where an integrator is stable on the oscillator; raises InvalidInput for one that cannot integrate it."""
    if chosen.adaptive:
        raise InvalidInput(f"'{chosen.id}' takes a tolerance, no step: it has no stability limit in h")
    lack = chosen.lacks(_oscillator())
    if lack:
        raise InvalidInput(lack)
    if not linear(chosen):
        return of_runs(chosen)
    return of_matrix(lambda z: matrix(chosen, z))


def of_matrix(step_matrix: StepMatrix) -> Found:
    """Where a linear map is stable."""
    known = _remembered(step_matrix)
    pieces, scanned = _pieces(known)
    reason = "" if scanned else "no step can be taken"
    intervals = [
        (a if a == 0 else _sharp(known, a, +1), _sharp(known, b, -1) if b < scanned else None) for a, b in pieces
    ]
    touches = [z for a, b in pieces for z in _touches(known, a, b)]
    return Found(tuple(intervals), tuple(touches), scanned, TRACE, reason)


def _pieces(step_matrix: StepMatrix) -> tuple[list[tuple[float, float]], float]:
    """(the stable intervals, how far it was looked): the scan goes on where the first one ends in a stable interval."""
    first = linear_stability.stability(step_matrix)
    pieces, last = list(first.intervals), linear_stability.LAST
    if not pieces or pieces[-1][1] < last:
        return pieces, first.scanned
    second = linear_stability.stability(step_matrix, FAR, WIDE)
    rest = [(a, b) for a, b in second.intervals if b > last]
    if rest and rest[0][0] < last:
        pieces[-1] = (pieces[-1][0], rest.pop(0)[1])
    return pieces + rest, second.scanned


def _remembered(step_matrix: StepMatrix) -> StepMatrix:
    seen: dict[float, np.ndarray | None] = {}

    def of(z: float) -> np.ndarray | None:
        if z not in seen:
            seen[z] = step_matrix(z)
        return seen[z]

    return of


def _margins(step_matrix: StepMatrix, z: float) -> tuple[np.ndarray, float]:
    """(Jury's margins without allowances, what round-off makes of them)."""
    M = step_matrix(z)
    if M is None or not np.isfinite(M).all():
        return np.full(3, -1.0), 0.0
    trace, det = np.trace(M), M[0, 0] * M[1, 1] - M[0, 1] * M[1, 0]
    return np.array([1 - trace + det, 1 + trace + det, 1 - det]), NOISE * (1 + np.abs(M).max()) ** 2


def _margin(z: float, step_matrix: StepMatrix, i: int) -> float:
    return float(_margins(step_matrix, z)[0][i])


def _sharp(step_matrix: StepMatrix, z: float, inside: int) -> float:
    """The end of an interval near z, which lies on the side ``inside`` of it: the root of the margin that changes."""
    from scipy.optimize import brentq

    away = 1e-9 * z
    while away < NEAR:
        good, noise = _margins(step_matrix, z + inside * away)
        bad, noise_beyond = _margins(step_matrix, z - inside * away)
        changes = np.flatnonzero((good > noise) & (bad < -noise_beyond))
        if len(changes):
            root = brentq(_margin, z - away, z + away, (step_matrix, changes[0]), xtol=1e-14, rtol=1e-14)
            return float(root)
        away *= 4
    return z


def _touches(step_matrix: StepMatrix, a: float, b: float) -> list[float]:
    """Where within (a, b) the trace has an extremum at 2 or -2."""
    from scipy.optimize import minimize_scalar

    def room(z: float) -> float:
        M = step_matrix(z)
        return np.inf if M is None else 2 - abs(np.trace(M))

    points = np.linspace(a, b, max(5, round((b - a) / (linear_stability.SPACING if b < 11 else WIDE))) + 1)[1:-1]
    out = []
    for left, middle, right in zip(points, points[1:], points[2:], strict=False):
        if room(middle) <= min(room(left), room(right)):
            low = minimize_scalar(room, bounds=(left, right), method="bounded", options={"xatol": 1e-10})
            if low.fun < TOUCH and room(left) > TOUCH and room(right) > TOUCH:
                out.append(float(low.x))
    return out


def of_runs(chosen: Integrator) -> Found:
    """Where a map that is not linear stays bounded."""
    why: list[str] = []

    def stays(z: float) -> bool:
        failure = lost(chosen, z, FIRST) or lost(chosen, z, LONG)
        why.extend([failure] if failure else [])
        return not failure

    scan, good = [], []
    while len(scan) < round(linear_stability.LAST / COARSE) and (len(scan) < HOPELESS or any(good[-HOPELESS:])):
        scan.append(COARSE * (len(scan) + 1))
        good.append(stays(scan[-1]))
    ends = [(0.0, scan[0], True, good[0])] + [(*x, *y) for x, y in zip(pairwise(scan), pairwise(good), strict=True)]
    intervals: list[tuple[float, float | None]] = [(0.0, None)]
    for a, b, stable_a, stable_b in ends:
        if stable_a and not stable_b:
            intervals[-1] = (intervals[-1][0], _bisected(stays, a, b))
        elif stable_b and not stable_a:
            intervals.append((_bisected(stays, b, a), None))
    intervals = [x for x in intervals if x[1] is None or x[1] > 0]
    return Found(tuple(intervals), (), scan[-1], RUNS, why[0] if why else "")


def _bisected(stays: Callable[[float], bool], good: float, bad: float) -> float:
    """The last step on the good side; 0 where no step above `LEAST` is good."""
    while abs(bad - good) > max(SHARPNESS * max(bad, good), LEAST):
        middle = (good + bad) / 2
        good, bad = (middle, bad) if stays(middle) else (good, middle)
    return good


def lost(chosen: Integrator, z: float, steps: int) -> str:
    """How a run of ``steps`` steps of z failed: its status, or that it has grown; empty where it did not."""
    s = chosen.run(_oscillator(), h=z, steps=steps, save_every=max(1, steps // 200))
    if s.status != OK:
        return s.status
    return "grown" if max(np.abs(s.q).max(), np.abs(s.p).max()) > GROWN else ""


def row(chosen: Integrator) -> dict:
    """``stability`` as the command and Python give it: None stands for no end."""
    found = find(chosen)
    return {
        "method": chosen.id,
        "params": {k: str(v) for k, v in chosen.record.parameters.items()},
        "limit": found.limit,
        "intervals": [list(x) for x in found.intervals],
        "how": found.how,
        "touches": list(found.touches),
        "scanned": found.scanned,
        "reason": found.reason,
    }


def stability(method, **parameters):
    """All stable intervals of h omega on the harmonic oscillator.

    Parameters
    ----------
    method : the id of a method or of a peer with a fixed step, the path of a file with a step, a method, or a step
    parameters : values of the method's parameters, ``lam=0.5``

    Returns
    -------
    DataFrame
        One row: method, params, limit (None where unlimited, 0 where every step grows), intervals (their last end is
        None where it lies beyond ``scanned``), how, touches, scanned, reason

    Raises
    ------
    InvalidInput
        For an unknown method or parameter, an adaptive peer, or a method that cannot integrate the oscillator.
    """
    import pandas as pd

    return pd.DataFrame([row(integrator(method, **parameters))]).astype(object)
