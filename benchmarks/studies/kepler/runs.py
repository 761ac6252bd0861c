"""Runs along Kepler orbits: errors over 10^4 orbits, the time of an orbit, and the error after 100.5 orbits by time.

The strength mu of the Schwarzschild term is 0.0075 at e = 0.6 and scales with L^4, L the angular momentum, so that the
first-order advance is the same at every e; with one mu for all, the term would be most of the force at the pericentre
of e = 0.9.

Where round-off dominates, the error of one run is random: a start an ulp away gives another one.  The nine starts whose
coordinates are an ulp less, the same or an ulp more form an ensemble with a meaningful median.  After 100.5 orbits the
error is taken at an apocentre, where a phase error is not magnified by a high speed.
"""

from __future__ import annotations

import statistics
from collections.abc import Iterator
from functools import cache
from itertools import islice, product
from math import ceil, inf, nan, pi
from types import SimpleNamespace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from phasebench.benchmarks.ladder.climb import climb
from phasebench.benchmarks.measure import clock, metrics
from phasebench.benchmarks.measure.accuracy import end_state
from phasebench.benchmarks.measure.integrator import Integrator, integrator
from phasebench.benchmarks.measure.timing import Median, in_turns, median
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.integrators.driver import OK, SKIPPED
from phasebench.reference.peers import heyoka, rebound
from phasebench.reference.solvers import taylor

from .orbit import Truth, advances, errors, first_order_advance, invariants, times, truth

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from phasebench.benchmarks.problems.base import Problem

LONG, GROWTH, COST, TAYLOR = "kepler", "kepler_growth", "kepler_cost", "Taylor, long double"
PROBLEMS, ECCENTRICITIES = ("kepler", "perturbed-kepler"), (0.0, 0.2, 0.6, 0.9)
#: mu, and the eccentricity at which it holds: they fix L^4 / mu at every e.
MU, AT = 0.0075, 0.6


def chosen(*names: str) -> list[Integrator]:
    """The integrators of names such as "scheme-i 1/3", with lambda where it is a parameter."""
    pairs = (name.partition(" ") for name in names)
    return [integrator(id, parameters={"lam": lam} if lam else None) for id, _, lam in pairs]


#: Group -> its integrators; group "" is in the tables only.
GROUPS = {
    "low order": chosen(
        "scheme-i 1/3", "scheme-ii 1/3", "scheme-iii 1/3", "scheme-iii 0", "scheme-iv", "scheme-v", "rebound-leapfrog"
    ),
    "high order": chosen(
        "scheme-iii-suzuki-4 0", "scheme-iii-yoshida-6 0", "scheme-iii-sofroniou-spaletta-8 0", "gauss-8",
        "wisdom-holman", "rebound-whfast", "rebound-ias15", "heyoka", "heyoka-high-accuracy",
    ),
    "": chosen(
        "stormer-verlet", "wisdom-holman-aba-10-6-4", "scheme-iii-sofroniou-spaletta-10 0", "gauss-6",
        "rebound-leapfrog-8", "rebound-saba-10-6-4",
    ),
}  # fmt: skip
#: Label -> integrator, in long runs.
MEMBERS = {c.label: c for members in GROUPS.values() for c in members}
#: Label -> integrator, of which the error after 100.5 orbits is measured over time.
PRICED = {
    c.label: c
    for c in (
        *chosen(
            "stormer-verlet", "implicit-midpoint", "scheme-i 1/3", "scheme-ii 1/3", "scheme-iii 1/3", "scheme-iv",
            "scheme-v", "avf", "rk4", "scheme-iii-yoshida-4 1/3", "scheme-iii-suzuki-4 0", "scheme-iii-yoshida-6 0",
            "scheme-iii-sofroniou-spaletta-8 0", "scheme-v-suzuki-4", "gauss-6", "gauss-8", "dop853-relaxation",
            "wisdom-holman-aba-10-6-4", "rebound-whfast", "rebound-saba-10-6-4", "rebound-leapfrog",
            "rebound-leapfrog-8", "rebound-bs",
        ),
        *(integrator(rebound.ias15(mode)) for mode in rebound.ADAPTIVE_MODES),
        *chosen("heyoka", "heyoka-high-accuracy"),
        *map(integrator, (heyoka.compact(False), heyoka.compact(True))),
        *chosen("scipy-dop853-numba", "scipy-lsoda-numba"),
    )
}  # fmt: skip
#: Steps an orbit.  From `STANDARD` on the number is raised to the `MOST_STEPS` of the integrator, or until the phase
#: error is at most FOLLOWED, and lowered until the phase error exceeds USEFUL (radians).
LADDER, STANDARD = (50, 100, 150, 300, 600, 1200, 2400), 150
FOLLOWED, USEFUL = 1e-10, 1e-2
#: Label -> the most steps an orbit, with which a run takes about a second; no clock decides which rows there are.
MOST_STEPS = {"stormer-verlet": 2400, "scheme-iii(lam=0)": 2400} | dict.fromkeys(
    ("scheme-i(lam=1/3)", "scheme-iii-suzuki-4(lam=0)"), 1200
)
MOST_STEPS |= dict.fromkeys(("scheme-ii(lam=1/3)", "scheme-iii-sofroniou-spaletta-8(lam=0)", "rebound-whfast"), 300)
MOST_STEPS |= dict.fromkeys(
    (
        *("scheme-iv", "scheme-v", "scheme-iii-sofroniou-spaletta-10(lam=0)", "wisdom-holman-aba-10-6-4"),
        *("rebound-leapfrog-8", "rebound-saba-10-6-4"),
    ),
    150,
)
USUAL_STEPS = 600
#: The tolerances of adaptive peers; None: the package's default.
TOLERANCES = {"heyoka": (None, 1e-12, 1e-9, 1e-6), "heyoka-high-accuracy": (None, 1e-12), "rebound-ias15": (None, 1e-6)}
#: Phase errors within DRAWN may be random by round-off: such runs are repeated from neighbouring starts, but the DEAR
#: ones, whose phase error is taken to be known to a factor SPREAD.
DRAWN, DEAR, SPREAD = (3e-11, 3e-8), ("rebound-ias15", None), 30.0
#: If FIRST repetitions agree within the factor ALIKE, the error is truncation, and no more are made.
ALIKE, FIRST = 1.05, 2
#: Orbits of the long runs, and between rows of a run from a neighbouring start.
ORBITS, APART = 10_000, 100
#: Seconds after which a run of a method of this project stops; points of a fit of growth, equally spaced in log t.
TIMEOUT, POINTS = 20.0, 25
#: The least steps of a timed run, orbits of an adaptive one, rounds.
TIMED, TIMED_ORBITS, ROUNDS = 1_500, 10, 9
#: Of errors over time: the orbits, steps an orbit, tolerances, and the largest number of rows of a run.
HALF, PER_ORBIT, TRIED, MOST = 100.5, (30, 50, 100, 300, 1000, 3000), tuple(10.0**-k for k in range(3, 16, 2)), 5_000
#: A run of at least so many seconds is timed once, a shorter one so many times.
ONCE, AGAIN = 0.2, 5


class Setting(NamedTuple):
    """Steps an orbit (of an adaptive integrator, rows), or a tolerance, None for the integrator's default."""

    name: str
    per_orbit: int = 2
    tol: float | None = None


def settings(c: Integrator) -> list[Setting]:
    """All numbers of steps, or all tolerances with the default first."""
    if not c.adaptive:
        return [Setting(f"{n} steps", n) for n in LADDER]
    return [Setting("adaptive" if t is None else f"tolerance {t:g}", tol=t) for t in TOLERANCES.get(c.id, (None,))]


@cache
def orbit(name: str, e: float) -> tuple[Problem, Truth, dict]:
    """A Kepler orbit of eccentricity e: (problem, exact solution, columns of every row)."""
    mu = MU * ((1 - e**2) / (1 - AT**2)) ** 2 if name == "perturbed-kepler" else 0.0
    made = problem_of(name, e=e, **({"mu": mu} if mu else {}))
    exact = truth(made)
    about = {"problem": name, "e": e, "mu": mu, "period": exact.period, "closed form": exact.advance}
    return made, exact, about | {"first order": first_order_advance(float(exact.L), mu)}


# -- long runs ---------------------------------------------------------------------------------------------------------


def follow(problem: str, e: float, method: str) -> dict[str, list[dict]]:
    """Errors at the end of all runs of an integrator, or of the Taylor reference, and after 1, 3, 10, ... orbits."""
    c = MEMBERS.get(method)
    group = next((name for name, members in GROUPS.items() if c in members), "")
    about = {"method": method, "kind": c.kind if c else "reference", "group": group}
    rows: dict[str, list[dict]] = {LONG: [], GROWTH: []}
    for setting, run, samples in runs(c, *orbit(problem, e)[:2]) if c else [reference(*orbit(problem, e)[:2])]:
        one = about | {"setting": setting.name}
        steps = None if c is None or c.adaptive else setting.per_orbit
        rows[LONG].append(orbit(problem, e)[2] | one | {"steps per orbit": steps} | run)
        rows[GROWTH] += [{"problem": problem, "e": e} | one | s | {"status": run["status"]} for s in samples]
    return rows


def reference(made: Problem, exact: Truth, orbits: int = ORBITS) -> tuple[Setting, dict, list[dict]]:
    """The run of the Taylor reference, whose errors show how accurate the measurement itself is."""
    index = [2 * k + 1 for k in sampled(orbits)]
    when, grid = times(exact.period / 2, index, exactly=False), [exact.period / 2 * n for n in index]
    states = taylor.states(made.system, np.longdouble, made.q0, made.p0, grid).astype(float)
    found = errors(exact, when, states[:, :2], states[:, 2:])
    sizes = found._asdict().items()
    samples = [{"orbits": n / 2} | {k: float(abs(x[i])) for k, x in sizes} for i, n in enumerate(index)]
    run = {"status": OK, "orbits": orbits + 0.5, "reached": index[-1] / 2}
    return Setting("reference"), run | advances(exact, when, found, -1), samples


def runs(c: Integrator, made: Problem, exact: Truth) -> list[tuple[Setting, dict, list[dict]]]:
    """(Setting, row, rows on the way) of each run: at every tolerance, or at finer and wider steps than the standard.

    Finer steps end when the phase error is round-off, wider ones when the phase is lost.
    """
    if c.adaptive:
        return [(s, *run(c, made, exact, s)) for s in settings(c)]
    by_steps = {s.per_orbit: s for s in settings(c)}
    at = cache(lambda n: (by_steps[n], *run(c, made, exact, by_steps[n])))

    def precise(rungs: list) -> str:
        last = rungs[-1][1]
        return "skipped" if last["status"] == SKIPPED else "followed" if last["phase, high"] <= FOLLOWED else ""

    def lost(rungs: list) -> str:
        last = rungs[-1][1]
        return "failed" if last["status"] != OK else "lost" if last["phase, low"] > USEFUL else ""

    most = MOST_STEPS.get(c.label, USUAL_STEPS)
    finer, _ = climb([n for n in LADDER if STANDARD <= n <= most], at, precise)
    wider, _ = climb([n for n in LADDER[::-1] if n <= STANDARD], at, lost)
    return [*finer, *wider[1:]]


def run(c: Integrator, made: Problem, exact: Truth, setting: Setting) -> tuple[dict, list[dict]]:
    """The row of a run and rows of its errors on the way.

    Where round-off may decide, the phase error at the end is the median over starts an ulp apart.
    """
    row, samples = on_the_way(c, made, exact, setting, ORBITS, None if c.adaptive else TIMEOUT)
    if row["status"] == OK and not c.adaptive:
        s = c.run(made, h=exact.period / setting.per_orbit, steps=setting.per_orbit * 10)
        kept = zip(("energy", "momentum"), invariants(s.q, s.p, exact.mu), (exact.H, exact.L), strict=True)
        row |= {f"{n}, every step": float(np.abs((x - y) / y).max()) for n, x, y in kept}
    row.pop("seconds", None)
    phase = samples[-1]["phase"] if row["status"] == OK else inf
    found, count = Median(phase, phase, phase), 1
    if DRAWN[0] <= phase <= DRAWN[1]:
        others = iter(()) if (c.label, setting.tol) == DEAR else draws(c, made, exact, setting, ORBITS)
        found, count = median_phase(phase, others)
    row |= {"phase median": found.value, "phase, low": found.low, "phase, high": found.high}
    return row | {"starts": count}, samples


def on_the_way(
    c: Integrator, made: Problem, exact: Truth, setting: Setting, orbits: int, timeout: float | None = None
) -> tuple[dict, list[dict]]:
    """The row of a run over ``orbits`` + 1/2 orbits, and the largest errors so far after 1, 3, 10, ... orbits."""
    every, h = setting.per_orbit // 2, exact.period / setting.per_orbit
    size = {"h": h, "steps": every * (2 * orbits + 1), "save_every": every, "tol": setting.tol}
    s = c.run(made, **size, timeout=timeout)
    index = np.arange(1, len(s.q)) * every
    row = {"status": s.status, "reason": s.reason, "orbits": orbits + 0.5, "reached": 0.0}
    row |= {"evaluations": s.counts.get("gradient", 0) / orbits, "seconds": s.seconds}
    if s.status == SKIPPED or not len(index):
        return row, []
    when = times(h, index, exactly=not c.adaptive)
    found = errors(exact, when, s.q[1:], s.p[1:])
    whole = np.isfinite(found.phase)
    last = len(whole) if whole.all() else int(np.argmin(whole))
    if last < len(whole) and row["status"] in (OK, "inaccurate", "unstable"):
        reason = f"no bound orbit after {last / 2:g} of {orbits + 0.5:g} orbits; take a smaller h"
        row |= {"status": "diverged", "reason": reason}
    row["reached"] = last / 2
    if not last:
        return row, []
    so_far = {n: np.maximum.accumulate(np.abs(x[:last])) for n, x in found._asdict().items()}
    samples = [
        {"orbits": k + 0.5} | {n: float(f"{x[2 * k]:.5g}") for n, x in so_far.items()}
        for k in sampled(orbits)
        if 2 * k < last
    ]
    for name in ("energy", "phase", "perihelion"):
        grown = growth(np.arange(1, last + 1) / 2, getattr(found, name)[:last])
        row |= {} if grown is None else {f"{name} growth": grown}
    end = last - 1 - (last - 1) % 2  # an apocentre of the unperturbed orbit
    return row | advances(exact, when, found, end), samples


def sampled(orbits: int) -> list[int]:
    """The numbers 1, 3, 10, 30, ... up to ``orbits``."""
    return [n for k in range(12) for n in (10**k, 3 * 10**k) if n <= orbits]


def growth(orbits: ArrayLike, error: ArrayLike, least: float = 10.0) -> float | None:
    """The exponent a with which the running maximum of |error| grows as t^a, fitted from ``least`` orbits on.

    None if fewer than three errors are not 0.
    """
    orbits, error = np.asarray(orbits, float), np.abs(np.asarray(error, float))
    grown = np.maximum.accumulate(error)
    use = np.flatnonzero((orbits >= least) & (grown > 0))
    if len(use) < 3:
        return None
    wanted = np.geomspace(orbits[use[0]], orbits[use[-1]], POINTS)
    taken = use[np.unique(np.searchsorted(orbits[use], wanted * (1 - 1e-12)))]
    return metrics.slope(np.log(orbits[taken]), np.log(grown[taken])).value if len(taken) >= 3 else None


def neighbours(made: Problem) -> list[SimpleNamespace]:
    """The starts whose nonzero coordinates are an ulp less, the same or an ulp more, except the problem's own."""
    state = [float(x) for x in (*made.q0, *made.p0)]
    near = [(x, np.nextafter(x, -np.inf), np.nextafter(x, np.inf)) if x else (x,) for x in state]
    d, starts = len(made.q0), [tuple(map(float, y)) for y in list(product(*near))[1:]]
    return [SimpleNamespace(q0=y[:d], p0=y[d:], parameters=made.parameters) for y in starts]


def draws(c: Integrator, made: Problem, exact: Truth, setting: Setting, orbits: int) -> Iterator[float]:
    """The largest phase error at every `APART`-th orbit, from each of the `neighbours`; inf for a failed run."""
    n = setting.per_orbit
    size = {"h": exact.period / n, "steps": n * orbits, "save_every": n * APART, "tol": setting.tol}
    when = times(size["h"], np.arange(1, orbits // APART + 1) * n * APART, exactly=not c.adaptive)
    for start in neighbours(made):
        s = c.run(made, **size, q0=start.q0, p0=start.p0)
        phase = errors(truth(start), when, s.q[1:], s.p[1:]).phase if s.status == OK else np.array([np.inf])
        yield float(np.abs(phase).max()) if np.isfinite(phase).all() else inf


def median_phase(phase: float, others: Iterator[float]) -> tuple[Median, int]:
    """(Median phase error with its interval, number of starts) from the own start and ``others``.

    All others are read only if the `FIRST` ones differ by more than the factor `ALIKE`.  Without others the interval is
    a factor `SPREAD` in both directions.
    """
    drawn = [phase, *islice(others, FIRST)]
    if len(drawn) == 1:
        return Median(phase, phase / SPREAD, phase * SPREAD), 1
    if max(drawn) > ALIKE * min(drawn):
        drawn += others
    return median(drawn), len(drawn)


# -- times -------------------------------------------------------------------------------------------------------------


def orbit_clock(c: Integrator, made: Problem, period: float, setting: Setting, orbits: int) -> clock.Clock | None:
    """A function that integrates so many orbits and returns the seconds; None if the integrator fails."""
    steps = setting.per_orbit * orbits
    if c.run(made, h=period / setting.per_orbit, steps=steps, save_every=0, tol=setting.tol).status in (OK, "no-root"):
        return clock.clock(c, made, t_end=period * orbits, steps=steps, tol=setting.tol)
    return None


def orbit_times(problem: str, e: float) -> list[dict]:
    """Microseconds an orbit of every integrator and setting, in turns; NaN for an integrator that fails."""
    made, exact, _ = orbit(problem, e)
    todo, orbits = {}, {}
    for c in MEMBERS.values():
        for setting in settings(c):
            key = c.label, setting.name
            orbits[key] = TIMED_ORBITS if c.adaptive else ceil(TIMED / setting.per_orbit)
            todo[key] = orbit_clock(c, made, exact.period, setting, orbits[key]) or (lambda: nan)
    rows = []
    for key, seconds in in_turns(todo, ROUNDS).items():
        found = median(1e6 * (seconds / orbits[key]))
        row = {"problem": problem, "e": e, "method": key[0], "setting": key[1]}
        rows.append(row | {"us per orbit": found.value, "us, low": found.low, "us, high": found.high})
    return rows


@cache
def end(problem: str) -> taylor.Reference:
    """The Taylor reference of a problem after `HALF` orbits."""
    return taylor.reference(problem_of(problem), [HALF * 2 * pi])


def cost(problem: str, method: str) -> list[dict]:
    """The end error after `HALF` orbits and the seconds of a warm run: a row for each step or tolerance."""
    c, t_end = PRICED[method], HALF * 2 * pi
    if c.adaptive:
        rows = {"h": t_end / 200, "steps": 200}
        sizes = {f"tolerance {tol:g}": rows | {"tol": tol} for tol in TRIED if tol >= c.record.least}
    else:
        sizes = {f"{n} steps an orbit": {"h": 2 * pi / n, "steps": round(t_end / (2 * pi / n))} for n in PER_ORBIT}
    return [_cost(problem, c, setting, size) for setting, size in sizes.items()]


def _cost(problem: str, c: Integrator, setting: str, size: dict) -> dict:
    made, true = problem_of(problem), end(problem)
    row = {"problem": problem, "e": made.parameters["e"], "orbits": HALF, "method": c.label, "kind": c.kind}
    s = c.run(made, **size, save_every=ceil(size["steps"] / MOST))
    row |= {"setting": setting, "status": s.status, "reason": s.reason, "steps": s.counts.get("steps", 0)}
    if s.status != OK:
        return row
    H, L = (made.system.observe(x, s.q, s.p) for x in (made.system.H, made.invariants["angular-momentum"]))
    bare = size | ({"h": HALF * 2 * pi, "steps": 1} if c.adaptive else {})
    again = range(AGAIN if s.seconds < ONCE else 1)
    return row | {
        "error": float(np.abs(end_state(s) - end_state(true)).max()),
        "reference uncertainty": float(true.uncertainty[-1]),
        "energy error": float(metrics.invariant_error(H).max),
        "angular momentum error": float(metrics.invariant_error(L).max),
        "seconds": statistics.median(c.run(made, **bare, save_every=0).seconds for _ in again),
    }
