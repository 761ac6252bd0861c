"""heyoka's Taylor series as peers: one orbit, and the same orbit in every lane of the processor's SIMD registers.

``high_accuracy`` sums the series with compensation.  ``compact_mode`` compiles faster and runs slower on small systems.
The peers use it above `taylor.COMPACT` variables; `compact` gives a peer with the mode that they do not use, to be
measured beside the others.

Integrators are kept by system and tolerance, so that a further run costs no compilation.  They are reset in place:
one thread at a time may run a peer of a system.

Source: F. Biscani, D. Izzo, Mon. Not. R. Astron. Soc. 504 (2021) 2614-2628.
"""

from __future__ import annotations

import time
from functools import lru_cache

import numpy as np

from phasebench.integrators.record import ROUND_OFF

from .record import NOT_FINITE, Claims, Peer, Run, Task

EPS = float(np.finfo(float).eps)
#: Integrators that are kept.
KEPT = 128
DOCUMENTATION = "https://bluescarni.github.io/heyoka.py/"


@lru_cache(maxsize=KEPT)
def _scalar(system, tol, **options):
    from phasebench.reference.solvers import taylor

    if not options and tol == EPS:
        return taylor.integrator(system, float, tol)
    import heyoka as hy

    plain = _scalar(system, EPS)
    return hy.taylor_adaptive(
        plain.sys, np.zeros(plain.dim), tol=tol, **({"compact_mode": plain.compact_mode} | options)
    )


@lru_cache(maxsize=KEPT)
def _batch(system, tol):
    import heyoka as hy

    one = _scalar(system, tol)
    zeros = np.zeros((one.dim, hy.recommended_simd_size()))
    return hy.taylor_adaptive_batch(one.sys, zeros, tol=one.tol, compact_mode=one.compact_mode)


def _run(**options):
    def run(task: Task) -> Run:
        from phasebench.reference.solvers import taylor

        ta = _scalar(task.system, task.tol, **options)
        taylor.start(ta, float, task.q, task.p)
        started = time.perf_counter()
        rows, steps, failure = taylor.propagate(ta, task.times)
        seconds = time.perf_counter() - started
        return Run.of_states(rows, steps, 0, seconds, failure)

    return run


def _run_batch(task: Task) -> Run:
    import heyoka as hy

    from phasebench.reference.solvers import taylor

    ta = _batch(task.system, task.tol)
    ta.set_time(0.0)
    ta.state[:] = task.state[:, None]
    grid = np.repeat(task.times[:, None], ta.batch_size, axis=1)
    started = time.perf_counter()
    _, states = ta.propagate_grid(grid, max_steps=taylor.STEP_LIMIT)
    seconds = time.perf_counter() - started  # of all lanes: that is how long one orbit takes
    rows = states[:, :, 0]
    outcome, _, _, steps = ta.propagate_res[0]
    why = {
        hy.taylor_outcome.time_limit: None,
        hy.taylor_outcome.err_nf_state: NOT_FINITE,
        hy.taylor_outcome.step_limit: f"{taylor.STEP_LIMIT} steps did not reach the end",
    }
    failure = why.get(outcome, f"heyoka stopped with {outcome}")
    if failure is None and not (states == rows[:, :, None]).all():
        rows, failure = rows[:1], f"the {ta.batch_size} lanes, which started alike, differ"
    return Run.of_states(rows, steps, 0, seconds, failure)


def _peer(id: str, name: str, run, more: str, **facts) -> Peer:
    return Peer(
        id,
        name,
        package="heyoka",
        adaptive=True,
        order=None,
        license="MPL-2.0",
        about="tol is the local error relative to the state and chooses the order of the series; the default is the "
        f"machine epsilon; compiled by LLVM; {more}",
        source="Biscani & Izzo 2021, Mon. Not. R. Astron. Soc. 504, 2614-2628",
        run=run,
        claims=Claims(
            energy=ROUND_OFF,
            source=f"{DOCUMENTATION}: machine precision is kept over tens of billions of steps (at the default tol); "
            "the attributes tol and order of an integrator: the order follows from the tolerance",
        ),
        tol=EPS,
        least=EPS / 2,
        **facts,
    )


def compact(high_accuracy: bool, on: bool = True) -> Peer:
    """heyoka with ``compact_mode`` on or off where it runs otherwise by default: no peer of the registry."""

    def lacks(problem, system) -> str | None:
        from phasebench.reference.solvers import taylor

        if on == (2 * system.d > taylor.COMPACT):
            return f"of {2 * system.d} variables '{name}' is the same: compact_mode is {'on' if on else 'off'}"
        return None

    name = "heyoka-high-accuracy" if high_accuracy else "heyoka"
    run = _run(high_accuracy=high_accuracy, compact_mode=on)
    label, mode = (f"{name}(compact_mode)", "") if on else (f"{name}(compact_mode=False)", "no ")
    return _peer(label, f"{SERIES}, {mode}compact mode", run, f"one orbit; {mode}compact_mode", lacks=lacks)


SERIES = "Taylor series of adaptive step and order, double precision"
PEERS = (
    _peer("heyoka", SERIES, _run(), "one orbit"),
    _peer(
        "heyoka-high-accuracy",
        f"{SERIES}, compensated",
        _run(high_accuracy=True),
        "one orbit; high_accuracy: the series is summed with compensation",
    ),
    _peer(
        "heyoka-batch",
        f"{SERIES}, SIMD lanes",
        _run_batch,
        "the same orbit in each of recommended_simd_size() lanes at once: seconds are of all lanes together, in which "
        "that many orbits could be had",
    ),
)
