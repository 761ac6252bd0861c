"""PEERS: the records of all integrators of other packages, collected from one module per package."""

from __future__ import annotations

from importlib import import_module

from phasebench.integrators.names import Records, unknown_method

from .record import Peer

#: First the packages that the suite depends on, then those of the extra ``peers``.
NAMES = (
    *("heyoka", "rebound", "scipy"),
    *("gala", "galpy", "desolver", "pyhamsys", "diffrax", "sundials4py", "boost", "gsl", "pynamicalsys"),
    *("blackjax", "openmm", "ase", "jax_md", "mujoco"),
)
PACKAGES = tuple(import_module(f"{__package__}.{name}") for name in NAMES)

BY_ID = {p.id: p for package in PACKAGES for p in package.PEERS}


def peer(id: str | Peer) -> Peer:
    """The peer with this id; raises InvalidInput for an unknown one, with the nearest known id."""
    if isinstance(id, Peer):
        return id
    if id not in BY_ID:
        raise unknown_method(id, BY_ID, "peer")
    return BY_ID[id]


#: All peers; ``PEERS["heyoka"]`` is ``peer("heyoka")``.
PEERS: Records[Peer] = Records.of(BY_ID.values(), peer)
