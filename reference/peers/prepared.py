"""A prepared peer: built and compiled once, then called with nothing about the package's own call but a reset."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.request import initial

from .record import Peer, Start
from .run import tolerance

#: Status codes, those of a prepared method.
SOLVED, STALLED = 0, 1


class Calls(NamedTuple):
    """What a package brings to a prepared run.

    Attributes
    ----------
    restart : (y) -> None: set the state (q, p), array (2 d,), from which `advance` starts
    advance : (t_end), or (h, steps) at fixed steps -> status code: reset, then the package's own call
    state : () -> the state (q, p) reached, array (2 d,), a copy
    keep : what has to live as long as the calls, such as a callback of which the package has the address alone
    """

    restart: Callable[[np.ndarray], None]
    advance: Callable[..., int]
    state: Callable[[], np.ndarray]
    keep: Any = None


class PreparedPeer:
    """A peer on a problem, built and compiled: ``run(t_end)``, or ``run(h, steps)`` where its steps are fixed.

    Nothing is checked and no rows are kept; every call starts anew.  `advance` is such a call without reading the end
    state back: what a clock should enclose.  It consists of a reset (time, state, step) and the package's own call.

    Attributes
    ----------
    peer : the record
    restart : set the state from which `advance` starts, arrays (d,) q0 and p0
    advance : integrate, and return the status code
    SOLVED, STALLED : status codes 0 and 1: the end was reached, or the package gave up before
    """

    SOLVED, STALLED = SOLVED, STALLED

    def __init__(self, peer: Peer, start: Start):
        if peer.prepare is None:
            raise InvalidInput(f"'{peer.id}' has no prepared run; pb.integrate runs it")
        self.peer, self._d = peer, len(start.q)
        self._default = start.state
        peer.load(peer.package)
        self._calls = peer.prepare(start)
        self.advance = self._calls.advance
        self._moved = False
        self._calls.restart(self._default)

    def restart(self, q0, p0) -> None:
        """Set the state, arrays (d,), from which `advance` starts."""
        self._calls.restart(np.concatenate([q0, p0]))

    def __call__(self, *size, q0=None, p0=None) -> tuple[np.ndarray, np.ndarray, int]:
        """(q, p, status code) at t_end, or after the steps.

        Parameters
        ----------
        size : t_end, in the problem's unit of time; or h and the number of steps
        q0, p0 : arrays (d,), the initial state where not the problem's
        """
        d = self._d
        if q0 is not None or p0 is not None:
            self.restart(self._default[:d] if q0 is None else q0, self._default[d:] if p0 is None else p0)
            self._moved = True
        elif self._moved:
            self._calls.restart(self._default)
            self._moved = False
        code = self.advance(*size)
        y = self._calls.state()
        return y[:d], y[d:], code


def prepare_peer(problem, peer: Peer, *, tol: float | None = None, q0=None, p0=None) -> PreparedPeer:
    """A peer on a problem, ready to be called many times, and to be timed.

    Parameters
    ----------
    problem : a problem, or a system where q0 and p0 are given
    peer : its record
    tol : an adaptive peer's tolerance
    q0, p0 : arrays (d,), the initial state where not the problem's

    Raises
    ------
    InvalidInput
        For input that cannot be used, a problem that the peer cannot do, or a peer without a prepared run.
    """
    lack = peer.lacks(problem, getattr(problem, "system", problem))
    if lack:
        raise InvalidInput(f"'{peer.id}' cannot do this: {lack}")
    system, q, p = initial(problem, q0, p0)
    try:
        return PreparedPeer(peer, Start(problem, system, q, p, tolerance(peer, tol)))
    except ImportError as error:
        raise InvalidInput(
            f"{peer.package} cannot be imported ({error}): install it (pip install {peer.package})"
        ) from None
