"""Wisdom-Holman splittings beside REBOUND's, at equal steps: energy error, distance of the end states, cost of a step.

REBOUND's WHFast and SABA use Jacobi coordinates and the same splittings; safe_mode = 0 joins the drifts of neighbouring
steps and applies the corrector for output alone, as the methods here always do.  WHFast adds without compensation.
"""

from __future__ import annotations

from math import pi

import numpy as np

from phasebench.benchmarks.measure.timing import interleaved, ratio
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.outer_solar_system import BODIES, G
from phasebench.benchmarks.rows.cells import ALONE, Cell, Problem, Rows, Unavailable, content
from phasebench.integrators.driver import OK, integrate, warm
from phasebench.integrators.registry import BY_ID

#: Ours -> REBOUND's integrator and its options.
PAIRS = {
    "wisdom-holman": ("whfast", {}),
    "wisdom-holman-corrector": ("whfast", {"corrector": 17}),
    "wisdom-holman-saba-4": ("saba", {"type": "4"}),
    "wisdom-holman-aba-8-6-4": ("saba", {"type": "8_6_4"}),
    "wisdom-holman-aba-10-6-4": ("saba", {"type": "10_6_4"}),
}
#: Problem, its parameters, the steps, the time span.
CASES = {
    "perturbed-kepler, e = 0.2": ("perturbed-kepler", {"e": 0.2}, [2 * pi / n for n in (25, 50, 100)], 2000.0),
    "perturbed-kepler, e = 0.6": ("perturbed-kepler", {"e": 0.6}, [2 * pi / n for n in (50, 100, 200)], 2000.0),
    "outer-solar-system": ("outer-solar-system", {}, [50.0, 100.0, 200.0, 400.0], 500_000.0),
}
ROWS, TIMED, ROUNDS = 200, 5_000, 15


def _simulation(made, integrator, options, h):
    """A REBOUND simulation of a problem; the second object has to be kept alive while it runs."""
    from phasebench.reference.peers import particles as nbody

    options = {"safe_mode": 0} | options
    if made.id == "perturbed-kepler":
        sim, force = nbody.simulation(made, made.q0, made.p0, integrator, made.parameters["mu"], **options)
    else:
        import rebound

        sim, force = rebound.Simulation(), None
        sim.G = G
        sim.integrator = integrator
        for name, value in options.items():
            setattr(sim.integrator, name, value)
        for mass, (x, y, z), (vx, vy, vz) in BODIES.values():
            sim.add(m=mass, x=x, y=y, z=z, vx=vx, vy=vy, vz=vz)
    sim.dt = h
    return sim, force


def _states(made, sim):
    """(q, p) of a simulation."""
    if made.id == "perturbed-kepler":
        body = sim.particles[1]
        return [body.x, body.y], [body.vx, body.vy]
    q = [x for b in sim.particles for x in (b.x, b.y, b.z)]
    return q, [b.m * v for b in sim.particles for v in (b.vx, b.vy, b.vz)]


def _theirs(made, integrator, options, h, steps, every):
    """(q, p), each of shape (rows, d)."""
    sim, force = _simulation(made, integrator, options, h)
    rows = [(made.q0, made.p0)]
    for _ in range(steps // every):
        sim.steps(every)
        sim.synchronize()
        rows.append(_states(made, sim))
    del force
    q, p = zip(*rows, strict=True)
    return np.array(q), np.array(p)


def _energy_error(made, q, p):
    E = made.system.observe(made.system.H, q, p)
    return float(np.abs(E / E[0] - 1).max())


def cells(quick: bool = False) -> list[Cell]:
    """A cell for each pair and step on each problem; none of the quick tier."""
    return [] if quick else [_cell(case, ours, h) for case in CASES for ours in PAIRS for h in CASES[case][2]]


def _cell(case: str, ours: str, h: float) -> Cell:
    name, parameters, _, t_end = CASES[case]
    return Cell(
        "wisdom_holman",
        ("wisdom_holman",),
        {"problem": case, "method": ours, "h": h},
        measured,
        (case, ours, h),
        content("pair", BY_ID[ours], Problem(name, tuple(parameters.items())), PAIRS[ours], h, t_end, code=[__name__]),
        frozenset({name, ours, "rebound"}),
        ALONE,
        own=True,
    )


def measured(case: str, ours: str, h: float) -> Rows:
    """The same splitting by this project and by REBOUND; raises Unavailable without REBOUND."""
    try:
        import rebound  # noqa: F401
    except ImportError:
        raise Unavailable("REBOUND is not installed; pip install rebound") from None
    name, parameters, _, t_end = CASES[case]
    made, (integrator, options) = problem(name, **parameters), PAIRS[ours]
    steps = round(t_end / h / ROWS) * ROWS
    every = steps // ROWS
    s = integrate(made, ours, h=h, steps=steps, save_every=every)
    if s.status != OK:
        raise RuntimeError(f"{ours} on {case}: {s.reason}")
    q, p = _theirs(made, integrator, options, h, steps, every)
    sim, force = _simulation(made, integrator, options, h)
    run = {"ours": warm(made, ours, h=h, steps=TIMED), "theirs": lambda: (sim.steps(TIMED), sim.synchronize())}
    times = interleaved(run, ROUNDS)
    del force
    size = np.abs(q).max()
    row = {
        "problem": case,
        "method": ours,
        "REBOUND's": " ".join([integrator, *(f"{k} {v}" for k, v in options.items())]),
        "h": h,
        "steps": steps,
        "energy error": _energy_error(made, s.q, s.p),
        "REBOUND's energy error": _energy_error(made, q, p),
        "distance of early positions": float(np.abs(s.q[: ROWS // 10] - q[: ROWS // 10]).max() / size),
        "distance of end positions": float(np.abs(s.q[-1] - q[-1]).max() / size),
        "ns per step": float(np.median(times["ours"]) / TIMED * 1e9),
        "REBOUND's ns per step": float(np.median(times["theirs"]) / TIMED * 1e9),
        "time ratio": ratio(times["ours"], times["theirs"]).value,
    }
    return {"wisdom_holman": [row]}
