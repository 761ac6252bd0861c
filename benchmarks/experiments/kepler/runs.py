"""Runs of an integrator along a Kepler orbit: its errors on the way, the time of an orbit, and the effect of round-off.

Where round-off dominates, the error of one run is random: a start an ulp away gives another one.  The nine starts whose
coordinates are an ulp less, the same or an ulp more form an ensemble with a meaningful median.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from types import SimpleNamespace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from phasebench.benchmarks.measure import clock
from phasebench.benchmarks.measure.integrator import Integrator
from phasebench.benchmarks.measure.metrics import slope
from phasebench.integrators.errors import InvalidInput

from .kepler import Truth, advances, errors, invariants, times, truth

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from phasebench.benchmarks.problems.base import Problem

#: Standard number of steps an orbit, at which the figure compares methods.
STANDARD = 150
#: Orbits between the rows of a run from a neighbouring start.
APART = 100
#: Points in the fit of a growth exponent, equally spaced in log t.
POINTS = 25


class Setting(NamedTuple):
    """A setting of an integrator on a Kepler orbit.

    Attributes
    ----------
    name : text such as "150 steps"
    per_orbit : steps an orbit; of an adaptive integrator, rows of output an orbit
    tol : tolerance; None for the integrator's default
    """

    name: str
    per_orbit: int = 2
    tol: float | None = None


def growth(orbits: ArrayLike, error: ArrayLike, least: float = 10.0) -> float | None:
    """Fit the exponent a with which the running maximum of |``error``| grows as t^a.

    ``orbits`` (times in orbits) and ``error`` are arrays (n,).  The fit is on points equally spaced in log t from
    ``least`` orbits on; None if fewer than three errors are not 0.
    """
    orbits, error = np.asarray(orbits, float), np.abs(np.asarray(error, float))
    grown = np.maximum.accumulate(error)
    use = np.flatnonzero((orbits >= least) & (grown > 0))
    if len(use) < 3:
        return None
    wanted = np.geomspace(orbits[use[0]], orbits[use[-1]], POINTS)
    chosen = use[np.unique(np.searchsorted(orbits[use], wanted * (1 - 1e-12)))]
    return slope(np.log(orbits[chosen]), np.log(grown[chosen])).value if len(chosen) >= 3 else None


def seconds_per_orbit(contender: Integrator, problem: Problem, period: float, setting: Setting, orbits: int) -> float:
    """Time a warm run over ``orbits`` orbits without output, and return seconds an orbit.

    NaN where the integrator fails.  ``period`` is the time of an orbit.
    """
    timed = orbit_clock(contender, problem, period, setting, orbits)
    return timed() / orbits if timed is not None else float("nan")


def orbit_clock(
    contender: Integrator, problem: Problem, period: float, setting: Setting, orbits: int
) -> clock.Clock | None:
    """Return a function that integrates ``orbits`` orbits and returns the seconds; None if the integrator fails.

    ``contender`` is the integrator, ``period`` the time of an orbit.
    """
    n = setting.per_orbit
    s = contender.run(problem, h=period / n, steps=n * orbits, save_every=0, tol=setting.tol)
    if s.status not in ("ok", "no-root"):
        return None
    return clock.clock(contender, problem, t_end=period * orbits, steps=n * orbits, tol=setting.tol)


def follow(
    contender: Integrator, problem: Problem, exact: Truth, setting: Setting, orbits: int, timeout: float | None = None
) -> tuple[dict, list[dict]]:
    """Integrate ``orbits`` + 1/2 orbits with a row each half orbit, and measure the errors at the end and on the way.

    Parameters
    ----------
    contender, problem, exact : the integrator, the problem, and its `truth`
    setting : steps an orbit (an even number), or a tolerance
    orbits : whole orbits
    timeout : seconds after which a method of this project stops, with the rows so far

    Returns
    -------
    run : status, reason, counts; the measured advance in radians an orbit and its error; the exponents of growth
    rows : the running maximum of each of the `Errors` after 1, 3, 10, ... orbits and a half

    Raises
    ------
    InvalidInput
        For an odd number of steps an orbit.
    """
    per_orbit = setting.per_orbit
    if per_orbit < 2 or per_orbit % 2:
        raise InvalidInput(f"per_orbit is {per_orbit}; it must be even: rows are half an orbit apart")
    every, h = per_orbit // 2, exact.period / per_orbit
    size = {"h": h, "steps": every * (2 * orbits + 1), "save_every": every, "tol": setting.tol}
    s = contender.run(problem, **size, timeout=timeout)
    index = np.arange(1, len(s.q)) * every
    run = {
        "status": s.status,
        "reason": s.reason,
        "orbits": orbits + 0.5,
        "evaluations": s.counts.get("gradient", 0) / orbits,
        "seconds": s.seconds,
    }
    if s.status == "skipped" or not len(index):
        return run | {"reached": 0.0}, []
    when = times(h, index, exactly=not contender.adaptive)
    found = errors(exact, when, s.q[1:], s.p[1:])
    whole = np.isfinite(found.phase)
    last = len(whole) if whole.all() else int(np.argmin(whole))
    if last < len(whole) and run["status"] in ("ok", "inaccurate", "unstable"):
        reason = f"no bound orbit after {last / 2:g} of {orbits + 0.5:g} orbits; take a smaller h"
        run |= {"status": "diverged", "reason": reason}
    run["reached"] = last / 2
    if not last:
        return run, []
    after = np.arange(1, last + 1) / 2
    so_far = {n: np.maximum.accumulate(np.abs(x[:last])) for n, x in zip(found._fields, found, strict=True)}
    rows = [
        {"orbits": k + 0.5} | {n: float(f"{x[2 * k]:.5g}") for n, x in so_far.items()}
        for k in sample_orbits(orbits)
        if 2 * k < last
    ]
    for name in ("energy", "phase", "perihelion"):
        grown = growth(after, getattr(found, name)[:last])
        if grown is not None:
            run[f"{name} growth"] = grown
    end = last - 1 - (last - 1) % 2  # an apocentre of the unperturbed orbit
    return run | advances(exact, when, found, end), rows


def neighbours(problem: Problem) -> list[SimpleNamespace]:
    """Return the starts whose nonzero coordinates are an ulp less, the same or an ulp more, except the problem's own.

    Each has the attributes q0, p0 and parameters of a problem.
    """
    state = [float(x) for x in (*problem.q0, *problem.p0)]
    near = [(x, np.nextafter(x, -np.inf), np.nextafter(x, np.inf)) if x else (x,) for x in state]
    d = len(problem.q0)
    return [
        SimpleNamespace(q0=tuple(map(float, y[:d])), p0=tuple(map(float, y[d:])), parameters=problem.parameters)
        for y in list(product(*near))[1:]
    ]


def draws(contender: Integrator, problem: Problem, exact: Truth, setting: Setting, orbits: int) -> Iterator[float]:
    """Yield the largest phase error, in radians, of the run from each of the `neighbours`; inf for a failed run.

    Errors are measured at every `APART`-th orbit of ``orbits``.
    """
    n = setting.per_orbit
    size = {"h": exact.period / n, "steps": n * orbits, "save_every": n * APART, "tol": setting.tol}
    when = times(size["h"], np.arange(1, orbits // APART + 1) * n * APART, exactly=not contender.adaptive)
    for start in neighbours(problem):
        s = contender.run(problem, **size, q0=start.q0, p0=start.p0)
        phase = errors(truth(start), when, s.q[1:], s.p[1:]).phase if s.status == "ok" else np.array([np.inf])
        yield float(np.abs(phase).max()) if np.isfinite(phase).all() else float("inf")


def within_orbits(
    contender: Integrator, problem: Problem, exact: Truth, per_orbit: int, orbits: int = 10
) -> dict[str, float]:
    """Return the largest relative errors of energy and angular momentum over every step of a few orbits.

    There are ``per_orbit`` steps an orbit.  The keys are "energy, every step" and "momentum, every step".
    """
    s = contender.run(problem, h=exact.period / per_orbit, steps=per_orbit * orbits)
    found = zip(("energy", "momentum"), invariants(s.q, s.p, exact.mu), (exact.H, exact.L), strict=True)
    return {f"{n}, every step": float(np.abs((x - y) / y).max()) for n, x, y in found}


def sample_orbits(orbits: int) -> list[int]:
    """Return the numbers 1, 3, 10, 30, 100, ... up to ``orbits``."""
    return [n for k in range(12) for n in (10**k, 3 * 10**k) if n <= orbits]
