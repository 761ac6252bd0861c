"""heyoka's Taylor series as peers: one orbit, and the same orbit in every lane of the processor's SIMD registers.

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
def _scalar(system, tol):
    from phasebench.reference.solvers import taylor

    return taylor.integrator(system, float, tol)


@lru_cache(maxsize=KEPT)
def _batch(system, tol):
    import heyoka as hy

    one = _scalar(system, tol)
    zeros = np.zeros((one.dim, hy.recommended_simd_size()))
    return hy.taylor_adaptive_batch(one.sys, zeros, tol=one.tol, compact_mode=one.compact_mode)


def _run(task: Task) -> Run:
    from phasebench.reference.solvers import taylor

    ta = _scalar(task.system, task.tol)
    taylor.start(ta, float, task.q, task.p)
    started = time.perf_counter()
    rows, steps, failure = taylor.propagate(ta, task.times)
    seconds = time.perf_counter() - started
    return Run.of_states(rows, steps, 0, seconds, failure)


def _run_batch(task: Task) -> Run:
    import heyoka as hy

    from phasebench.reference.solvers import taylor

    ta = _batch(task.system, task.tol)
    lanes = ta.batch_size
    ta.set_time(0.0)
    ta.state[:] = task.state[:, None]
    grid = np.repeat(task.times[:, None], lanes, axis=1)
    started = time.perf_counter()
    _, states = ta.propagate_grid(grid, max_steps=taylor.STEP_LIMIT)
    seconds = (time.perf_counter() - started) / lanes
    rows = states[:, :, 0]
    outcome, _, _, steps = ta.propagate_res[0]
    why = {
        hy.taylor_outcome.time_limit: None,
        hy.taylor_outcome.err_nf_state: NOT_FINITE,
        hy.taylor_outcome.step_limit: f"{taylor.STEP_LIMIT} steps did not reach the end",
    }
    failure = why.get(outcome, f"heyoka stopped with {outcome}")
    if failure is None and not (states == rows[:, :, None]).all():
        rows, failure = rows[:1], f"the {lanes} lanes, which started alike, differ"
    return Run.of_states(rows, steps, 0, seconds, failure)


def _peer(id: str, name: str, run, more: str) -> Peer:
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
    )


PEERS = (
    _peer("heyoka", "Taylor series of adaptive step and order, double precision", _run, "one orbit"),
    _peer(
        "heyoka-batch",
        "Taylor series of adaptive step and order, double precision, SIMD lanes",
        _run_batch,
        "the same orbit in each of recommended_simd_size() lanes at once: seconds are of all, divided by the lanes",
    ),
)
