"""Kepler with the Schwarzschild term and without, beside the established integrators.

To 10^4 orbits at e = 0, 0.2, 0.6 and 0.9: the errors in energy, angular momentum, phase and perihelion at equal steps
and at equal time, and the advance of the perihelion (`kepler`).  To 100.5 orbits, at an apocentre, where a phase error
is not multiplied by the speed of a pericentre: the error of the state against the cost.

mu is that of the talk (0.0075) at e = 0.6 and scales with L^4, so that the first-order advance is the same at every e;
with one mu for all, the term would be most of the force at the pericentre of e = 0.9.
"""

from __future__ import annotations

import statistics
from math import pi

import numpy as np
import pytest

from phasebench.benchmarks.experiments.kepler import kepler
from phasebench.benchmarks.experiments.kepler.kepler import LONGEST, STANDARD, Contender
from phasebench.benchmarks.measure import metrics
from phasebench.benchmarks.measure.accuracy import end_state
from phasebench.benchmarks.problems import problem
from phasebench.integrators.driver import OK, SKIPPED
from phasebench.reference.solvers import taylor

PROBLEMS = ("kepler", "perturbed-kepler")
ECCENTRICITIES = (0.0, 0.2, 0.6, 0.9)
#: The strength and the eccentricity that fix L^4 / mu for all.
MU, AT = 0.0075, 0.6
LAM = (("lam", "1/3"),)
ZERO = (("lam", "0"),)
#: The curves of a figure of each name; "" is in the tables alone.
GROUPS = {
    "low order": (
        Contender("scheme-i", LAM),
        Contender("scheme-ii", LAM),
        Contender("scheme-iii", LAM),
        Contender("scheme-iii", ZERO),
        Contender("scheme-iv"),
        Contender("scheme-v"),
        Contender("rebound-leapfrog", peer=True),
    ),
    "high order": (
        Contender("scheme-iii-suzuki-4", ZERO),
        Contender("scheme-iii-yoshida-6", ZERO),
        Contender("scheme-iii-sofroniou-spaletta-8", ZERO),
        Contender("gauss-8"),
        Contender("wisdom-holman"),
        Contender("rebound-whfast", peer=True),
        Contender("rebound-ias15", peer=True),
        Contender("heyoka", peer=True),
    ),
    "": (
        Contender("stormer-verlet"),
        Contender("wisdom-holman-aba-10-6-4"),
        Contender("scheme-iii-sofroniou-spaletta-10", ZERO),
    ),
}
QUICK = ("scheme-iii", "scheme-v", "scheme-iii-suzuki-4", "rebound-whfast", "rebound-ias15", "heyoka")
#: Whose time an orbit is everybody's in the comparison at equal time, over EQUAL orbits; the second where the first
#: cannot run.
YARDSTICKS = (Contender("rebound-ias15", peer=True), Contender("gauss-8"))
EQUAL = 10_000
#: Finer settings, and a still finer one for e = 0.9: taken where the run is estimated at no more than LONGEST seconds.
FINER, FINEST = 600, 2400
#: Seconds after which a run of this project stops.
TIMEOUT = 20.0


def _adaptive(contender: Contender) -> bool:
    return contender.peer and contender.chosen.adaptive


def _cost(contender, made, exact, per_orbit: int, rounds: int) -> float:
    """Seconds an orbit."""
    n = 1 if _adaptive(contender) else per_orbit
    return kepler.seconds_per_orbit(contender, made, exact.period, n, 20, rounds)


def _steps_at(contender, made, exact, seconds: float, guess: float, rounds: int) -> int:
    """The even number of steps an orbit, of two digits, that costs so many seconds; ``guess`` is seconds a step."""
    n = STANDARD
    for _ in range(2):  # an implicit step costs more where it is longer
        n = min(max(10, 2 * round(float(f"{seconds / guess:.2g}") / 2)), 20_000)
        found = _cost(contender, made, exact, n, rounds) / n
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


@pytest.mark.parametrize("e", ECCENTRICITIES)
@pytest.mark.parametrize("name", PROBLEMS)
def bench_kepler(name, e, results, quick):
    """The four errors to 10^4 orbits, and the perihelion's advance; an orbit is a radial period."""
    if quick and e != AT:
        pytest.skip("the quick tier takes one eccentricity")
    orbits, rounds = (10, 1) if quick else (10_000, 3)
    mu = MU * ((1 - e**2) / (1 - AT**2)) ** 2 if name == "perturbed-kepler" else 0.0
    made = problem(name, e=e, **({"mu": mu} if mu else {}))
    exact = kepler.truth(made)
    about = {"problem": name, "e": e, "mu": mu, "period": exact.period}
    about |= {"closed form": exact.advance, "first order": kepler.first_order_advance(float(exact.L), mu)}

    def add(label, kind, group, setting, per_orbit, seconds, run, samples):
        one = {"method": label, "kind": kind, "group": group, "setting": setting}
        run = {"steps per orbit": per_orbit, "us per orbit": seconds * 1e6} | run
        results.add("kepler", [about | one | run])
        results.add("kepler_growth", [{"problem": name, "e": e} | one | s | {"status": run["status"]} for s in samples])

    add("Taylor, long double", "reference", "", "reference", None, float("nan"), *_reference(made, exact, orbits))
    yard, budget = next(
        (c, seconds) for c in YARDSTICKS if np.isfinite(seconds := _cost(c, made, exact, STANDARD, rounds))
    )
    for group, members in GROUPS.items():
        for c in members:
            if quick and c.id not in QUICK:
                continue
            kind = c.chosen.package if c.peer else "phasebench"
            if _adaptive(c):
                seconds = budget if c == yard else _cost(c, made, exact, STANDARD, rounds)
                add(c.chosen.label, kind, group, "adaptive", None, seconds, *kepler.follow(c, made, exact, 2, orbits))
                continue
            # The cost of a step: where the standard one is too long, of a shorter one.
            costs = {n: _cost(c, made, exact, n, rounds) / n for n in (STANDARD, FINEST)[: 2 if e > AT else 1]}
            step = next((s for s in costs.values() if np.isfinite(s)), np.nan)
            settings = [(f"{STANDARD} steps", STANDARD, orbits)]
            for n in (FINER, FINEST) if e > AT else (FINER,):
                if not quick and step * n * orbits <= LONGEST:
                    settings.append((f"{n} steps", n, orbits))
            if np.isfinite(step):
                n = _steps_at(c, made, exact, budget, step, rounds)
                settings.append((f"time of {yard.id}", n, min(orbits, EQUAL)))
            for setting, n, length in settings:
                run, samples = kepler.follow(c, made, exact, n, length, TIMEOUT)
                if run["status"] == OK:
                    run |= kepler.within_orbits(c, made, exact, n)
                add(c.chosen.label, kind, group, setting, n, _cost(c, made, exact, n, rounds), run, samples)
                if run["status"] == SKIPPED:
                    break
    mine = [r for r in results.measured["kepler_growth"] if (r["problem"], r["e"]) == (name, e)]
    away = max(r["phase"] for r in mine if r["kind"] == "reference")
    assert away < 1e-9, f"the closed form and the Taylor series part by {away:.2e} radians: one of them is wrong"
    best = min(r["phase"] for r in mine if r["orbits"] == orbits + 0.5 and r["kind"] != "reference")
    assert best < 1e-6, f"the best phase error is {best:.2e}: nobody follows the orbit"


ORBITS = 100.5
PER_ORBIT = (100, 300, 1000, 3000)
OURS = (
    Contender("stormer-verlet"),
    Contender("implicit-midpoint"),
    Contender("scheme-i", LAM),
    Contender("scheme-ii", LAM),
    Contender("scheme-iii", LAM),
    Contender("scheme-iv"),
    Contender("scheme-v"),
    Contender("avf"),
    Contender("rk4"),
    Contender("scheme-iii-yoshida-4", LAM),
    Contender("scheme-iii-suzuki-4", ZERO),
    Contender("scheme-iii-yoshida-6", ZERO),
    Contender("scheme-iii-sofroniou-spaletta-8", ZERO),
    Contender("scheme-v-suzuki-4"),
    Contender("gauss-8"),
    Contender("wisdom-holman-aba-10-6-4"),
)
FIXED = ("rebound-whfast", "rebound-saba-10-6-4", "rebound-leapfrog", "rebound-leapfrog-8")
ADAPTIVE = ("rebound-ias15", "rebound-bs", "heyoka", "scipy-dop853")
TOLERANCES = (1e-6, 1e-9, 1e-12, 1e-15)
#: A run of so many seconds is timed once.
LONG = 0.2
CHEAP = ("stormer-verlet", "scheme-iii", "scheme-v", "scheme-iii-suzuki-4")


@pytest.mark.parametrize("name", PROBLEMS)
def bench_kepler_cost(name, results, quick):
    """Error of the state at an apocentre against warm time, over steps and tolerances."""
    found = problem(name)
    t_end = (10.5 if quick else ORBITS) * 2 * pi
    truth = taylor.reference(found, [t_end])
    exact = end_state(truth)
    system, rounds = found.system, 1 if quick else 3

    def row(contender, setting, run):
        kind = contender.chosen.package if contender.peer else "phasebench"
        out = {
            "problem": found.label,
            "e": found.parameters["e"],
            "orbits": t_end / (2 * pi),
            "method": contender.chosen.label,
            "kind": kind,
            "setting": setting,
        }
        solution = run(1)
        out |= {"status": solution.status, "reason": solution.reason, "steps": solution.counts.get("steps", 0)}
        if solution.status != OK:
            return out
        H = system.observe(system.H, solution.q, solution.p)
        L = system.observe(found.invariants["angular-momentum"], solution.q, solution.p)
        error = np.abs(end_state(solution) - exact).max()
        return out | {
            "error": float(error),
            "reference uncertainty": float(truth.uncertainty[-1]),
            "energy error": float(metrics.invariant_error(H).max),
            "angular momentum error": float(metrics.invariant_error(L).max),
            "seconds": statistics.median(run(0).seconds for _ in range(rounds if solution.seconds < LONG else 1)),
        }

    rows = []
    for n in PER_ORBIT[: 2 if quick else None]:
        h = 2 * pi / n
        steps = round(t_end / h)
        ours = [c for c in OURS if not quick or c.id in CHEAP]
        for c in (*ours, *(Contender(id, peer=True) for id in FIXED)):
            rows.append(
                row(c, f"{n} steps an orbit", lambda every, c=c, h=h, steps=steps: c.run(found, h, steps, every))
            )
    for id in ADAPTIVE:
        c = Contender(id, peer=True)
        least = 1e-13 if c.chosen.package == "scipy" else c.chosen.least
        for tol in (t for t in TOLERANCES if t >= least):
            rows.append(
                row(
                    c,
                    f"tolerance {tol:g}",
                    lambda every, c=c, tol=tol: c.run(
                        found, t_end / 200 if every else t_end, 200 if every else 1, every, tol=tol
                    ),
                )
            )
    results.add("kepler_cost", rows)
    theirs = [r["error"] for r in rows if r["kind"] != "phasebench" and r["status"] == OK]
    assert theirs, "nothing could be compared"
    assert min(theirs) < 1e-6, f"no peer comes near the reference (best {min(theirs):.2e}): one is of another problem"
