"""Prepared peers: integrators of other packages, built once; a run is then only a reset and the package's own call."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.keywords import State
from phasebench.integrators.outcome import NOT_CONVERGED, OK
from phasebench.integrators.request import initial
from phasebench.reference.installed import how_to_install

from .record import Peer, Task

Floats = NDArray[np.float64]
#: The statuses of the codes `record.SOLVED` and `record.STALLED`.
STATUSES = (OK, NOT_CONVERGED)


class PreparedPeer:
    """A peer on a problem, built and compiled; it is called with t_end, or with the step h and the number of steps.

    Input is not checked and no states on the way are saved; every call starts from the initial state, or from the
    one that `restart` has set.  `advance` takes the same arguments (t_end, or h and the number of steps), but does not
    read the final state; it is what should be timed: a reset (time, state, step) and the package's own call.

    Attributes
    ----------
    peer : the description of the integrator, a `Peer`
    restart : set the state from which `advance` starts, arrays (d,) q0 and p0
    advance : integrate, and return the package's code, 0 for "ok"
    SOLVED, STALLED : the statuses "ok" and "not-converged": the end was reached, or the package stopped before it
    """

    SOLVED, STALLED = STATUSES

    def __init__(self, peer: Peer, start: Task) -> None:
        if peer.prepare is None:
            raise InvalidInput(f"'{peer.id}' has no prepared run; pb.integrate runs it")
        self.peer, self._d, self._built = peer, len(start.q), start
        self._default = self._state = start.state
        peer.load(peer.package)
        self._calls = peer.prepare(start)
        self.advance = self._calls.advance
        self._moved = False
        self._calls.restart(self._default)

    def __repr__(self) -> str:
        tol = "" if self._built.tol is None else f"(tol={self._built.tol:g})"
        return f"PreparedPeer({self.peer.id}{tol} on {self._built.system!r})"

    def __reduce__(self) -> tuple[Any, ...]:
        """Copies are built anew: the package's objects belong to one run."""
        return PreparedPeer, (self.peer, self._built), (self._state, self._moved)

    def __setstate__(self, state: tuple[Floats, bool]) -> None:
        """Start a copy from the state from which the original starts."""
        start, self._moved = state
        self._restart(start)

    def restart(self, q0: State, p0: State) -> None:
        """Set the state, arrays (d,), from which `advance` starts."""
        self._restart(np.concatenate([q0, p0]))

    def _restart(self, state: Floats) -> None:
        self._state = state
        self._calls.restart(state)

    def __call__(self, *size: float, q0: State | None = None, p0: State | None = None) -> tuple[Floats, Floats, str]:
        """Integrate from the initial state and return (q, p, status) at t_end, or after the steps.

        Parameters
        ----------
        size : t_end, in the problem's unit of time; or h and the number of steps
        q0, p0 : arrays (d,), the initial state if not the problem's
        """
        d = self._d
        if q0 is not None or p0 is not None:
            self.restart(self._default[:d] if q0 is None else q0, self._default[d:] if p0 is None else p0)
            self._moved = True
        elif self._moved:
            self._restart(self._default)
            self._moved = False
        code = self.advance(*size)
        y = self._calls.state()
        return y[:d], y[d:], STATUSES[code]


def prepare_peer(
    problem: Any, peer: Peer, *, tol: float | None = None, q0: State | None = None, p0: State | None = None
) -> PreparedPeer:
    """Prepare a peer, an integrator of another package, on a problem for many calls, or for timing.

    Parameters
    ----------
    problem : a problem, or a system if q0 and p0 are given
    peer : the description of the integrator
    tol : an adaptive peer's tolerance
    q0, p0 : arrays (d,), the initial state if not the problem's

    Raises
    ------
    InvalidInput
        For unusable input, a problem that the peer is not applicable to, or a peer that cannot be prepared.
    """
    lack = peer.lacks(problem, getattr(problem, "system", problem))
    if lack:
        raise InvalidInput(f"'{peer.id}' cannot do this: {lack}")
    system, q, p = initial(problem, q0, p0)
    try:
        return PreparedPeer(peer, Task(problem, system, q, p, tol=peer.tolerance(tol)))
    except ImportError as error:
        raise InvalidInput(
            f"{peer.package} cannot be imported ({error}): install it ({how_to_install(peer.package)})"
        ) from None
