"""A peer's run: the input checked, the rows checked, and how it ended."""

from __future__ import annotations

from math import isfinite

import numpy as np

from phasebench.integrators.errors import InvalidInput

from .record import Peer

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
    save_every: int = 1,
    q0=None,
    p0=None,
):
    """Integrate ``problem`` with a peer.

    Parameters
    ----------
    problem : a problem, or a system where q0 and p0 are given
    peer_id : an id of `PEERS` or a record
    h, t_end, steps : two of them, as for `integrators.integrate`; for an adaptive peer they make the grid of its
        output, and t_end alone gives start and end
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
    from phasebench.integrators.driver import COLLISION, DIVERGED, OK, SKIPPED, grid, initial

    from . import peer

    chosen = peer(peer_id)
    lack = chosen.lacks(problem, getattr(problem, "system", problem))
    if lack:
        raise InvalidInput(f"'{chosen.id}' cannot do this: {lack}")
    tol = _tolerance(chosen, tol)
    if chosen.adaptive and h is None and steps is None:
        steps = 1
    h, steps = grid(h, t_end, steps)
    if save_every < 0 or int(save_every) != save_every:
        raise InvalidInput(f"save_every is {save_every}; it must be a positive integer, or 0 for the end alone")
    system, q, p = initial(problem, q0, p0)
    every = min(int(save_every) or steps, steps)
    index = [*range(0, steps, every), steps]
    t = np.array([h * n for n in index])
    try:
        chosen.load(chosen.package)
    except ImportError as error:
        reason = f"{chosen.package} cannot be imported ({error}); pip install {chosen.package}"
        return _solution(chosen, t, q[None], p[None], SKIPPED, reason, 0, 0, h, 0.0)
    Q, P, taken, gradient, seconds, failure = chosen.run(problem, system, q, p, h, index, t, tol)
    whole = np.isfinite(Q).all(axis=1) & np.isfinite(P).all(axis=1)
    kept = len(Q) if whole.all() else int(np.argmin(whole))
    status, reason = OK, ""
    if kept < len(t):
        why = (failure or "the state is no longer finite").rstrip(".")
        status, reason = DIVERGED, f"{why}; the rows end at t = {t[kept - 1]:.6g} of {t[-1]:.6g}"
    elif system.singular and system.H is not None:
        H = system.observe(system.H, Q, P)
        worst = float(np.abs(H - H[0]).max())
        if worst > LOST * abs(H[0]):
            status, reason = COLLISION, f"the energy {H[0]:.6g} changed by {worst:.3g}: the orbit met the singularity"
    Q, P = np.ascontiguousarray(Q[:kept], dtype=float), np.ascontiguousarray(P[:kept], dtype=float)
    return _solution(chosen, t, Q, P, status, reason, taken, gradient, h, seconds)


def _solution(chosen, t, Q, P, status, reason, steps, gradient, h, seconds):
    from phasebench.integrators.driver import Solution

    counts = {"steps": int(steps), "gradient": int(gradient), "hessian": 0, "iterations": 0, "fallbacks": 0}
    aux = np.full(len(Q) - 1, np.nan)
    return Solution(t[: len(Q)], Q, P, status, reason, counts, h, chosen, aux, seconds)


def _tolerance(chosen: Peer, tol) -> float | None:
    if tol is None:
        return chosen.tol
    if not chosen.adaptive:
        raise InvalidInput(f"'{chosen.id}' takes steps of fixed size: give h, not tol")
    if isinstance(tol, bool) or not isinstance(tol, (int, float)) or not isfinite(tol) or not 0 < tol < 1:
        raise InvalidInput(f"tol is {tol!r}; it must be a number between 0 and 1")
    if tol < chosen.least:
        raise InvalidInput(f"tol is {tol!r}; '{chosen.id}' takes none below {chosen.least:.3g}")
    return float(tol)
