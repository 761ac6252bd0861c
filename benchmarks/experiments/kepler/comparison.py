"""Kepler with and without the Schwarzschild term to 10^4 orbits, compared with the established integrators.

At e = 0, 0.2, 0.6 and 0.9: errors in energy, angular momentum, phase and perihelion at various steps and tolerances,
and the advance of the perihelion (`kepler`).  The module `times` measures the time of an orbit, `cost` the error of the
state after 100.5 orbits against time; this error is taken at an apocentre, where a phase error is not magnified by a
high speed.

The strength mu of the Schwarzschild term is 0.0075 at e = 0.6 and scales with L^4, L the angular momentum, so that the
first-order advance is the same at every e; with one mu for all, the term would be most of the force at the pericentre
of e = 0.9.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from itertools import islice
from math import inf
from typing import TYPE_CHECKING

import numpy as np

from phasebench.benchmarks.ladder.climb import climb
from phasebench.benchmarks.measure.integrator import Integrator, integrator
from phasebench.benchmarks.measure.timing import Median, median
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import Cell, ProblemKey, Rows, content
from phasebench.integrators.driver import OK, SKIPPED
from phasebench.reference.solvers import taylor

from . import kepler, runs
from .runs import STANDARD, Setting

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem

PROBLEMS = ("kepler", "perturbed-kepler")
ECCENTRICITIES = (0.0, 0.2, 0.6, 0.9)
#: mu, and the eccentricity at which it holds: they fix L^4 / mu at every e.
MU, AT = 0.0075, 0.6
#: Group -> its integrators: the curves of one figure; group "" is in the tables only.
GROUPS = {
    "low order": (
        integrator("scheme-i", parameters={"lam": "1/3"}),
        integrator("scheme-ii", parameters={"lam": "1/3"}),
        integrator("scheme-iii", parameters={"lam": "1/3"}),
        integrator("scheme-iii", parameters={"lam": "0"}),
        integrator("scheme-iv"),
        integrator("scheme-v"),
        integrator("rebound-leapfrog"),
    ),
    "high order": (
        integrator("scheme-iii-suzuki-4", parameters={"lam": "0"}),
        integrator("scheme-iii-yoshida-6", parameters={"lam": "0"}),
        integrator("scheme-iii-sofroniou-spaletta-8", parameters={"lam": "0"}),
        integrator("gauss-8"),
        integrator("wisdom-holman"),
        integrator("rebound-whfast"),
        integrator("rebound-ias15"),
        integrator("heyoka"),
        integrator("heyoka-high-accuracy"),
    ),
    "": (
        integrator("stormer-verlet"),
        integrator("wisdom-holman-aba-10-6-4"),
        integrator("scheme-iii-sofroniou-spaletta-10", parameters={"lam": "0"}),
        integrator("gauss-6"),
        integrator("rebound-leapfrog-8"),
        integrator("rebound-saba-10-6-4"),
    ),
}
#: Steps an orbit.  From `STANDARD` on the number is raised until the phase error is at most FOLLOWED or the run would
#: take more than LONGEST seconds, and lowered until the phase error exceeds USEFUL (radians).
LADDER = (50, 100, 150, 300, 600, 1200, 2400)
LONGEST, FOLLOWED, USEFUL = 1.2, 1e-10, 1e-2
#: The tolerances of adaptive peers; None: the package's default.
TOLERANCES = {
    "heyoka": (None, 1e-12, 1e-9, 1e-6),
    "heyoka-high-accuracy": (None, 1e-12),
    "rebound-ias15": (None, 1e-6),
}
#: Phase errors within DRAWN may be random by round-off: such runs are repeated from neighbouring starts if they take at
#: most DEAR seconds; the phase error of a longer run is taken to be known to a factor SPREAD.
DRAWN, DEAR, SPREAD = (3e-11, 3e-8), 2.5, 30.0
#: If FIRST repetitions agree within the factor ALIKE, the error is truncation, and no more are made.
ALIKE, FIRST = 1.05, 2
#: Seconds after which a run of a method of this project stops.
TIMEOUT = 20.0
#: Orbits of the long runs, and of the short runs that estimate their cost.
ORBITS, FEW = 10_000, 20
TAYLOR = "Taylor, long double"


def contenders() -> list[Integrator]:
    """List all integrators that are compared on Kepler orbits: this project's methods and those of other packages."""
    return [c for members in GROUPS.values() for c in members]


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`), one for each integrator and the reference, on each orbit; none if ``quick``."""
    if quick:
        return []
    members = [(group, k, c) for group, of in GROUPS.items() for k, c in enumerate(of)]
    return [
        cell
        for name in PROBLEMS
        for e in ECCENTRICITIES
        for cell in [
            _cell(name, e, reference, (), TAYLOR),
            *(_cell(name, e, measure_rows, m[:2], m[2]) for m in members),
        ]
    ]


def _cell(name: str, e: float, measure: Callable[..., Rows], arguments: tuple, c: Integrator | str) -> Cell:
    label, known = (c, ()) if isinstance(c, str) else (c.label, (c.record,))
    return Cell(
        "kepler",
        ("kepler", "kepler_growth"),
        {"problem": name, "e": e, "method": label},
        measure,
        (name, e, *arguments),
        content("kepler", label, ProblemKey(name, (("e", e),)), MU, AT, ORBITS, *known, code=[__name__]),
        frozenset({name, *(r.id for r in known), *(getattr(r, "package", "") for r in known)}),
    )


@cache
def orbit(name: str, e: float) -> tuple[Problem, kepler.Truth, dict]:
    """Return a Kepler orbit of eccentricity e: (problem, exact solution `kepler.Truth`, columns of every row).

    ``name`` is "kepler" or "perturbed-kepler".  The columns are a dict of problem, e, mu, period, and the exact and the
    first-order advance of the perihelion a radial period, in radians.
    """
    mu = MU * ((1 - e**2) / (1 - AT**2)) ** 2 if name == "perturbed-kepler" else 0.0
    made = problem(name, e=e, **({"mu": mu} if mu else {}))
    exact = kepler.truth(made)
    about = {"problem": name, "e": e, "mu": mu, "period": exact.period}
    about |= {"closed form": exact.advance, "first order": kepler.first_order_advance(float(exact.L), mu)}
    return made, exact, about


def steps(n: int) -> Setting:
    """Return the `Setting` of ``n`` steps an orbit."""
    return Setting(f"{n} steps", n)


def tolerances(c: Integrator) -> list[Setting]:
    """Return the settings (`Setting`) of an adaptive integrator: its default tolerance first, then looser ones."""
    return [Setting("adaptive" if t is None else f"tolerance {t:g}", tol=t) for t in TOLERANCES.get(c.id, (None,))]


def _reference(made: Problem, exact: kepler.Truth, orbits: int) -> tuple[dict, list[dict]]:
    """Measure the errors of the Taylor reference: (row of the run, rows of its errors after 1, 3, 10, ... orbits).

    ``made`` and ``exact`` are the problem and its exact solution from `orbit`.  The reference runs over ``orbits`` +
    1/2 orbits; its errors show how accurate the measurement itself is.
    """
    index = [2 * k + 1 for k in runs.sample_orbits(orbits)]
    when = kepler.times(exact.period / 2, index, exactly=False)
    grid = [exact.period / 2 * n for n in index]
    rows = taylor.states(made.system, np.longdouble, made.q0, made.p0, grid).astype(float)
    found = kepler.errors(exact, when, rows[:, :2], rows[:, 2:])
    samples = [
        {"orbits": n / 2} | {k: float(abs(x[i])) for k, x in zip(found._fields, found, strict=True)}
        for i, n in enumerate(index)
    ]
    run = {"status": OK, "orbits": orbits + 0.5, "reached": index[-1] / 2}
    return run | kepler.advances(exact, when, found, -1), samples


def _rows(about: dict, one: dict, per_orbit: int | None, run: dict, samples: list[dict]) -> Rows:
    """Combine columns on the orbit (``about``), the integrator (``one``) and a run into rows, by table name.

    The table "kepler" gets one row, of the run, with ``per_orbit``, its number of steps an orbit (None if the steps are
    adaptive).  The table "kepler_growth" gets a row for each of ``samples``, the errors after 1, 3, 10, ... orbits.
    """
    row = about | one | {"steps per orbit": per_orbit} | run
    where = {"problem": about["problem"], "e": about["e"]} | one
    return {"kepler": [row], "kepler_growth": [where | s | {"status": run["status"]} for s in samples]}


def reference(name: str, e: float) -> Rows:
    """Measure the Taylor reference on the orbit of eccentricity e of the problem ``name``: rows by table name."""
    made, exact, about = orbit(name, e)
    one = {"method": TAYLOR, "kind": "reference", "group": "", "setting": "reference"}
    return _rows(about, one, None, *_reference(made, exact, ORBITS))


def measure_rows(name: str, e: float, group: str, position: int) -> Rows:
    """Follow one orbit with an integrator at all its settings: errors, and the perihelion's advance a radial period.

    The orbit is that of eccentricity e of the problem ``name``, the integrator is ``GROUPS[group][position]``.  Returns
    rows by table name: "kepler" (one for each run) and "kepler_growth" (the errors after 1, 3, 10, ... orbits).
    """
    _, _, about = orbit(name, e)
    c = GROUPS[group][position]
    out: Rows = {"kepler": [], "kepler_growth": []}
    for setting, run, samples in _adaptive(c, name, e) if c.adaptive else _ladder(c, name, e):
        one = {"method": c.label, "kind": c.kind, "group": group, "setting": setting.name}
        rows = _rows(about, one, None if c.adaptive else setting.per_orbit, run, samples)
        out = {table: [*before, *rows[table]] for table, before in out.items()}
    return out


def _adaptive(c: Integrator, name: str, e: float) -> Iterator[tuple[Setting, dict, list[dict]]]:
    """Run an adaptive integrator at each tolerance: yield (setting, row of the run, rows of its errors on the way).

    The errors on the way are those after 1, 3, 10, ... orbits.
    """
    for setting in tolerances(c):
        yield setting, *_run(c, name, e, setting)


def _ladder(c: Integrator, name: str, e: float) -> list[tuple[Setting, dict, list[dict]]]:
    """Run a method of fixed step: at the standard number of steps an orbit, then at finer and wider steps.

    Finer steps end when the phase error is round-off or a run takes too long, wider ones when the phase is lost.
    Returns (setting, row of the run, rows of its errors after 1, 3, 10, ... orbits) for each run.
    """
    made, exact, _ = orbit(name, e)
    # Seconds a step, from the standard step, or from the shortest one where the standard one fails.
    costs = (runs.seconds_per_orbit(c, made, exact.period, steps(n), FEW) / n for n in (STANDARD, LADDER[-1]))
    step = next((s for s in costs if np.isfinite(s)), inf)

    @cache
    def run(n: int) -> tuple[Setting, dict, list[dict]]:
        return steps(n), *_run(c, name, e, steps(n))

    affordable = [n for n in LADDER if n == STANDARD or (n > STANDARD and step * n * ORBITS <= LONGEST)]
    finer, _ = climb(affordable, run, _precise)
    wider, _ = climb([n for n in LADDER[::-1] if n <= STANDARD], run, _end_reason)
    return [*finer, *wider[1:]]


def _precise(ladder: list[tuple[Setting, dict, list[dict]]]) -> str:
    """Return why steps finer than the last run's are of no use, or "" if they are of use.

    ``ladder`` is the list of (setting, row of the run, rows of its errors) so far; the last has the shortest step.
    """
    run = ladder[-1][1]
    return "skipped" if run["status"] == SKIPPED else "followed" if run["phase, high"] <= FOLLOWED else ""


def _end_reason(ladder: list[tuple[Setting, dict, list[dict]]]) -> str:
    """Return why steps wider than the last run's are of no use, or "" if they are of use.

    ``ladder`` is the list of (setting, row of the run, rows of its errors) so far; the last has the longest step.
    """
    run = ladder[-1][1]
    return "failed" if run["status"] != OK else "lost" if run["phase, low"] > USEFUL else ""


def _run(c: Integrator, name: str, e: float, setting: Setting) -> tuple[dict, list[dict]]:
    """Follow one orbit at one setting: (the run's row, rows of its errors after 1, 3, 10, ... orbits).

    Where round-off may decide, the row's phase error at the end is the median over starts an ulp apart.
    """
    made, exact, _ = orbit(name, e)
    run, samples = runs.follow(c, made, exact, setting, ORBITS, None if c.adaptive else TIMEOUT)
    if run["status"] == OK and not c.adaptive:
        run |= runs.within_orbits(c, made, exact, setting.per_orbit)
    seconds = run.pop("seconds", inf)
    phase = samples[-1]["phase"] if run["status"] == OK else inf
    found, count = Median(phase, phase, phase), 1
    if DRAWN[0] <= phase <= DRAWN[1]:
        others = runs.draws(c, made, exact, setting, ORBITS) if seconds <= DEAR else iter(())
        found, count = median_phase_error(phase, others)
    run |= {"phase median": found.value, "phase, low": found.low, "phase, high": found.high}
    return run | {"starts": count}, samples


def median_phase_error(phase: float, others: Iterator[float]) -> tuple[Median, int]:
    """Return (median phase error of runs from neighbouring starts, with its interval; number of starts).

    ``phase`` is the error from the problem's own start; ``others`` yields those from starts an ulp away.  `FIRST` of
    them are read, and the rest only if these errors differ by more than the factor `ALIKE`.  Without others the
    interval is a factor `SPREAD` in both directions.
    """
    drawn = [phase, *islice(others, FIRST)]
    if len(drawn) == 1:
        return Median(phase, phase / SPREAD, phase * SPREAD), 1
    if max(drawn) > ALIKE * min(drawn):
        drawn += others
    return median(drawn), len(drawn)
