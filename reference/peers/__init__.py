"""PEERS: the established integrators that methods are measured against, one module per package, one record each.

A peer's ``seconds`` are of the propagation alone: it is built and compiled before the clock starts, and states are
read out after it stops (SciPy's rows between steps are interpolated inside it).
"""

from __future__ import annotations

from phasebench.integrators.errors import unknown

from . import desolver, diffrax, floating, gala, galpy, heyoka, pyhamsys, rebound, scipy
from .record import Claims, Peer, Run, Task
from .run import integrate_peer

#: Those that the suite depends on, then those of the extra ``peers``.
PACKAGES = (heyoka, rebound, scipy, gala, galpy, desolver, pyhamsys, diffrax)

PEERS: tuple[Peer, ...] = tuple(p for package in PACKAGES for p in package.PEERS)

BY_ID = {p.id: p for p in PEERS}


def peer(id: str | Peer) -> Peer:
    """The peer of that id; raises InvalidInput for an unknown one, naming the nearest."""
    if isinstance(id, Peer):
        return id
    if id not in BY_ID:
        raise unknown("peer", id, BY_ID)
    return BY_ID[id]


__all__ = ["BY_ID", "PEERS", "Claims", "Peer", "Run", "Task", "floating", "integrate_peer", "peer"]
