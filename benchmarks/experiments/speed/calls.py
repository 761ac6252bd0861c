"""Overhead of running another package's integrator (a peer) through this project instead of calling it directly.

A prepared run, built and compiled once by this project, is timed in turns with a bare script.  The script follows the
package's documentation for repeated integrations: it resets the state in place and calls the package's own function.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from phasebench.benchmarks.measure.timing import median, ratio, time_in_turns
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import ALONE, Cell, ProblemKey, Rows, content
from phasebench.reference.peers import peer, scipy
from phasebench.reference.peers.prepared import prepare_peer

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem

PROBLEM, T_END, STEPS, TOL = "kepler", 2.0, 100, 1e-9
#: A prepared run may take `FACTOR` times the seconds of the bare script, and `MORE` seconds.
FACTOR, MORE = 1.10, 0.2e-6
#: Calls in a round, and rounds.
CALLS, ROUNDS = 100, 21
TABLE = "speed_calls"


def _heyoka(made: Problem) -> Callable[[], None]:
    import heyoka as hy

    x, y, vx, vy = hy.make_vars("x", "y", "vx", "vy")
    cubed = (x * x + y * y) ** -1.5
    start = np.array([*made.q0, *made.p0])
    ta = hy.taylor_adaptive([(x, vx), (y, vy), (vx, -(x * cubed)), (vy, -(y * cubed))], start, tol=TOL)

    def run() -> None:
        ta.time = 0.0
        ta.state[:] = start
        ta.propagate_until(T_END)

    return run


def _rebound(made: Problem, integrator: str, **options: Any) -> Callable[[], None]:
    import rebound

    sim = rebound.Simulation()
    sim.integrator = integrator
    for name, value in options.items():
        setattr(sim.integrator, name, value)
    sim.add(m=1.0)
    (x, y), (vx, vy) = made.q0, made.p0
    sim.add(m=0.0, x=x, y=y, vx=vx, vy=vy)
    start = np.zeros((2, 6))
    sim.serialize_particle_data(xyzvxvyvz=start)
    address, array = ctypes.byref(sim), start.ctypes.data_as(ctypes.POINTER(ctypes.c_double))
    first, put = sim.dt, rebound.clibrebound.reb_simulation_set_serialized_particle_data

    def run() -> None:
        sim.t = 0.0
        put(address, None, None, None, None, array)
        sim.did_modify_particles = 1
        if integrator == "ias15":
            sim.dt = first
            sim.integrate(T_END)
        else:
            sim.dt = T_END / STEPS
            sim.steps(STEPS)
            sim.synchronize()

    return run


def _scipy(made: Problem) -> Callable[[], None]:
    from scipy.integrate import odeint

    from phasebench.reference.peers.field import compiled_field

    field, start = compiled_field(made.system), np.array([*made.q0, *made.p0])

    def run() -> None:
        odeint(field, start, (0.0, T_END), tfirst=True, rtol=TOL, atol=TOL, full_output=True)

    return run


#: Peer -> (its record, whether it takes a tolerance, the bare script).
BARE: dict[str, tuple] = {
    "heyoka": (lambda: peer("heyoka"), True, _heyoka),
    "rebound-whfast-plain": (
        lambda: peer("rebound-whfast-plain"),
        False,
        lambda made: _rebound(made, "whfast", safe_mode=0),
    ),
    "rebound-leapfrog": (lambda: peer("rebound-leapfrog"), False, lambda made: _rebound(made, "leapfrog")),
    "rebound-ias15": (lambda: peer("rebound-ias15"), True, lambda made: _rebound(made, "ias15", epsilon=TOL)),
    "scipy-odeint(LSODA)": (lambda: scipy.fast("odeint"), True, _scipy),
}


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`), one for each peer (another package's integrator); none if ``quick``."""
    return [] if quick else [_cell(id) for id in BARE]


def _cell(id: str) -> Cell:
    record = BARE[id][0]()
    return Cell(
        "speed",
        (TABLE,),
        {"peer": id},
        measure_rows,
        (id,),
        content("calls", record, ProblemKey(PROBLEM), code=[__name__]),
        frozenset({id, record.package, PROBLEM}),
        ALONE,
        own=True,
    )


def measure_rows(id: str) -> Rows:
    """Time this project's call of a peer (another package's integrator) and a bare script of its package, in turns.

    Returns {table: [row]}: both times per integration in microseconds, their ratio with its interval, the largest time
    allowed, and whether the call is within it.
    """
    record, adaptive, script = BARE[id]
    made = problem(PROBLEM)
    run, bare = prepare_peer(made, record(), tol=TOL if adaptive else None), script(made)
    size = (T_END,) if adaptive else (T_END / STEPS, STEPS)

    def often(call: Callable[..., object], *arguments: Any) -> Callable[[], None]:
        def calls() -> None:
            for _ in range(CALLS):
                call(*arguments)

        return calls

    times = time_in_turns({"prepared": often(run.advance, *size), "bare": often(bare)}, ROUNDS)
    prepared, alone = (median(times[who] / CALLS) for who in ("prepared", "bare"))
    paid = ratio(times["prepared"], times["bare"])
    row = {"peer": id, "us, prepared": 1e6 * prepared.value, "us, bare script": 1e6 * alone.value}
    row |= {"ratio": paid.value, "ratio, low": paid.low, "ratio, high": paid.high}
    most = FACTOR * alone.value + MORE
    return {TABLE: [row | {"us, at most": 1e6 * most, "within": bool(prepared.value <= most)}]}
