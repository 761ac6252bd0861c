"""PEERS: the established integrators that methods are measured against, one record each.

A peer's ``seconds`` are of the propagation alone: it is built and compiled before the clock starts, and states are
read out after it stops (SciPy's rows between steps are interpolated inside it).
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from typing import Any

import numpy as np

from integrators.errors import InvalidInput, unknown

#: On a singular system a change of the energy by more than this many times itself is a collision.
LOST = 10.0

KEPLER = ("kepler", "perturbed-kepler")


@dataclass(frozen=True)
class Peer:
    """An integrator from elsewhere.

    Attributes
    ----------
    id, name : its kebab-case name and its full one
    package : what to install
    adaptive : takes a tolerance ``tol``; ``h`` is then the spacing of its output
    order : in the step h, of a fixed-step peer on a nonlinear problem; None where it is not one number
    problems : ids of the problems it can do; None: any
    license : of the package
    about : what its tolerance or its options mean
    source : author, year
    tol : the default tolerance; None: the package's own
    least : the smallest tolerance it takes
    """

    id: str
    name: str
    package: str
    adaptive: bool
    order: int | None
    problems: tuple[str, ...] | None
    license: str
    about: str
    source: str
    tol: float | None = None
    least: float = 0.0
    parameters: Mapping[str, Any] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """The id, as a method's label without parameters."""
        return self.id


PEERS: tuple[Peer, ...] = (
    Peer(
        "heyoka",
        "Taylor series of adaptive step and order, double precision",
        package="heyoka",
        adaptive=True,
        order=None,
        problems=None,
        license="MPL-2.0",
        about="tol is the local error relative to the state; the default is the machine epsilon; compiled by LLVM",
        source="Biscani & Izzo 2021, Mon. Not. R. Astron. Soc. 504, 2614-2628",
        tol=float(np.finfo(float).eps),
        least=float(np.finfo(float).eps) / 2,
    ),
    Peer(
        "rebound-ias15",
        "IAS15, adaptive Gauss-Radau of order 15",
        package="rebound",
        adaptive=True,
        order=15,
        problems=KEPLER,
        license="GPL-3.0",
        about="tol is REBOUND's epsilon, which is no error bound; the default 1e-9 reaches round-off",
        source="Rein & Spiegel 2015, Mon. Not. R. Astron. Soc. 446, 1424-1437",
    ),
    Peer(
        "rebound-whfast",
        "WHFast, Wisdom-Holman splitting",
        package="rebound",
        adaptive=False,
        order=4,
        problems=KEPLER,
        license="GPL-3.0",
        about="exact up to round-off on kepler; with the extra force corrector 17 and the lazy kernel; safe_mode = 0",
        source="Rein & Tamayo 2015, Mon. Not. R. Astron. Soc. 452, 376-388; Rein, Tamayo & Brown 2019",
    ),
    Peer(
        "rebound-leapfrog",
        "REBOUND's leapfrog, drift-kick-drift",
        package="rebound",
        adaptive=False,
        order=2,
        problems=KEPLER,
        license="GPL-3.0",
        about="one force evaluation a step",
        source="Rein & Liu 2012, Astron. Astrophys. 537, A128",
    ),
    Peer(
        "scipy-dop853",
        "DOP853, Dormand-Prince of order 8(5,3)",
        package="scipy",
        adaptive=True,
        order=8,
        problems=None,
        license="BSD-3-Clause",
        about="rtol = atol = tol, by default SciPy's rtol = 1e-3 and atol = 1e-6; the right-hand side is a Python call",
        source="Hairer, Norsett & Wanner 1993, II.5",
        least=100 * float(np.finfo(float).eps),
    ),
)

BY_ID = {p.id: p for p in PEERS}


def peer(id: str | Peer) -> Peer:
    """The peer of that id; raises InvalidInput for an unknown one, naming the nearest."""
    if isinstance(id, Peer):
        return id
    if id not in BY_ID:
        raise unknown("peer", id, BY_ID)
    return BY_ID[id]


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
    integrators.integrate.Solution
        ``h`` is the grid's spacing.  ``counts``: steps as the peer counts them, gradient where it tells its
        evaluations of the right-hand side, 0 for what it does not tell.  Status "skipped" where its package is
        missing.

    Raises
    ------
    InvalidInput
        For input that cannot be used, or a problem that the peer cannot do.
    """
    from integrators.driver import COLLISION, DIVERGED, OK, SKIPPED, grid, initial

    chosen = peer(peer_id)
    if chosen.problems is not None and getattr(problem, "id", None) not in chosen.problems:
        raise InvalidInput(
            f"'{chosen.id}' integrates only {' and '.join(chosen.problems)}, not '{getattr(problem, 'id', 'a system')}'"
        )
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
        importlib.import_module(chosen.package)
    except ImportError as error:
        reason = f"{chosen.package} cannot be imported ({error}); pip install {chosen.package}"
        return _solution(chosen, t, q[None], p[None], SKIPPED, reason, 0, 0, h, 0.0)
    Q, P, taken, gradient, seconds, failure = RUNS[chosen.id](problem, system, q, p, h, index, t, tol)
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
    from integrators.driver import Solution

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


def _heyoka(problem, system, q, p, h, index, t, tol):
    from . import taylor

    ta = taylor.integrator(system, float, tol)
    taylor.start(ta, float, q, p)
    started = time.perf_counter()
    rows, steps, failure = taylor.propagate(ta, t)
    seconds = time.perf_counter() - started
    return rows[:, : system.d], rows[:, system.d :], steps, 0, seconds, failure


def _rebound(integrator):
    def run(problem, system, q, p, h, index, t, tol):
        from . import nbody

        Q, P, steps, seconds = nbody.run(problem, integrator, q, p, h, index, tol)
        return Q, P, steps, 0, seconds, None

    return run


def _dop853(problem, system, q, p, h, index, t, tol):
    from . import scipy_ivp

    return scipy_ivp.run(system, q, p, t, tol)


#: Id -> how it runs: (problem, system, q, p, h, index, t, tol) -> (Q, P, steps, evaluations, seconds, failure).
RUNS = {
    "heyoka": _heyoka,
    "rebound-ias15": _rebound("ias15"),
    "rebound-whfast": _rebound("whfast"),
    "rebound-leapfrog": _rebound("leapfrog"),
    "scipy-dop853": _dop853,
}
