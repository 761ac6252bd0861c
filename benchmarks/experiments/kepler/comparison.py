"""Kepler with the Schwarzschild term and without, beside the established integrators, to 10^4 orbits.

At e = 0, 0.2, 0.6 and 0.9: the errors in energy, angular momentum, phase and perihelion over steps and tolerances, and
the advance of the perihelion (`kepler`).  What an orbit costs is in `times`; the error of the state at an apocentre,
where a phase error is not multiplied by the speed of a pericentre, against the cost over 100.5 orbits in `cost`.

mu is that of the talk (0.0075) at e = 0.6 and scales with L^4, so that the first-order advance is the same at every e;
with one mu for all, the term would be most of the force at the pericentre of e = 0.9.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from itertools import islice
from math import inf

import numpy as np

from phasebench.benchmarks.measure.integrator import Integrator, integrator
from phasebench.benchmarks.measure.timing import Median, median
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.rows.cells import Cell, Problem, Rows, content
from phasebench.integrators.driver import OK, SKIPPED
from phasebench.reference.solvers import taylor

from . import kepler, runs
from .runs import STANDARD, Setting

PROBLEMS = ("kepler", "perturbed-kepler")
ECCENTRICITIES = (0.0, 0.2, 0.6, 0.9)
#: The strength and the eccentricity that fix L^4 / mu for all.
MU, AT = 0.0075, 0.6
#: The curves of a figure of each name; "" is in the tables alone.
GROUPS = {
    "low order": (
        integrator("scheme-i", lam="1/3"),
        integrator("scheme-ii", lam="1/3"),
        integrator("scheme-iii", lam="1/3"),
        integrator("scheme-iii", lam="0"),
        integrator("scheme-iv"),
        integrator("scheme-v"),
        integrator("rebound-leapfrog"),
    ),
    "high order": (
        integrator("scheme-iii-suzuki-4", lam="0"),
        integrator("scheme-iii-yoshida-6", lam="0"),
        integrator("scheme-iii-sofroniou-spaletta-8", lam="0"),
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
        integrator("scheme-iii-sofroniou-spaletta-10", lam="0"),
        integrator("gauss-6"),
        integrator("rebound-leapfrog-8"),
        integrator("rebound-saba-10-6-4"),
    ),
}
#: Steps an orbit: from the standard ones on more, while the phase is not followed to FOLLOWED and the run is estimated
#: at no more than LONGEST seconds; and fewer, while it is still followed to USEFUL.
LADDER = (50, 100, 150, 300, 600, 1200, 2400)
LONGEST, FOLLOWED, USEFUL = 1.2, 1e-10, 1e-2
#: The tolerances of adaptive peers; None: the package's own.
TOLERANCES = {
    "heyoka": (None, 1e-12, 1e-9, 1e-6),
    "heyoka-high-accuracy": (None, 1e-12),
    "rebound-ias15": (None, 1e-6),
}
#: Phase errors in which round-off may have the last word are drawn again from neighbouring starts, in runs of at most
#: DEAR seconds; those of longer runs are known to a factor SPREAD.
DRAWN, DEAR, SPREAD = (3e-11, 3e-8), 2.5, 30.0
#: Where the first draws agree within this factor it is truncation, and no more are taken.
ALIKE, FIRST = 1.05, 2
#: Seconds after which a run of this project stops.
TIMEOUT = 20.0
#: Orbits of the long runs, and of the estimate of their cost.
ORBITS, FEW = 10_000, 20
TAYLOR = "Taylor, long double"


def contenders() -> list[Integrator]:
    """All that are compared."""
    return [c for members in GROUPS.values() for c in members]


def cells(quick: bool = False) -> list[Cell]:
    """A cell for each integrator and the reference on each orbit, to 10^4 orbits; none of the quick tier."""
    if quick:
        return []
    members = [(group, k, c) for group, of in GROUPS.items() for k, c in enumerate(of)]
    return [
        cell
        for name in PROBLEMS
        for e in ECCENTRICITIES
        for cell in [_cell(name, e, reference, (), TAYLOR), *(_cell(name, e, followed, m[:2], m[2]) for m in members)]
    ]


def _cell(name: str, e: float, measure, arguments: tuple, c: Integrator | str) -> Cell:
    label, known = (c, ()) if isinstance(c, str) else (c.label, (c.record,))
    return Cell(
        "kepler",
        ("kepler", "kepler_growth"),
        {"problem": name, "e": e, "method": label},
        measure,
        (name, e, *arguments),
        content("kepler", label, Problem(name, (("e", e),)), MU, AT, ORBITS, *known, code=[__name__]),
        frozenset({name, *(r.id for r in known), *(getattr(r, "package", "") for r in known)}),
    )


@cache
def orbit(name: str, e: float):
    """The problem, its exact solution, and what the rows say of them."""
    mu = MU * ((1 - e**2) / (1 - AT**2)) ** 2 if name == "perturbed-kepler" else 0.0
    made = problem(name, e=e, **({"mu": mu} if mu else {}))
    exact = kepler.truth(made)
    about = {"problem": name, "e": e, "mu": mu, "period": exact.period}
    about |= {"closed form": exact.advance, "first order": kepler.first_order_advance(float(exact.L), mu)}
    return made, exact, about


def steps(n: int) -> Setting:
    """The setting of ``n`` steps an orbit."""
    return Setting(f"{n} steps", n)


def tolerances(c: Integrator) -> list[Setting]:
    """The settings of an adaptive peer, its own first."""
    return [Setting("adaptive" if t is None else f"tolerance {t:g}", tol=t) for t in TOLERANCES.get(c.id, (None,))]


def _reference(made, exact, orbits: int):
    """The certified Taylor series, as a run: what is left of the errors is the measurement's own."""
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
    """The row of a run and those of its growth."""
    row = about | one | {"steps per orbit": per_orbit} | run
    where = {"problem": about["problem"], "e": about["e"]} | one
    return {"kepler": [row], "kepler_growth": [where | s | {"status": run["status"]} for s in samples]}


def reference(name: str, e: float) -> Rows:
    """The rows of the Taylor series."""
    made, exact, about = orbit(name, e)
    one = {"method": TAYLOR, "kind": "reference", "group": "", "setting": "reference"}
    return _rows(about, one, None, *_reference(made, exact, ORBITS))


def followed(name: str, e: float, group: str, position: int) -> Rows:
    """The rows of an integrator: the four errors and the perihelion's advance; an orbit is a radial period."""
    _, _, about = orbit(name, e)
    c = GROUPS[group][position]
    out: Rows = {"kepler": [], "kepler_growth": []}
    for setting, run, samples in _adaptive(c, name, e) if c.adaptive else _ladder(c, name, e):
        one = {"method": c.label, "kind": c.kind, "group": group, "setting": setting.name}
        rows = _rows(about, one, None if c.adaptive else setting.per_orbit, run, samples)
        out = {table: [*before, *rows[table]] for table, before in out.items()}
    return out


def _adaptive(c: Integrator, name: str, e: float) -> Iterator[tuple[Setting, dict, list[dict]]]:
    for setting in tolerances(c):
        yield setting, *_run(c, name, e, setting)


def _ladder(c: Integrator, name: str, e: float) -> Iterator[tuple[Setting, dict, list[dict]]]:
    """The runs of a fixed step: the standard one, then finer and wider ones while they may be of use."""
    made, exact, _ = orbit(name, e)
    # The cost of a step: where the standard one is too long, of the shortest.
    costs = (runs.seconds_per_orbit(c, made, exact.period, steps(n), FEW) / n for n in (STANDARD, LADDER[-1]))
    step = next((s for s in costs if np.isfinite(s)), inf)
    first, samples = _run(c, name, e, steps(STANDARD))
    yield steps(STANDARD), first, samples
    run = first
    for n in (n for n in LADDER if n > STANDARD):
        if run["status"] == SKIPPED or run["phase, high"] <= FOLLOWED or step * n * ORBITS > LONGEST:
            break
        run, samples = _run(c, name, e, steps(n))
        yield steps(n), run, samples
    run = first
    for n in (n for n in LADDER[::-1] if n < STANDARD):
        if run["status"] != OK or run["phase, low"] > USEFUL:
            break
        run, samples = _run(c, name, e, steps(n))
        yield steps(n), run, samples


def _run(c: Integrator, name: str, e: float, setting: Setting) -> tuple[dict, list[dict]]:
    """A run and its growth, the phase error at its end as the median over neighbouring starts with its interval."""
    made, exact, _ = orbit(name, e)
    run, samples = runs.follow(c, made, exact, setting, ORBITS, None if c.adaptive else TIMEOUT)
    if run["status"] == OK and not c.adaptive:
        run |= runs.within_orbits(c, made, exact, setting.per_orbit)
    seconds = run.pop("seconds", inf)
    phase = samples[-1]["phase"] if run["status"] == OK else inf
    found, count = Median(phase, phase, phase), 1
    if DRAWN[0] <= phase <= DRAWN[1]:
        others = runs.draws(c, made, exact, setting, ORBITS) if seconds <= DEAR else iter(())
        found, count = settled(phase, others)
    run |= {"phase median": found.value, "phase, low": found.low, "phase, high": found.high}
    return run | {"starts": count}, samples


def settled(phase: float, others: Iterator[float]) -> tuple[Median, int]:
    """The median of a phase error and those from other starts, and how many there were; a factor SPREAD without any."""
    drawn = [phase, *islice(others, FIRST)]
    if len(drawn) == 1:
        return Median(phase, phase / SPREAD, phase * SPREAD), 1
    if max(drawn) > ALIKE * min(drawn):
        drawn += others
    return median(drawn), len(drawn)
