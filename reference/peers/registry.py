"""PEERS: every peer, one record each, from a module a package."""

from __future__ import annotations

from phasebench.integrators.errors import unknown

from . import desolver, diffrax, gala, galpy, heyoka, pyhamsys, rebound, scipy
from .record import Peer

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
