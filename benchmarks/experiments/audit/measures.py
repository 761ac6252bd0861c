r"""What is measured of one integrator on one case: order, symplecticity, reversibility, stability, cost, energy.

Everything goes through `measure.integrator.Integrator.run`: an integrator is a black box (q0, p0, h, n) -> (q, p).  Its
own noise (round-off, a stage solver's tolerance) is measured with it, and integrators of this project whose structure
is proved run through the same functions on the same case: what they show is the floor, and what the classical
Runge-Kutta method shows is what there is to see.

- order: `metrics.order` of the error over a ladder of steps, at most a factor of :math:`\sqrt2` apart but for the
  coarsest; its interval is widened by half of what the slope changes inside the window;
- own error, of the runs that show a structure or not: their distance from runs at half the step;
- symplecticity: :math:`\max|M^TJM - J|`, M the Jacobian of 1 and of 10 steps by `metrics.jacobian` (central
  differences, extrapolated); its floor is what doubling the displacement changes, or the floor of the control;
- reversibility: n steps, the momenta reversed, n steps, reversed again: the distance from the start;
- energy: the largest error, and the slope of `drift` with its interval, over a long run;
- stability: where the powers of the matrix of a step on the harmonic oscillator stay bounded (`linear_stability`).

Sources: Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), V.1 and VI.2; `benchmarks.metrics`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import lru_cache

import numpy as np

from phasebench.benchmarks.certificate.evidence import BROKEN
from phasebench.benchmarks.measure import linear_stability, metrics
from phasebench.benchmarks.measure.accuracy import end_state
from phasebench.benchmarks.measure.drift import drift
from phasebench.benchmarks.measure.integrator import integrator

from . import cases
from .cases import EPS, Case

#: Twice these are the steps of an order's ladder.
LADDER = tuple(sorted({round(2 ** (k / 2)) for k in range(23)}))
#: A window that reaches the newest point with so many points and this half-width needs no finer steps.
ENOUGH, SHARP = 6, 0.02
#: Orders this near to one another are the same.
AGREES = 0.1
#: Relative errors above this are of another orbit.
SATURATED = 0.1
#: The steps whose Jacobian is taken, and the displacements of the differences.
JACOBIAN_STEPS = (1, 10)
DISPLACEMENT = 1e-4
#: Steps out, and as many back.
OUT = 100
#: Multiples of the step at which a broken structure is looked at again: does it get better as the step falls?
SHORTER = 0.5
#: Integrators of so high an order have their structure looked at with a step so many times as long: at the step of the
#: case what is broken may be below round-off.
HIGH, LONGER = 6, 3.0
#: Steps of the energy's run: most, least where the package claims how the energy is kept, least otherwise; the seconds
#: that more than these may take, and the rows that are looked at.
LONG, SHORT, SHORTEST, LONG_SECONDS, SEEN = 10_000, 1000, 250, 1.0, 1000
#: The time of an adaptive peer's run for the energy, in steps of the case.
ADAPTIVE_SPAN = 2500
TOLERANCES = (1e-6, 1e-9, 1e-12)
#: Stability: the matrix of two steps is the square of that of one up to this, else more than the state is kept.
SQUARE = 1e-9
#: Where no step is stable, what a step multiplies by is said for this one.
GROWING_AT = 0.5
#: Cost: repeats, the seconds that one of them should last, those that all of them may, and the most steps.
REPEATS, LASTING, ENOUGH_COST, MOST_STEPS = 5, 0.05, 1.0, 10_000
#: Where a method is unstable at the step of the case, its cost is measured at this part of it.
TINY = 1e-3
#: Its structure and its floor are known by proof; Stormer-Verlet where it can, else the midpoint rule.
SYMPLECTIC = ("stormer-verlet", "implicit-midpoint")
CLASSICAL = "rk4"


class Failed(Exception):
    """A run that did not end; its first argument is the status, its second the reason."""


def never(seconds: float = 0.0) -> bool:
    """Whether a further run of ``seconds`` would exceed the budget, where there is none."""
    return False


def run(peer, case: Case, h: float, steps: int, state=None, every: int = 0, tol=None, fine=("ok",)):
    """A run that ended well, its status one of ``fine``; raises Failed."""
    q, p = cases.start(case) if state is None else state
    try:
        s = peer.run(cases.problem(case), h=h, steps=steps, q0=q, p0=p, save_every=every, tol=tol)
    except Exception as error:  # whatever a package raises is a finding, not the end of the audit
        raise Failed("invalid", f"{type(error).__name__}: {str(error).splitlines()[0] if str(error) else ''}") from None
    if s.status not in fine:
        raise Failed(s.status, s.reason)
    return s


def _high(peer) -> bool:
    """Whether the order is high, as far as is said."""
    return max(peer.order or 0, peer.claims.order or 0) >= HIGH


def order(peer, case: Case, late: Callable[..., bool] = never) -> dict:
    """The order in h, with its interval and window."""
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
        except Failed as failure:
            why = failure.args[1]
            if failure.args[0] == "skipped":
                raise
            error.append(np.nan)
        h.append(case.span / n)
        found = metrics.order(h, error, truth.noise, SATURATED)
        below = below + 1 if error[-1] <= truth.noise else 0
        sharp = found.points >= ENOUGH and found.last == h[-1] and found.high - found.value <= SHARP
        # Where the claim is not what comes out, the leading term may be small and show at finer steps alone.
        sharp = sharp and (peer.claims.order is None or abs(found.value - peer.claims.order) < AGREES)
        # The next runs are about 1.4 and 2 times as long.
        if below > 2 or sharp or late(2 * (time.monotonic() - began)):
            break
    if np.isnan(error).all():
        raise Failed("diverged", why)
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


def asymptotic(h, error, noise: float):
    """(order, by how much it changes inside its window), h falling."""
    # Steps beyond that of the least error show how round-off adds up, and errors near it are touched by that.
    least = int(np.nanargmin(error)) + 1
    if least < len(h):
        noise = max(noise, 10 * error[least - 1])
    h, error = h[:least], error[:least]
    found = metrics.order(h, error, noise, SATURATED)
    usable = np.flatnonzero((error > noise) & (error < SATURATED))
    if len(usable) > ENOUGH:
        # A window of coarse steps gives way to a good one of the finer half that says otherwise.
        fine = slice(usable[len(usable) // 2], None)
        other = metrics.order(h[fine], error[fine], noise, SATURATED)
        if other.points >= 3 and other.high - other.value < AGREES / 2 and abs(other.value - found.value) > AGREES / 2:
            found = other
    return found, _bend(found, h, error)


def _bend(found, h, error) -> float:
    """By how much the order changes inside its window: the slope of its finer half less that of its coarser one."""
    if found.points < 3:
        return 0.0
    inside = (h <= found.first) & (h >= found.last)
    x, y = np.log(h[inside]), np.log(error[inside])
    half = len(x) // 2
    slopes = [(y[b] - y[a]) / (x[b] - x[a]) for a, b in ((0, half), (half, len(x) - 1))]
    return float(abs(slopes[1] - slopes[0])) / 2


def _map(peer, case: Case, h: float, steps: int):
    d = cases.problem(case).system.d

    def flow(y):
        return end_state(run(peer, case, h, steps, (y[:d], y[d:])))

    return flow


def _symplectic_defect(peer, case: Case, h: float, steps: int) -> tuple[float, float]:
    """(defect, its noise) of ``steps`` steps."""
    flow, y = _map(peer, case, h, steps), np.concatenate(cases.start(case))
    defects = []
    for delta in (DISPLACEMENT, 2 * DISPLACEMENT):
        M = metrics.jacobian(flow, y, delta)
        J = np.kron(np.array([[0, 1], [-1, 0]]), np.eye(len(y) // 2))
        defects.append(M.T @ J @ M - J)
    rounding = EPS * float(np.abs(y).max()) * steps / DISPLACEMENT
    return float(np.abs(defects[0]).max()), max(float(np.abs(defects[1] - defects[0]).max()), rounding)


def _out_and_back(peer, case: Case, h: float, steps: int, tol=None) -> tuple[float, int]:
    """(distance from the start after ``steps`` steps out and back, the peer's own steps out)."""
    q, p = cases.start(case)
    there = run(peer, case, h, steps, tol=tol)
    back = run(peer, case, h, steps, (there.q[-1], -there.p[-1]), tol=tol)
    return float(max(np.abs(back.q[-1] - q).max(), np.abs(back.p[-1] + p).max())), there.counts["steps"]


def _reverse_distance(peer, case: Case, h: float, steps: int) -> tuple[float, float]:
    """(distance from the start after ``steps`` steps out and back, half a unit of round-off for each of these)."""
    size = float(np.abs(cases.start(case)).max())
    return _out_and_back(peer, case, h, steps)[0], EPS * size * steps


MEASURED = {"symplecticity": _symplectic_defect, "reversibility": _reverse_distance}


@lru_cache(maxsize=256)
def _controls(measure: str, case: Case, h: float, steps: int) -> tuple[float, float]:
    """(the floor that a symplectic and reversible method shows, what the classical Runge-Kutta method shows)."""
    known = next(c for c in map(integrator, SYMPLECTIC) if list(cases.able(c, (case,))))
    return max(MEASURED[measure](known, case, h, steps)), MEASURED[measure](integrator(CLASSICAL), case, h, steps)[0]


def _own_error(peer, case: Case, h: float, steps: int) -> float:
    """How far ``steps`` steps end from twice as many of half the size: where that is round-off, so is every defect."""
    return float(np.abs(end_state(run(peer, case, h, steps)) - end_state(run(peer, case, h / 2, 2 * steps))).max())


def _structure(measure: str, peer, case: Case, steps: int) -> dict:
    h, high = case.h, _high(peer)
    try:
        h = LONGER * case.h if high else case.h
        value, noise = MEASURED[measure](peer, case, h, steps)
        _controls(measure, case, h, steps)
    except Failed as failure:
        if failure.args[0] == "skipped" or not high:
            raise
        h = case.h
        value, noise = MEASURED[measure](peer, case, h, steps)
    known, classical = _controls(measure, case, h, steps)
    own = _own_error(peer, case, h, steps)
    out = {"value": value, "floor": max(noise, known), "classical": classical, "own": own, "steps": steps, "h": h}
    if value > BROKEN * out["floor"]:
        shorter = MEASURED[measure](peer, case, SHORTER * h, steps if measure == "symplecticity" else 2 * steps)[0]
        if shorter > 0:
            out["falls_as"] = float(np.log(value / shorter) / np.log(1 / SHORTER))
    return out


def symplecticity(peer, case: Case, late: Callable[..., bool] = never) -> dict:
    """The defect of 1 and of 10 steps: the row is of the one further above its floor, or where most could be seen."""
    rows = []
    for steps in JACOBIAN_STEPS:
        rows.append(_structure("symplecticity", peer, case, steps))
        if late():
            break
    broken = any("falls_as" in r for r in rows)
    worst = max(rows, key=lambda r: r["value" if broken else "classical"] / r["floor"])
    return worst | {f"defect_{r['steps']}": r["value"] for r in rows}


def reversibility(peer, case: Case, late: Callable[..., bool] = never) -> dict:
    """The distance from the start, whether it is 0, and in units of round-off times steps."""
    if peer.adaptive:
        tol = _tolerances(peer)[1]
        away, steps = _out_and_back(peer, case, case.h, OUT, tol)
        return {"value": away, "tol": tol, "h": case.h, "steps": steps, "bitwise": False}
    out = _structure("reversibility", peer, case, OUT)
    unit = EPS * float(np.abs(cases.start(case)).max())
    return out | {"bitwise": out["value"] == 0, "units": out["value"] / (unit * 2 * OUT)}


def _tolerances(peer) -> list[float]:
    """The tolerances of `TOLERANCES` that a peer takes."""
    return [max(t, peer.record.least) for t in TOLERANCES]


def energy(peer, case: Case, late: Callable[..., bool] = never) -> dict:
    """The largest error of H and the slope of its drift, from a run as long as the budget allows."""
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
    H = system.observe(system.H, s.q, s.p)
    found, slope = metrics.invariant_error(H), drift(s.t, H - H[0])
    kinetic = sum(system.observe(e, s.q, s.p) * s.p[:, i] for i, e in enumerate(system.dq))
    return {
        "value": float(found.max),
        "slope": slope.value,
        "low": slope.low,
        "high": slope.high,
        "time": float(s.t[-1]),
        "scale": float(np.abs(H).max() + np.abs(kinetic).max()),
        "steps": int(s.counts["steps"] or len(s.t)),
        "h": h,
        "tol": tol,
    }


def _matrix(peer, case: Case, h: float, steps: int = 1) -> np.ndarray:
    """The matrix of ``steps`` steps on a linear system of d = 1: its columns are where the unit vectors go.

    It is what it is at steps that no orbit bears, too.
    """
    starts = (([1.0], [0.0]), ([0.0], [1.0]))
    return np.array([end_state(run(peer, case, h, steps, s, fine=("ok", "inaccurate", "unstable"))) for s in starts]).T


def stability(peer, case: Case, late: Callable[..., bool] = never) -> dict:
    """The first stable interval of h omega, and all of them as texts; ``end`` says what ended a scan before its end."""
    end = ""

    def step_matrix(h: float) -> np.ndarray | None:
        nonlocal end
        if late():
            end = "the budget"
            return None
        try:
            return _matrix(peer, case, h)
        except Failed as failure:
            if failure.args[0] in ("skipped", "invalid"):
                raise
            end = failure.args[1]
            return None

    one, two = (_matrix(peer, case, GROWING_AT, n) for n in (1, 2))
    if np.abs(two - one @ one).max() > SQUARE:
        raise Failed("skipped", "it keeps more than the state between steps: two steps are not one taken twice")
    found = linear_stability.stability(step_matrix)
    return {
        "value": found.scanned if found.limit is None else found.limit,
        "unconditional": found.limit is None and not end,
        "scanned": found.scanned,
        "intervals": " ".join(f"{a:.7g}..{b:.7g}" for a, b in found.intervals),
        "grows": linear_stability.radius(one) - 1,
        "reason": f"scanned to {found.scanned:.4g}: {end}" if end else "",
    }


def cost(peer, case: Case, late: Callable[..., bool] = never) -> dict:
    """Warm microseconds a step (an adaptive peer's own steps; a unit of time where it does not tell them)."""
    h, steps, tol = case.h, 100, _tolerances(peer)[1] if peer.adaptive else None
    try:
        s = run(peer, case, h, steps, tol=tol)
        if not peer.adaptive and s.seconds < ENOUGH_COST / 200:
            s = run(peer, case, h, 100 * steps, tol=tol)
            steps *= 100
    except Failed:  # an unstable method: its steps cost what shorter ones do
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


def tolerance(peer, case: Case, late: Callable[..., bool] = never) -> dict:
    """An adaptive peer's error at the end of the span for some tolerances."""
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
