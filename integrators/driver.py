"""Integrate a problem with a method: check the input, run its kernel, determine the status (`outcome`).

A kernel is the compiled loop over the steps of a method; it is called for some steps at a time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from phasebench.integrators.compile import codegen
from phasebench.integrators.compile.codegen import DOUBLE, MULTIPRECISION
from phasebench.integrators.stepping.kernel import prepare

from . import prepared
from .errors import InvalidInput
from .outcome import (  # noqa: F401
    COLLISION,
    DIVERGED,
    INACCURATE,
    INVALID,
    NO_ROOT,
    NOT_CONVERGED,
    OK,
    SKIPPED,
    TIMEOUT,
    UNSTABLE,
    solver_failure,
)
from .record import Method
from .registry import method as method_of
from .request import check_timeout, grid, initial, request, spacing
from .solution import Solution
from .trajectory import FIRST, PIECE, Pace, Trajectory

if TYPE_CHECKING:
    import numpy as np

    from phasebench.integrators.stepping.kernel import Prepared


def integrate(
    problem: Any,
    method: str | Method,
    *,
    h: float | None = None,
    t_end: float | None = None,
    steps: int | None = None,
    t0: float = 0.0,
    q0: Sequence[Any] | np.ndarray | None = None,
    p0: Sequence[Any] | np.ndarray | None = None,
    save_every: int = 1,
    parameters: dict | None = None,
    arithmetic: str = DOUBLE,
    timeout: float | None = None,
    progress: Callable[[int], None] | None = None,
) -> Solution:
    """Integrate ``problem`` with ``method``.

    Parameters
    ----------
    problem : a system, or an object with ``system`` and initial data ``q0``, ``p0``
    method : an id or a method
    h, t_end, steps : two of the three: step, time of the end, number of steps.  Given h and t_end, h is adjusted so
        that a whole number of steps ends at t_end, upwards by no more than 1 %.  A t_end before t0, or a negative h
        with steps, goes back in time
    t0 : the time at the start, which labels the rows, and counts where H depends on time
    q0, p0 : arrays (d,), the initial state if not the problem's
    save_every : store every Nth state, and the last; 0 stores the first and the last
    parameters : values of the method's parameters
    arithmetic : "double", or "multiprecision" with the digits that `codegen.precision` sets (needs NUMBA_DISABLE_JIT=1)
    timeout : seconds after which the integration stops with status "timeout"; the last row is what was reached
    progress : called with the number of steps taken so far

    Returns
    -------
    Solution

    Raises
    ------
    InvalidInput
        For input that cannot be used; what happens on the way (a blow-up, a stage not solved) is a status.
    """
    record = method_of(method, **(parameters or {}))
    multi = arithmetic == MULTIPRECISION
    if multi and codegen.compiled():
        raise InvalidInput("multiprecision runs need a process with NUMBA_DISABLE_JIT=1")
    check_timeout(timeout)
    if multi:
        _, steps = grid(h, t_end, steps, t0)
        every = spacing(save_every, steps)
        if t_end is None:
            h = codegen.to_number(h, arithmetic)
        else:
            h = (codegen.to_number(t_end, arithmetic) - codegen.to_number(t0, arithmetic)) / steps
        system, q, p = initial(problem, q0, p0, exact=True)
        q, p = codegen.vector(q), codegen.vector(p)
    else:
        system, q, p, h, steps, every, t0 = request(
            problem, h=h, t_end=t_end, steps=steps, q0=q0, p0=p0, save_every=save_every, t0=t0, tangent=record.tangent
        )
    lack = record.lacks(system)
    if lack:
        raise InvalidInput(lack)
    kernel = prepare(record, system, arithmetic)
    words = kernel.missed, solver_failure(record.family, system.d)
    trajectory = Trajectory(system, q, p, h, steps, every, arithmetic, *words, t0=t0)
    return _run(kernel, trajectory, record, timeout, progress, problem)


def warm(
    problem: Any, method: str | Method, *, h: float, steps: int, parameters: dict | None = None
) -> Callable[[], tuple]:
    """Compile the method for the problem, and return a function without arguments to be timed.

    Each call integrates ``steps`` steps of h from the problem's initial state and returns the end state (q, p).  The
    exceptions are those of `prepared.prepare`.
    """
    run = prepared.prepare(problem, method, parameters=parameters)
    return lambda: run(h, steps)[:2]


def _run(
    kernel: Prepared,
    trajectory: Trajectory,
    record: Method,
    timeout: float | None,
    progress: Callable[[int], None] | None,
    problem: Any,
) -> Solution:
    """Run the kernel until all rows of the trajectory are filled or the run stops; returns the `Solution`."""
    t = trajectory
    run = prepared.lay_out(kernel, t.system.d, t.h, t.q[0], t.p[0], t.arithmetic)
    counts, pace = run.counts, Pace(timeout, FIRST if kernel.missed else PIECE, progress)
    while t:
        t.advance(run, pace)
        pace.tell(t.reached)
    counted = dict(zip(counts.dtype.names, counts.item(), strict=True))
    t.conclude(timeout, counted["fallbacks"])
    tally = kernel.tally(t.reached, *(counted[name] for name in ("gradient", "fallbacks", "newton")))
    n = t.filled
    Q, P, parameter = t.q[: n + 1], t.p[: n + 1], t.parameter[:n, 0]
    return Solution(t.times, Q, P, t.status, t.reason, tally, t.h, record, parameter, t.seconds, problem)
