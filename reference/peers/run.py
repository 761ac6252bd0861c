"""A peer's run: the input checked, the rows checked, and how it ended."""

from __future__ import annotations

from math import isfinite
from numbers import Real

import numpy as np

from phasebench.integrators.errors import InvalidInput

from . import floating
from .record import NOT_FINITE, Peer, Run, Task

#: On a singular system a change of the energy by more than this many times itself is a collision.
LOST = 10.0


def integrate_peer(
    problem,
    peer_id: str | Peer,
    *,
    h: float | None = None,
    tol: float | None = None,
    t_end: float | None = None,
    steps: int | None = None,
    t0: float = 0.0,
    save_every: int = 1,
    q0=None,
    p0=None,
):
    """Integrate ``problem`` with a peer, and leave the process's floating-point environment as it was before.

    Parameters
    ----------
    problem : a problem, or a system where q0 and p0 are given
    peer_id : an id of `PEERS` or a record
    h, t_end, steps : two of them, as for `integrators.integrate`; for an adaptive peer they make the grid of its
        output, and t_end alone gives start and end.  A t_end before t0 goes back in time
    t0 : the time at the start; the system does not depend on it
    tol : an adaptive peer's tolerance
    save_every : keep every so many-th state of the grid, and the last; 0 keeps the first and the last
    q0, p0 : arrays (d,), the initial state where not the problem's

    Returns
    -------
    integrators.driver.Solution
        ``h`` is the grid's spacing.  ``counts``: steps as the peer counts them, gradient where it tells its
        evaluations of the right-hand side, 0 for what it does not tell.  Status "skipped" where its package is
        missing.

    Raises
    ------
    InvalidInput
        For input that cannot be used, or a problem that the peer cannot do.
    """
    from phasebench.integrators.driver import SKIPPED, Solution
    from phasebench.integrators.request import request

    from . import peer

    integrator = peer(peer_id)
    lack = integrator.lacks(problem, getattr(problem, "system", problem))
    if lack:
        raise InvalidInput(f"'{integrator.id}' cannot do this: {lack}")
    tol = tolerance(integrator, tol)
    if integrator.adaptive and h is None and steps is None:
        steps = 1
    asked = request(problem, h=h, t_end=t_end, steps=steps, q0=q0, p0=p0, save_every=save_every, t0=t0)
    if integrator.ahead and asked.h < 0:
        raise InvalidInput(f"'{integrator.id}' goes ahead in time alone: {integrator.package} refuses a negative step")
    system, numbers = asked.system, asked.step_numbers
    times = np.array([asked.h * n for n in numbers])
    task = Task(problem, system, asked.q, asked.p, asked.h, numbers, times, tol)
    try:
        with floating.kept():
            integrator.load(integrator.package)
            run = integrator.run(task)
    except ImportError as error:
        run = Run.stuck(task, 0, 0, 0.0)
        status, reason = SKIPPED, f"{integrator.package} cannot be imported ({error}); pip install {integrator.package}"
    else:
        status, reason, rows = ending(system, asked.t0 + times, run.q, run.p, run.failure)
        run = run._replace(q=run.q[:rows], p=run.p[:rows])
    q, p = (np.ascontiguousarray(x, dtype=float) for x in (run.q, run.p))
    counts = {"steps": int(run.steps), "gradient": int(run.gradient), "hessian": 0, "iterations": 0, "fallbacks": 0}
    unknown = np.full(len(q) - 1, np.nan)
    t = asked.t0 + times[: len(q)]
    return Solution(t, q, p, status, reason, counts, asked.h, integrator, unknown, run.seconds, problem)


def ending(system, times, q, p, failure: str | None) -> tuple[str, str, int]:
    """How rows of q and p at the first of the ``times`` ended: the status, the reason, and how many rows are good."""
    from phasebench.integrators.outcome import COLLISION, DIVERGED, energy_unit, judged

    finite = np.isfinite(q).all(axis=1) & np.isfinite(p).all(axis=1)
    rows = len(q) if finite.all() else int(np.argmin(finite))
    if rows < len(times):
        why = (failure or NOT_FINITE).rstrip(".")
        return DIVERGED, f"{why}; the rows end at t = {times[rows - 1]:.6g} of {times[-1]:.6g}", rows
    H = system.observe(system.H, q, p) if system.H is not None else np.zeros(rows)
    if not np.isfinite(H).all():
        rows = int(np.isfinite(H).argmin())
        return DIVERGED, f"the state is outside H's domain; the rows end at t = {times[rows - 1]:.6g}", rows
    if system.singular and system.H is not None:
        worst = float(np.abs(H - H[0]).max())
        if worst > LOST * energy_unit(system, q, p):
            return COLLISION, f"the energy {H[0]:.6g} changed by {worst:.3g}: the orbit met the singularity", rows
    return *judged(system, times[:rows], q, p, "take a smaller step or tolerance"), rows


def tolerance(integrator: Peer, tol) -> float | None:
    """The tolerance of a run, by default the peer's own; raises InvalidInput for one that it cannot take."""
    if tol is None:
        return integrator.tol
    if not integrator.adaptive:
        raise InvalidInput(f"'{integrator.id}' takes steps of fixed size: give h, not tol")
    if isinstance(tol, bool) or not isinstance(tol, Real) or not isfinite(tol) or not 0 < tol < 1:
        raise InvalidInput(f"tol is {tol!r}; it must be a number between 0 and 1")
    if tol < integrator.least:
        raise InvalidInput(f"tol is {tol!r}; '{integrator.id}' takes none below {integrator.least:.3g}")
    return float(tol)
