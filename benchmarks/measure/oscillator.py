r"""Stability of an integrator on the harmonic oscillator: all intervals of z = h omega, with ends to ten digits.

Most step maps of the oscillator are linear, y -> M(z) y.  The columns of M are the images of the unit vectors.
`linear_stability` finds the intervals from Jury's stability margins of M, with an allowance for round-off; each end is
then refined without that allowance: there |tr M| passes 2, or det M passes 1.  If the trace reaches 2 or -2 and turns
back (a double root of tr^2 - 4), no interval ends; such places are listed as touches.  A window of instability whose
trace exceeds 2 by less than `linear_stability.SLACK` counts as a touch too.

A map that is not linear (a projection, a parameter chosen in every step), or whose steps depend on more than the state,
is judged by long runs: stable if the run ends well and the state stays below `GROWN` times the initial size.  Ends are
then known to the relative accuracy `SHARPNESS`.

A method that requires constraints is judged on the oscillator in the plane that is bound to a line: with linear
constraints it is a method for the motion within them.

The stable steps of a multistep method follow from the roots x of rho(x) + (h omega)^2 sigma(x), in closed form
(`coefficients.multistep`); long runs just below and just above the limit are made to confirm it.

Source: Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), I.5 and IX.3.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from phasebench.benchmarks.problems import problem as problem_of
from phasebench.benchmarks.problems.base import Orbit, Problem
from phasebench.integrators.coefficients.multistep import Multistep, stable_intervals
from phasebench.integrators.driver import OK
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.keywords import Parameters, method_parameters
from phasebench.integrators.prepared import PreparedRun, prepare
from phasebench.integrators.record import Method
from phasebench.integrators.stepping import kernel
from phasebench.integrators.systems.constrained import ConstrainedHamiltonian
from phasebench.reference.peers import Peer

from . import linear_stability
from .integrator import Integrator, integrator, parameters_of
from .own_step import Step
from .tabular import TabularResult

if TYPE_CHECKING:
    import pandas as pd

PROBLEM = "harmonic-oscillator"
#: End and spacing of a second scan, made if the map is stable up to the end of the first one.
FAR, WIDE = 100.0, 0.25
#: Largest difference between equal maps: two steps against the matrix squared, a sum against its parts.
SAME = 1e-9
#: Round-off of a margin, relative to the square of the matrix's size.
NOISE = 64 * np.finfo(float).eps
#: Largest distance of an end from its first estimate; that of a triple root is some 1e-3.
NEAR = 0.02
#: The trace touches 2 if its turning point is this close; at this distance in z it is told from 2.
TOUCH, BESIDE_TOUCH = 1e-9, 1e-3
#: Long runs: their steps, the steps of a first shorter run, the permitted growth, the spacing of the scan, the accuracy
#: of ends, and the number of unstable points in a row after which the scan stops.
LONG, FIRST, GROWN, COARSE, SHARPNESS, HOPELESS = 10_000, 100, 10.0, 0.25, 1e-3, 8
#: Least step that is tested.
LEAST = 1e-3
#: Steps z at which the map is tested for linearity.
ASKED = (0.3, 0.9)
#: States whose images show the noise of a step's matrix.
STATES = ((0.6, -0.8), (0.8, 0.6))
TRACE, RUNS = "trace of the step map", "long runs"
ROOTS = "closed form: the roots of rho(z) + (h omega)^2 sigma(z)"
#: Relative distance from a multistep method's limit at which long runs are made.
BESIDE = 1e-3

StepMatrix = Callable[[float], "np.ndarray | None"]


@dataclass(frozen=True)
class Found:
    """The stable steps z = h omega of an integrator on the harmonic oscillator, as the search found them.

    Attributes
    ----------
    intervals : pairs (from, to) of z in order; ``to`` is None if the interval reaches the end of the scan, ``scanned``
    touches : values of z inside an interval at which the trace of a linear map reaches 2 or -2 and turns back
    how : how stability was decided, in words: `TRACE` of the step's matrix, long `RUNS`, or `ROOTS` of polynomials
    reason : why the scan ended early, how the first unstable run failed, or how runs beside a known limit ended; or ""
    """

    intervals: tuple[tuple[float, float | None], ...]
    touches: tuple[float, ...]
    scanned: float
    how: str
    reason: str = ""

    @property
    def limit(self) -> float | None:
        """The end of the stable interval that begins at z = 0; 0 if none begins there, None if it has no known end."""
        return self.intervals[0][1] if self.intervals and self.intervals[0][0] == 0 else 0.0


@lru_cache(maxsize=1)
def _on_a_line() -> Problem:
    """Make the oscillator in the plane with the constraint x = y, for methods that require constraints."""
    H = "(u**2 + v**2 + x**2 + y**2)/2"
    system = ConstrainedHamiltonian(q="x y", p="u v", H=H, constraints=["x - y"])
    return Problem(PROBLEM, PROBLEM, "", system, (Orbit("start", (1.0, 1.0), (0.0, 0.0)),))


def _problem(chosen: Integrator) -> tuple[Any, np.ndarray]:
    """Return (the oscillator, the unit vector (d,) along which it moves), constrained if the integrator needs that."""
    if "constrained" in getattr(chosen.record, "requires", ()):
        return _on_a_line(), np.full(2, 0.5**0.5)
    return problem_of(PROBLEM), np.ones(1)


_last: list = [None, None]


def _prepare(record: Method, problem: Any) -> PreparedRun:
    """Return a method's prepared (compiled) run on the oscillator; that of the last method is cached."""
    if _last[0] is not record:
        _last[:] = record, prepare(problem, record)
    return _last[1]


def end(chosen: Integrator, z: float, steps: int, state: Sequence[float] = (1.0, 0.0)) -> np.ndarray | None:
    """Return the oscillator's state (q, p), array (2,), to which ``steps`` steps z = h omega lead from ``state``.

    The result may be infinite or NaN; it is None if a step fails.
    """
    problem, way = _problem(chosen)
    q, p = state[0] * way, state[1] * way
    if isinstance(chosen.record, Method):
        run = _prepare(chosen.record, problem)
        try:
            with np.errstate(all="ignore"):
                q, p, code = run(z, steps, q, p)
        except InvalidInput:  # the method is not defined at this step (a resonance of its filter)
            return None
        return None if code == run.STALLED else np.array([q @ way, p @ way])
    s = chosen.run(problem, h=z, steps=steps, q0=q, p0=p, save_every=0)
    return np.array([s.q[-1] @ way, s.p[-1] @ way]) if len(s.t) > 1 else None


def matrix(chosen: Integrator, z: float) -> np.ndarray | None:
    """Return the matrix (2, 2) of a step z = h omega on the oscillator, if it is linear; None if the step fails."""
    columns = [end(chosen, z, 1, state) for state in ((1.0, 0.0), (0.0, 1.0))]
    return None if any(c is None for c in columns) else np.array(columns).T


def linear(chosen: Integrator) -> bool:
    """True if a step on the oscillator is a linear map of the state alone, so that its matrix decides.

    False for a method that may replace a failed step by a simpler one, which does not conserve what the method claims.
    """
    if isinstance(chosen.record, Method) and kernel.prepare(chosen.record, _problem(chosen)[0].system).missed:
        return False
    for z in ASKED:
        M = matrix(chosen, z)
        if M is None:
            return True
        two, one = end(chosen, z, 2), end(chosen, z, 1, STATES[0])
        if two is None or one is None:
            return False
        size = max(1.0, np.abs(M).max())  # large beside a pole of the trace
        if np.abs(two - (M @ M)[:, 0]).max() > SAME * size**2 or np.abs(one - M @ STATES[0]).max() > SAME * size:
            return False
    return True


def find(chosen: Integrator) -> Found:
    """Find the stable steps z = h omega of an integrator on the oscillator.

    A linear map is judged by its matrix, a multistep method by the roots of its polynomials, others by long runs.
    Raises InvalidInput if it is adaptive or cannot integrate the oscillator.
    """
    if chosen.adaptive:
        raise InvalidInput(f"'{chosen.id}' takes a tolerance, no step: it has no stability limit in h")
    lack = chosen.lacks(_problem(chosen)[0])
    if lack:
        raise InvalidInput(lack)
    if not getattr(chosen.record, "one_step", True):
        return of_roots(chosen)
    if not linear(chosen):
        return of_runs(chosen)
    return of_matrix(lambda z: matrix(chosen, z), lambda z: noise(chosen, z))


def noise(chosen: Integrator, z: float) -> float:
    """Return the error of the entries of a step matrix M at z, 0 if a step fails: the distance of M y from a step of y.

    It is round-off, except where the substeps of an implicit step amplify the error of its solver.
    """
    M = matrix(chosen, z)
    images = [end(chosen, z, 1, state) for state in STATES]
    if M is None or any(y is None for y in images):
        return 0.0
    return float(max(np.abs(y - M @ state).max() for y, state in zip(images, STATES, strict=True)))


def of_matrix(step_matrix: StepMatrix, noise: Callable[[float], float] = lambda z: 0.0) -> Found:
    """Find the stable steps of a linear map z -> matrix (2, 2), None if a step fails; ``noise``: z -> its error."""
    known = _cache_matrices(step_matrix)
    pieces, scanned = _pieces(known, noise)
    reason = "" if scanned else "no step can be taken"
    ends = {
        (a, b): (a if a == 0 else _sharp(known, a, +1), _sharp(known, b, -1) if b < scanned else None)
        for a, b in pieces
    }
    # Beside a pole of the trace the allowance for round-off alone makes an interval: its ends pass one another.
    intervals = {piece: (a, b) for piece, (a, b) in ends.items() if b is None or a < b}
    touches = [z for a, b in intervals for z in _touches(known, a, b)]
    return Found(tuple(intervals.values()), tuple(touches), scanned, TRACE, reason)


def _pieces(step_matrix: StepMatrix, noise: Callable[[float], float]) -> tuple[list[tuple[float, float]], float]:
    """(Stable intervals, end of the scan), to scan accuracy; stable up to its end, a longer one follows."""
    first = linear_stability.stability(step_matrix, noise=noise)
    pieces, last = list(first.intervals), linear_stability.LAST
    if not pieces or pieces[-1][1] < last:
        return pieces, first.scanned
    second = linear_stability.stability(step_matrix, FAR, WIDE, noise)
    rest = [(a, b) for a, b in second.intervals if b > last]
    if rest and rest[0][0] < last:
        pieces[-1] = (pieces[-1][0], rest.pop(0)[1])
    return pieces + rest, second.scanned


def _cache_matrices(step_matrix: StepMatrix) -> StepMatrix:
    seen: dict[float, np.ndarray | None] = {}

    def of(z: float) -> np.ndarray | None:
        if z not in seen:
            seen[z] = step_matrix(z)
        return seen[z]

    return of


def _margins(step_matrix: StepMatrix, z: float) -> tuple[np.ndarray, float]:
    """Return (Jury's three stability margins of the matrix at z, array (3,); a bound of their round-off)."""
    M = step_matrix(z)
    if M is None or not np.isfinite(M).all():
        return np.full(3, -1.0), 0.0
    return linear_stability.jury(M), NOISE * (1 + np.abs(M).max()) ** 2


def _margin(z: float, step_matrix: StepMatrix, i: int) -> float:
    return float(_margins(step_matrix, z)[0][i])


def _sharp(step_matrix: StepMatrix, z: float, inside: int) -> float:
    """The root of the margin that changes sign near z, or z; ``inside`` is +1 if larger z are stable, else -1."""
    from scipy.optimize import brentq

    away = 1e-9 * z
    while away < NEAR:
        good, noise = _margins(step_matrix, z + inside * away)
        bad, noise_beyond = _margins(step_matrix, z - inside * away)
        changes = np.flatnonzero((good > noise) & (bad < -noise_beyond))
        if len(changes):
            margin = partial(_margin, step_matrix=step_matrix, i=changes[0])
            root = brentq(margin, z - away, z + away, xtol=1e-14, rtol=1e-14)
            return linear_stability.multiple_root(margin, float(root), 2 * away)
        away *= 4
    return z


def _touches(step_matrix: StepMatrix, a: float, b: float) -> list[float]:
    """Return the values of z in (a, b) at which the trace of the step matrix has an extremum at 2 or -2."""
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
                out.append(linear_stability.multiple_root(room, float(low.x), BESIDE_TOUCH))
    return out


def of_runs(chosen: Integrator) -> Found:
    """Find the steps z at which an integrator stays bounded by long runs, for maps that are not linear."""
    why: list[str] = []

    def stays(z: float) -> bool:
        failure = failure_of_run(chosen, z, FIRST) or failure_of_run(chosen, z, LONG)
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
            intervals[-1] = (intervals[-1][0], _bisect(stays, a, b))
        elif stable_b and not stable_a:
            intervals.append((_bisect(stays, b, a), None))
    intervals = [x for x in intervals if x[1] is None or x[1] > 0]
    return Found(tuple(intervals), (), scan[-1], RUNS, why[0] if why else "")


def of_roots(chosen: Integrator) -> Found:
    """Find the stable steps of a multistep method from the roots of rho(x) + z^2 sigma(x), and run beside it."""
    intervals = tuple(stable_intervals(Multistep(*chosen.record.data)))
    limit = intervals[0][1] if intervals else 0.0
    ends = []
    for z in (limit * (1 - BESIDE), limit * (1 + BESIDE)):
        ends.append(f"{failure_of_run(chosen, z, LONG) or 'bounded'} at {z:.6g}")
    return Found(intervals, (), FAR, ROOTS, f"runs of {LONG} steps: {', '.join(ends)}")


def _bisect(stays: Callable[[float], bool], good: float, bad: float) -> float:
    """The last stable step between ``good`` and ``bad``, to the relative accuracy `SHARPNESS`, or `LEAST`."""
    while abs(bad - good) > max(SHARPNESS * max(bad, good), LEAST):
        middle = (good + bad) / 2
        good, bad = (middle, bad) if stays(middle) else (good, middle)
    return good


def failure_of_run(chosen: Integrator, z: float, steps: int) -> str:
    """Return how a run failed: its status, "grown" beyond `GROWN` times the initial size, or ""."""
    s = chosen.run(_problem(chosen)[0], h=z, steps=steps, save_every=max(1, steps // 200))
    if s.status != OK:
        return s.status
    return "grown" if max(np.abs(s.q).max(), np.abs(s.p).max()) > GROWN else ""


@dataclass(frozen=True, repr=False, kw_only=True)
class Stability(TabularResult, Found):
    """The stable steps of a method, its id, with the values of its parameters: as they were `Found`, and as a table."""

    method: str
    parameters: Mapping[str, str]

    def row(self) -> dict[str, Any]:
        """Return it as a dict for JSON, the output of ``phasebench stability``; ``params`` has the parameters."""
        return {
            "method": self.method,
            "params": dict(self.parameters),
            "limit": self.limit,
            "intervals": [list(x) for x in self.intervals],
            "how": self.how,
            "touches": list(self.touches),
            "scanned": self.scanned,
            "reason": self.reason,
        }

    def to_frame(self) -> pd.DataFrame:
        """Return a DataFrame of one row, the columns of `row`."""
        import pandas as pd

        return pd.DataFrame([self.row()]).astype(object)

    def _heading(self) -> list[str]:
        values = ", ".join(f"{k}={v}" for k, v in self.parameters.items())
        limit = f"none up to {self.scanned:g}" if self.limit is None else f"{self.limit:.10g}"
        line = f"{self.method}{f'({values})' if values else ''}: limit of h omega {limit} ({self.how})"
        return [line, *([self.reason] if self.reason else [])]

    def _printed(self) -> pd.DataFrame:
        import pandas as pd

        ends = [(f"{a:.10g}", "beyond" if b is None else f"{b:.10g}") for a, b in self.intervals]
        return pd.DataFrame(ends, columns=["stable from", "to"])


@method_parameters(parameters_of)
def stability(
    method: str | Path | Method | Peer | Integrator | Step, *, parameters: Parameters | None = None
) -> Stability:
    """Find all intervals of z = h omega in which a method is stable on the harmonic oscillator.

    Parameters
    ----------
    method : the id of a method or of a peer with a fixed step, the path of a file with a step, a method, or a step
    parameters : values of the method's parameters, ``{"lam": "1/3"}``

    Returns
    -------
    Stability
        The intervals, the stability limit, and how they were found.

    Raises
    ------
    InvalidInput
        For an unknown method or parameter, an adaptive peer, or a method that cannot integrate the oscillator.
    """
    chosen = integrator(method, parameters=parameters)
    values = {k: str(v) for k, v in chosen.record.parameters.items()}
    return Stability(**vars(find(chosen)), method=chosen.id, parameters=values)
