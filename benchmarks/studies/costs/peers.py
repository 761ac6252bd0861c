"""A peer's prepared run beside scripts of its package that do the same, timed in turns.

`calls`: a bare script that follows the package's documentation for repeated integrations: it resets the state in place
and calls the package's own function.  `translated`: heyoka with the fastest of equations written for it by hand
(`by_hand`), its own model of the motion, and the derivatives of H as they stand, all compiled in the same mode.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from phasebench.benchmarks.measure.timing import columns, median, ratio, time_in_turns
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.benchmarks.store.cells import Unavailable
from phasebench.reference.peers import heyoka_forms, peer, scipy
from phasebench.reference.peers.prepared import prepare_peer
from phasebench.reference.solvers.translate import translate

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem
    from phasebench.reference.peers.record import Peer

CALLS, TRANSLATION = "speed_calls", "speed_translation"
PROBLEM, T_END, STEPS, TOL = "kepler", 2.0, 100, 1e-9
#: A prepared run may take `FACTOR` times the seconds of the bare script, and `MORE` seconds.
FACTOR, MORE = 1.10, 0.2e-6
#: Calls in a round, and rounds.
REPEATS, ROUNDS = 100, 21
#: heyoka's largest ratio, tolerances, span in units of the problem's step, seconds of a round, rounds.
TRANSLATED, TOLERANCES, SPAN, ROUND, MANY = 1.05, (1e-4, 1e-12), 50, 2e-4, 201
#: Problems on which equations written by hand are known to be faster.
SLOWER = {
    "butane": "products of cross products, which by hand are products of dot products",
    "kerr": "the squares of its W are multiplied out by hand, and terms gathered over r^2",
}
Call = Callable[[], Any]


def _taylor(motion: list, start: np.ndarray, t_end: float, tol: float, **options: Any) -> Call:
    import heyoka as hy

    ta = hy.taylor_adaptive(motion, start, tol=tol, **options)

    def run() -> float:
        ta.time = 0.0
        ta.state[:] = start
        ta.propagate_until(t_end)
        return ta.time

    return run


def _heyoka(made: Problem) -> Call:
    import heyoka as hy

    x, y, vx, vy = hy.make_vars("x", "y", "vx", "vy")
    cubed = (x * x + y * y) ** -1.5
    motion = [(x, vx), (y, vy), (vx, -(x * cubed)), (vy, -(y * cubed))]
    return _taylor(motion, np.array([*made.q0, *made.p0]), T_END, TOL)


def _rebound(integrator: str, **options: Any) -> Callable[[Problem], Call]:
    def script(made: Problem) -> Call:
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

    return script


def _scipy(made: Problem) -> Call:
    from scipy.integrate import odeint

    from phasebench.reference.peers.field import compiled_field

    field, start = compiled_field(made.system), np.array([*made.q0, *made.p0])
    return lambda: odeint(field, start, (0.0, T_END), tfirst=True, rtol=TOL, atol=TOL, full_output=True)


#: Peer -> (its record, the bare script of a problem).
BARE: dict[str, tuple[Peer, Callable[[Problem], Call]]] = {
    "heyoka": (peer("heyoka"), _heyoka),
    "rebound-whfast-plain": (peer("rebound-whfast-plain"), _rebound("whfast", safe_mode=0)),
    "rebound-leapfrog": (peer("rebound-leapfrog"), _rebound("leapfrog")),
    "rebound-ias15": (peer("rebound-ias15"), _rebound("ias15", epsilon=TOL)),
    "scipy-odeint(LSODA)": (scipy.fast("odeint"), _scipy),
}


def _often(call: Call, times: int) -> Call:
    def repeat() -> None:
        for _ in range(times):
            call()

    return repeat


def calls(peer: str) -> dict:
    """Both times of an integration in microseconds, their ratio, the largest time allowed, and whether it is kept."""
    record, script = BARE[peer]
    made = problem_of(PROBLEM)
    run, bare = prepare_peer(made, record, tol=TOL if record.adaptive else None), script(made)
    size = (T_END,) if record.adaptive else (T_END / STEPS, STEPS)
    both = {"prepared": lambda: run.advance(*size), "bare": bare}
    times = time_in_turns({who: _often(call, REPEATS) for who, call in both.items()}, ROUNDS)
    prepared, alone = (median(times[who] / REPEATS).value for who in both)
    most = FACTOR * alone + MORE
    row = {"us, prepared": 1e6 * prepared, "us, bare script": 1e6 * alone}
    row |= columns("ratio", ratio(times["prepared"], times["bare"]))
    return row | {"us, at most": 1e6 * most, "within": bool(prepared <= most)}


def equations(made: Problem) -> Iterator[tuple[str, list, Callable[[np.ndarray], np.ndarray]]]:
    """Yield the ways to write a problem's equations for heyoka: (name, equations, (q, p) -> heyoka's state)."""
    import heyoka as hy

    from .by_hand import SIDES

    system = made.system
    variables = hy.make_vars(*(f"x{i}" for i in range(2 * system.d)))
    if made.id in SIDES:
        q, p = np.array(variables).reshape(2, -1)
        yield "by hand", list(zip(variables, SIDES[made.id](made, q, p), strict=True)), np.array
    for name in heyoka_forms.names(system)[1:]:
        form = heyoka_forms.form(system, name)
        yield f"model {name}", list(form.equations), form.put
    if made.id not in SIDES:
        known = dict(zip((*system.q, *system.p), variables, strict=True))
        sides = [translate(e, known, float) for e in (*system.dq, *system.dp)]
        yield "as it stands", list(zip(variables, sides, strict=True)), np.array


def translated(problem: str, tol: float) -> dict:
    """The fastest other way, both times of an integration in microseconds, their ratio and whether it is small."""
    made = problem_of(problem)
    t_end, y = SPAN * made.pace.step, np.array([*made.q0, *made.p0])
    run = prepare_peer(made, peer("heyoka"), tol=tol)
    compact = run._calls.keep.compact_mode
    ways: dict[str, Call] = {"suite": lambda: run.advance(t_end)}
    for name, motion, put in equations(made):
        ways[name] = _taylor(motion, put(y), t_end, tol, compact_mode=compact)
        if ways[name]() != t_end:
            raise Unavailable(f"heyoka did not come to the end with the equations {name}")
    repeats = max(1, int(ROUND / median(time_in_turns(ways, 3)["suite"]).value))
    times = time_in_turns({name: _often(call, repeats) for name, call in ways.items()}, MANY)
    best = min((name for name in ways if name != "suite"), key=lambda name: median(times[name]).value)
    ours, other = (1e6 * median(times[name] / repeats).value for name in ("suite", best))
    row = {"beside": best, "compact": compact, "us, suite": ours, "us, other": other}
    paid = ratio(times["suite"], times[best])
    return row | columns("ratio", paid) | {"within": bool(paid.low <= TRANSLATED)}
