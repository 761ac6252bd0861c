"""Integrates a problem with a peer, an integrator of another package: checks the input, runs it, finds the status."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from phasebench.integrators.errors import InvalidInput
from phasebench.reference.installed import how_to_install

from . import floating
from .record import Peer, Run, Task
from .run import ending

if TYPE_CHECKING:
    from phasebench.integrators.keywords import State
    from phasebench.integrators.solution import Solution


def integrate_peer(
    problem: Any,
    peer_id: str | Peer,
    *,
    h: float | None = None,
    tol: float | None = None,
    t_end: float | None = None,
    steps: int | None = None,
    t0: float = 0.0,
    save_every: int = 1,
    q0: State | None = None,
    p0: State | None = None,
) -> Solution:
    """Integrate ``problem`` with a peer, an integrator of another package.

    The process's floating-point environment is restored afterwards.

    Parameters
    ----------
    problem : a problem, or a system if q0 and p0 are given
    peer_id : an id in `PEERS` or a record
    h, t_end, steps : two of them, as for `integrators.integrate`; for an adaptive peer they set the grid of its output,
        and t_end alone gives start and end.  A t_end before t0 goes back in time
    t0 : the time at the start; the system does not depend on it
    tol : an adaptive peer's tolerance
    save_every : save every Nth state of the grid, and the last; 0 saves the first and the last
    q0, p0 : arrays (d,), the initial state if not the problem's

    Returns
    -------
    integrators.driver.Solution
        ``h`` is the grid's spacing.  ``counts``: steps as the peer counts them, gradient if it counts evaluations of
        the right-hand side, 0 for unknown counts.  Status "skipped" if its package is not installed.

    Raises
    ------
    InvalidInput
        For unusable input, or a problem that the peer is not applicable to.
    """
    from phasebench.integrators.driver import SKIPPED, Solution
    from phasebench.integrators.request import request

    from .registry import peer

    integrator = peer(peer_id)
    lack = integrator.lacks(problem, getattr(problem, "system", problem))
    if lack:
        raise InvalidInput(f"'{integrator.id}' cannot do this: {lack}")
    tol = integrator.tolerance(tol)
    if integrator.adaptive and h is None and steps is None:
        steps = 1
    asked = request(problem, h=h, t_end=t_end, steps=steps, q0=q0, p0=p0, save_every=save_every, t0=t0)
    if integrator.ahead and asked.h < 0:
        raise InvalidInput(f"'{integrator.id}' goes ahead in time alone: a negative step is refused")
    system, numbers = asked.system, asked.step_numbers
    times = np.array([asked.h * n for n in numbers])
    task = Task(problem, system, asked.q, asked.p, asked.h, numbers, times, tol)
    try:
        with floating.restore_environment():
            integrator.load(integrator.package)
            run = integrator.run(task)
    except ImportError as error:
        run = Run.stuck(task, 0, 0, 0.0)
        how = how_to_install(integrator.package)
        status, reason = SKIPPED, f"{integrator.package} cannot be imported ({error}); {how}"
    else:
        status, reason, rows = ending(system, asked.t0 + times, run.q, run.p, run.failure)
        run = run._replace(q=run.q[:rows], p=run.p[:rows])
    q, p = (np.ascontiguousarray(x, dtype=float) for x in (run.q, run.p))
    counts = {"steps": int(run.steps), "gradient": int(run.gradient), "hessian": 0, "iterations": 0, "fallbacks": 0}
    unknown = np.full(len(q) - 1, np.nan)
    t = asked.t0 + times[: len(q)]
    return Solution(t, q, p, status, reason, counts, asked.h, integrator, unknown, run.seconds, problem)
