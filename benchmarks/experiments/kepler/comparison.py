"""Kepler with the Schwarzschild term and without, beside the established integrators.

To 10^4 orbits at e = 0, 0.2, 0.6 and 0.9: the errors in energy, angular momentum, phase and perihelion at equal steps
and at equal time, and the advance of the perihelion (`kepler`).  To 100.5 orbits, at an apocentre, where a phase error
is not multiplied by the speed of a pericentre: the error of the state against the cost.

mu is that of the talk (0.0075) at e = 0.6 and scales with L^4, so that the first-order advance is the same at every e;
with one mu for all, the term would be most of the force at the pericentre of e = 0.9.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from phasebench.benchmarks.measure.integrator import Integrator, integrator
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.rows.cells import ALONE, Cell, Problem, Rows, content
from phasebench.integrators.driver import OK, SKIPPED
from phasebench.reference.solvers import taylor

from . import kepler
from .kepler import LONGEST, STANDARD

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
    ),
    "": (
        integrator("stormer-verlet"),
        integrator("wisdom-holman-aba-10-6-4"),
        integrator("scheme-iii-sofroniou-spaletta-10", lam="0"),
    ),
}
#: Whose time an orbit is everybody's in the comparison at equal time, over EQUAL orbits; the second where the first
#: cannot run.
YARDSTICKS = (integrator("rebound-ias15"), integrator("gauss-8"))
EQUAL = 10_000
#: Finer settings, and a still finer one for e = 0.9: taken where the run is estimated at no more than LONGEST seconds.
FINER, FINEST = 600, 2400
#: Seconds after which a run of this project stops.
TIMEOUT = 20.0


#: Orbits of the long runs, rounds of a time.
ORBITS, ROUNDS = 10_000, 3
TAYLOR = "Taylor, long double"


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
        ALONE,
    )


@cache
def _orbit(name: str, e: float):
    """The problem, its exact solution, and what the rows say of them."""
    mu = MU * ((1 - e**2) / (1 - AT**2)) ** 2 if name == "perturbed-kepler" else 0.0
    made = problem(name, e=e, **({"mu": mu} if mu else {}))
    exact = kepler.truth(made)
    about = {"problem": name, "e": e, "mu": mu, "period": exact.period}
    about |= {"closed form": exact.advance, "first order": kepler.first_order_advance(float(exact.L), mu)}
    return made, exact, about


@cache
def _yardstick(name: str, e: float) -> tuple[Integrator, float]:
    """Whose time an orbit is everybody's, and that time."""
    made, exact, _ = _orbit(name, e)
    costs = ((c, _cost(c, made, exact, STANDARD)) for c in YARDSTICKS)
    return next((c, seconds) for c, seconds in costs if np.isfinite(seconds))


def _cost(contender: Integrator, made, exact, per_orbit: int) -> float:
    """Seconds an orbit."""
    return kepler.seconds_per_orbit(contender, made, exact.period, 1 if contender.adaptive else per_orbit, 20, ROUNDS)


def _steps_at(contender, made, exact, seconds: float, guess: float) -> int:
    """The even number of steps an orbit, of two digits, that costs so many seconds; ``guess`` is seconds a step."""
    n = STANDARD
    for _ in range(2):  # an implicit step costs more where it is longer
        n = min(max(10, 2 * round(float(f"{seconds / guess:.2g}") / 2)), 20_000)
        found = _cost(contender, made, exact, n) / n
        guess = found if np.isfinite(found) else guess
    return n


def _reference(made, exact, orbits: int):
    """The certified Taylor series, as a run: what is left of the errors is the measurement's own."""
    index = [2 * k + 1 for k in kepler.sample_orbits(orbits)]
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


def _rows(about: dict, one: dict, per_orbit: int | None, seconds: float, run: dict, samples: list[dict]) -> Rows:
    """The row of a run and those of its growth."""
    row = about | one | {"steps per orbit": per_orbit, "us per orbit": seconds * 1e6} | run
    where = {"problem": about["problem"], "e": about["e"]} | one
    return {"kepler": [row], "kepler_growth": [where | s | {"status": run["status"]} for s in samples]}


def reference(name: str, e: float) -> Rows:
    """The rows of the Taylor series."""
    made, exact, about = _orbit(name, e)
    one = {"method": TAYLOR, "kind": "reference", "group": "", "setting": "reference"}
    return _rows(about, one, None, float("nan"), *_reference(made, exact, ORBITS))


def followed(name: str, e: float, group: str, position: int) -> Rows:
    """The rows of an integrator: the four errors and the perihelion's advance; an orbit is a radial period."""
    made, exact, about = _orbit(name, e)
    c = GROUPS[group][position]
    one = {"method": c.label, "kind": c.kind, "group": group}
    if c.adaptive:
        yard, budget = _yardstick(name, e)
        seconds = budget if c == yard else _cost(c, made, exact, STANDARD)
        return _rows(about, one | {"setting": "adaptive"}, None, seconds, *kepler.follow(c, made, exact, 2, ORBITS))
    out: Rows = {"kepler": [], "kepler_growth": []}
    for setting, n, length in _settings(c, name, e):
        run, samples = kepler.follow(c, made, exact, n, length, TIMEOUT)
        if run["status"] == OK:
            run |= kepler.within_orbits(c, made, exact, n)
        rows = _rows(about, one | {"setting": setting}, n, _cost(c, made, exact, n), run, samples)
        out = {table: [*before, *rows[table]] for table, before in out.items()}
        if run["status"] == SKIPPED:
            break
    return out


def _settings(c: Integrator, name: str, e: float) -> list[tuple[str, int, int]]:
    """(what it is called, steps an orbit, orbits) of the runs of a fixed step: equal steps, finer ones, equal time."""
    made, exact, _ = _orbit(name, e)
    yard, budget = _yardstick(name, e)
    # The cost of a step: where the standard one is too long, of a shorter one.
    costs = [_cost(c, made, exact, n) / n for n in (STANDARD, FINEST)[: 2 if e > AT else 1]]
    step = next((s for s in costs if np.isfinite(s)), np.nan)
    finer = [n for n in ((FINER, FINEST) if e > AT else (FINER,)) if step * n * ORBITS <= LONGEST]
    settings = [(f"{n} steps", n, ORBITS) for n in (STANDARD, *finer)]
    if np.isfinite(step):
        settings.append((f"time of {yard.id}", _steps_at(c, made, exact, budget, step), min(ORBITS, EQUAL)))
    return settings
