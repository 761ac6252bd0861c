r"""Measurements of one integrator on one case: order, symplecticity, reversibility, stability, cost, energy.

Every measurement calls `measure.integrator.Integrator.run`: an integrator is a black box (q0, p0, h, n) -> (q, p).  Its
own noise (round-off, the tolerance of a stage solver) is measured with it.  Defects are compared with those of two
controls on the same case: an integrator of proved structure gives the floor, and the classical Runge-Kutta method
shows how large a broken structure is there.

- order: `metrics.order` of the error over a ladder of steps, at most a factor of :math:`\sqrt2` apart except for the
  coarsest; its interval is widened by half of the change of slope inside the window;
- own error: the distance of a run from one at half the step; where it is round-off, a broken structure cannot show;
- symplecticity: :math:`\max|M^TJM - J|`, M the Jacobian of 1 and of 10 steps by `step_map.jacobian` (central
  differences, extrapolated); its floor is the change when the displacement is doubled, or the control's defect;
- reversibility: n steps, the momenta reversed, n steps, reversed again: the distance from the start;
- energy: the largest error, and the slope of `drift` with its interval, over a long run;
- stability: the h omega at which the powers of a step's matrix on the oscillator are bounded (`linear_stability`).

``late(seconds)``, an argument of the measures, is True if less than ``seconds`` of the time for one are left; then no
finer step is tried and no run is repeated.  They return the columns of a row.

Sources: Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), V.1 and VI.2; `benchmarks.metrics`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import lru_cache

import numpy as np

from phasebench.benchmarks.judge.evidence import BROKEN
from phasebench.benchmarks.measure import conservation, linear_stability, metrics, step_map
from phasebench.benchmarks.measure.accuracy import end_state
from phasebench.benchmarks.measure.integrator import Integrator, integrator
from phasebench.integrators.keywords import State
from phasebench.integrators.solution import Solution

from . import cases
from .cases import EPS, Case

#: The ladder of an order: numbers of steps between rows, of which a run has `cases.ROWS`.
LADDER = tuple(sorted({round(2 ** (k / 2)) for k in range(23)}))
#: The ladder ends when the window reaches its finest step with this many points and this half-width.
ENOUGH, SHARP = 6, 0.02
#: Orders closer than this count as equal.
AGREES = 0.1
#: Runs with a relative error above this are on another orbit and do not enter an order.
SATURATED = 0.1
#: Numbers of steps whose Jacobian is computed, and the displacement of its finite differences.
JACOBIAN_STEPS = (1, 10)
DISPLACEMENT = 1e-4
#: Steps forward, and as many back, of the reversibility test.
OUT = 100
#: A broken structure is measured again at this multiple of the step, to see how it falls with h.
SHORTER = 0.5
#: From the order `HIGH` on the step of the structure tests is `LONGER` times that of the case, at which a broken
#: structure may be below round-off.
HIGH, LONGER = 6, 3.0
#: Steps of the energy's run: the most, the fewest if the package makes a claim on the energy, the fewest otherwise;
#: the seconds for which steps are added beyond the fewest; rows that are evaluated.
LONG, SHORT, SHORTEST, LONG_SECONDS, SEEN = 10_000, 1000, 250, 1.0, 1000
#: The time of an adaptive peer's run for the energy, in steps of the case.
ADAPTIVE_SPAN = 2500
TOLERANCES = (1e-6, 1e-9, 1e-12)
#: For a method without stable steps the growth factor is reported at this h omega.
GROWING_AT = 0.5
#: Cost: number of runs, target seconds of one, limit in seconds on all, and the most steps of one.
REPEATS, LASTING, ENOUGH_COST, MOST_STEPS = 5, 0.05, 1.0, 10_000
#: The cost of a method that is unstable at the step of the case is measured at this multiple of it.
TINY = 1e-3
#: Controls proved to be symplectic and reversible, in order of preference; a control that is neither.
SYMPLECTIC = ("stormer-verlet", "implicit-midpoint")
CLASSICAL = "rk4"


class RunFailed(Exception):
    """A run that did not reach its end; args are (status, reason)."""


def run(
    peer: Integrator,
    case: Case,
    h: float,
    steps: int,
    state: tuple[State, State] | None = None,
    every: int = 0,
    tol: float | None = None,
    fine: tuple[str, ...] = ("ok",),
) -> Solution:
    """Integrate a case with a peer and return the solution; raise RunFailed unless its status is one of ``fine``.

    ``state`` (q, p) replaces the case's start; the solution has a row after each ``every`` steps (0: at the end only).
    """
    q, p = cases.start(case) if state is None else state
    try:
        s = peer.run(cases.problem(case), h=h, steps=steps, q0=q, p0=p, save_every=every, tol=tol)
    except Exception as error:  # whatever a package raises is a finding, not the end of the audit
        raise RunFailed("invalid", f"{type(error).__name__}: {(str(error).splitlines() or [''])[0]}") from None
    if s.status not in fine:
        raise RunFailed(s.status, s.reason)
    return s


def order(peer: Integrator, case: Case, late: Callable[..., bool]) -> dict:
    """Measure the order in h, with its interval and the window of steps of the fit."""
    truth = cases.truth(case)
    h, error, why = [], [], ""
    found = metrics.order(h, error)
    below = 0
    for m in LADDER:
        n = m * cases.ROWS
        began = time.monotonic()
        try:
            s = run(peer, case, case.span / n, n, every=m)
            error.append(truth.error(s.q[1:], s.p[1:]))
        except RunFailed as failure:
            why = failure.args[1]
            if failure.args[0] == "skipped":
                raise
            error.append(np.nan)
        h.append(case.span / n)
        found = metrics.order(h, error, truth.noise, SATURATED)
        below = below + 1 if error[-1] <= truth.noise else 0
        sharp = found.points >= ENOUGH and found.last == h[-1] and found.high - found.value <= SHARP
        # If the order differs from the claim, the leading error term may be small and show only at finer steps.
        sharp = sharp and (peer.claims.order is None or abs(found.value - peer.claims.order) < AGREES)
        # The next runs are about 1.4 and 2 times as long.
        if below > 2 or sharp or late(2 * (time.monotonic() - began)):
            break
    if np.isnan(error).all():
        raise RunFailed("diverged", why)
    seen = np.array(error)[np.isfinite(error)]
    found, bend = asymptotic(np.array(h), np.array(error), truth.noise)
    half = found.high - found.value
    if (seen <= truth.noise).all():
        reason = "no asymptotic window: every error is of round-off"
    elif found.points < 3 or not half < AGREES:
        reason = f"no asymptotic window: errors from {seen[0]:.1e} to {seen[-1]:.1e}"
    else:
        reason = ""
    out = {"value": found.value, "low": found.low - bend, "high": found.high + bend} if not reason else {}
    return out | {
        "first": found.first,
        "last": found.last,
        "points": found.points,
        "finest_error": float(seen[-1]),
        "floor": truth.noise,
        "reason": reason,
    }


def asymptotic(h: np.ndarray, error: np.ndarray, noise: float) -> tuple[metrics.Order, float]:
    """Fit the order in the window of steps in which the error falls as a power of h.

    Returns (order with its interval and window, half the difference of the order between the finer and the coarser half
    of the window).
    """
    # At steps finer than that of the least error round-off accumulates; it also affects errors near the least.
    least = int(np.nanargmin(error)) + 1
    if least < len(h):
        noise = max(noise, 10 * error[least - 1])
    h, error = h[:least], error[:least]
    found = metrics.order(h, error, noise, SATURATED)
    usable = np.flatnonzero((error > noise) & (error < SATURATED))
    if len(usable) > ENOUGH:
        # Prefer a good window in the finer half of the steps if its order differs.
        fine = slice(usable[len(usable) // 2], None)
        other = metrics.order(h[fine], error[fine], noise, SATURATED)
        if other.points >= 3 and other.high - other.value < AGREES / 2 and abs(other.value - found.value) > AGREES / 2:
            found = other
    return found, _bend(found, h, error)


def _bend(found: metrics.Order, h: np.ndarray, error: np.ndarray) -> float:
    if found.points < 3:
        return 0.0
    inside = (h <= found.first) & (h >= found.last)
    x, y = np.log(h[inside]), np.log(error[inside])
    half = len(x) // 2
    slopes = [(y[b] - y[a]) / (x[b] - x[a]) for a, b in ((0, half), (half, len(x) - 1))]
    return float(abs(slopes[1] - slopes[0])) / 2


def _map(
    peer: Integrator, case: Case, h: float, steps: int, tol: float | None = None, taken: list | None = None
) -> Callable[[np.ndarray], np.ndarray]:
    """The map of ``steps`` steps on states (2 d,); each call appends the number of steps taken to ``taken``."""
    d = cases.problem(case).system.d

    def flow(y: np.ndarray) -> np.ndarray:
        s = run(peer, case, h, steps, (y[:d], y[d:]), tol=tol)
        if taken is not None:
            taken.append(s.counts["steps"])
        return end_state(s)

    return flow


def _symplectic_defect(peer: Integrator, case: Case, h: float, steps: int) -> tuple[float, float]:
    y = np.concatenate(cases.start(case))
    value, noise = step_map.symplecticity(_map(peer, case, h, steps), y, DISPLACEMENT, 2 * DISPLACEMENT)
    return value, max(noise, EPS * float(np.abs(y).max()) * steps / DISPLACEMENT)


def _reverse_distance(peer: Integrator, case: Case, h: float, steps: int) -> tuple[float, float]:
    """The distance from the start after ``steps`` steps out and back, and the round-off to expect in it."""
    y = np.concatenate(cases.start(case))
    return float(step_map.reversibility_defect(_map(peer, case, h, steps), y)), EPS * float(np.abs(y).max()) * steps


MEASURED = {"symplecticity": _symplectic_defect, "reversibility": _reverse_distance}


@lru_cache(maxsize=256)
def _controls(measure: str, case: Case, h: float, steps: int) -> tuple[float, float]:
    """The defects of a symplectic, reversible method, which is the floor, and of the classical Runge-Kutta method."""
    known = next(c for c in map(integrator, SYMPLECTIC) if cases.able(c, (case,)))
    return max(MEASURED[measure](known, case, h, steps)), MEASURED[measure](integrator(CLASSICAL), case, h, steps)[0]


def _structure(measure: str, peer: Integrator, case: Case, steps: int) -> dict:
    """A defect over ``steps`` steps, its floor, that of RK4, the integrator's own error; if broken, its order."""
    h, high = case.h, max(peer.order or 0, peer.claims.order or 0) >= HIGH
    try:
        h = LONGER * case.h if high else case.h
        value, noise = MEASURED[measure](peer, case, h, steps)
        _controls(measure, case, h, steps)
    except RunFailed as failure:
        if failure.args[0] == "skipped" or not high:
            raise
        h = case.h
        value, noise = MEASURED[measure](peer, case, h, steps)
    known, classical = _controls(measure, case, h, steps)
    own = np.abs(end_state(run(peer, case, h, steps)) - end_state(run(peer, case, h / 2, 2 * steps))).max()
    out = {
        "value": value,
        "floor": max(noise, known),
        "classical": classical,
        "own": float(own),
        "steps": steps,
        "h": h,
    }
    if value > BROKEN * out["floor"]:
        shorter = MEASURED[measure](peer, case, SHORTER * h, steps if measure == "symplecticity" else 2 * steps)[0]
        if shorter > 0:
            out["falls_as"] = float(np.log(value / shorter) / np.log(1 / SHORTER))
    return out


def symplecticity(peer: Integrator, case: Case, late: Callable[..., bool]) -> dict:
    """Measure the symplecticity defect of 1 and of 10 steps; return the one that shows more."""
    rows = []
    for steps in JACOBIAN_STEPS:
        rows.append(_structure("symplecticity", peer, case, steps))
        if late():
            break
    broken = any("falls_as" in r for r in rows)
    worst = max(rows, key=lambda r: r["value" if broken else "classical"] / r["floor"])
    return worst | {f"defect_{r['steps']}": r["value"] for r in rows}


def reversibility(peer: Integrator, case: Case, late: Callable[..., bool]) -> dict:
    """Measure the distance from the start after steps out and back; for fixed steps also in ``units`` of round-off."""
    if peer.adaptive:
        tol, taken = _tolerances(peer)[1], []
        flow = _map(peer, case, case.h, OUT, tol, taken)
        away = float(step_map.reversibility_defect(flow, np.concatenate(cases.start(case))))
        return {"value": away, "tol": tol, "h": case.h, "steps": taken[0], "bitwise": False}
    out = _structure("reversibility", peer, case, OUT)
    unit = EPS * float(np.abs(cases.start(case)).max())
    return out | {"bitwise": out["value"] == 0, "units": out["value"] / (unit * 2 * OUT)}


def _tolerances(peer: Integrator) -> list[float]:
    """`TOLERANCES`, each raised to the least that a peer accepts."""
    return [max(t, peer.record.least) for t in TOLERANCES]


def energy(peer: Integrator, case: Case, late: Callable[..., bool]) -> dict:
    """Measure the largest error of H and the slope of its drift, on one run as long as `LONG_SECONDS` allow."""
    system = cases.problem(case).system
    tol = None
    if peer.adaptive:
        rows, every = SEEN, 1
        h = case.h * ADAPTIVE_SPAN / rows
        tol = None if peer.claims.energy else _tolerances(peer)[1]
    else:
        h, trial = case.h, run(peer, case, case.h, 100)
        affordable = int(LONG_SECONDS * 100 / max(trial.seconds, 1e-9))
        steps = min(LONG, max(affordable, SHORT if peer.claims.energy else SHORTEST))
        rows = min(SEEN, steps)
        every = steps // rows
    s = run(peer, case, h, rows * every, every=every, tol=tol)
    return conservation.energy(system, s.t, s.q, s.p)[1] | {
        "steps": int(s.counts["steps"] or len(s.t)),
        "h": h,
        "tol": tol,
    }


def _matrix(peer: Integrator, case: Case, h: float, steps: int = 1) -> np.ndarray:
    """The matrix of ``steps`` steps, stable or not, on a linear system of d = 1."""
    starts = (([1.0], [0.0]), ([0.0], [1.0]))
    return np.array([end_state(run(peer, case, h, steps, s, fine=("ok", "inaccurate", "unstable"))) for s in starts]).T


def stability(peer: Integrator, case: Case, late: Callable[..., bool]) -> dict:
    """Find the intervals of h omega in which the steps on the oscillator are stable; ``value``: the first end."""
    end = ""

    def step_matrix(h: float) -> np.ndarray | None:
        nonlocal end
        if late():
            end = "the budget"
            return None
        try:
            return _matrix(peer, case, h)
        except RunFailed as failure:
            if failure.args[0] in ("skipped", "invalid"):
                raise
            end = failure.args[1]
            return None

    one, two = (_matrix(peer, case, GROWING_AT, n) for n in (1, 2))
    if not linear_stability.is_square(one, two):
        raise RunFailed("skipped", "it keeps more than the state between steps: two steps are not one taken twice")
    found = linear_stability.stability(step_matrix)
    return {
        "value": found.scanned if found.limit is None else found.limit,
        "unconditional": found.limit is None and not end,
        "scanned": found.scanned,
        "intervals": " ".join(f"{a:.7g}..{b:.7g}" for a, b in found.intervals),
        "grows": linear_stability.radius(one) - 1,
        "reason": f"scanned to {found.scanned:.4g}: {end}" if end else "",
    }


def cost(peer: Integrator, case: Case, late: Callable[..., bool]) -> dict:
    """Measure the microseconds of a step (``value``; NaN if a peer does not count steps) and of a unit of time."""
    h, steps, tol = case.h, 100, _tolerances(peer)[1] if peer.adaptive else None
    try:
        s = run(peer, case, h, steps, tol=tol)
        if not peer.adaptive and s.seconds < ENOUGH_COST / 200:
            s = run(peer, case, h, 100 * steps, tol=tol)
            steps *= 100
    except RunFailed:  # an unstable method: its steps cost what shorter ones do
        h *= TINY
        s = run(peer, case, h, steps, tol=tol)
    steps = min(MOST_STEPS, max(1, round(steps * LASTING / max(s.seconds, 1e-6))))
    seconds = []
    for _ in range(REPEATS):
        s = run(peer, case, h, steps, tol=tol)
        seconds.append(s.seconds)
        if late() or sum(seconds) > ENOUGH_COST:
            break
    taken, evaluations = s.counts["steps"], s.counts["gradient"]
    per_step = float(np.median(seconds)) / taken * 1e6 if taken else np.nan
    return {
        "value": per_step,
        "per_time": float(np.median(seconds)) / (h * steps) * 1e6,
        "evaluations": evaluations / taken if taken and evaluations else np.nan,
        "steps": taken,
        "h": h,
        "tol": tol,
    }


def tolerance(peer: Integrator, case: Case, late: Callable[..., bool]) -> dict:
    """Measure an adaptive peer's largest relative error over the case's span at each of `_tolerances`."""
    truth, out = cases.truth(case), {}
    for tol in dict.fromkeys(_tolerances(peer)):
        s = run(peer, case, case.span / cases.ROWS, cases.ROWS, every=1, tol=tol)
        out[f"error_{tol:.0e}"] = truth.error(s.q[1:], s.p[1:])
        out |= {"value": out[f"error_{tol:.0e}"], "tol": tol, "steps": s.counts["steps"]}
        if late():
            break
    return out | {"floor": truth.noise}


FIXED = {f.__name__: f for f in (order, symplecticity, reversibility, energy, stability, cost)}
ADAPTIVE = {f.__name__: f for f in (tolerance, reversibility, energy, cost)}
