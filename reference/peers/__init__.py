"""Peers: integrators of other packages, with which methods are compared; a module per package, a record per peer.

The ``seconds`` of a peer are those of the propagation: it is built and compiled before the clock starts, and states are
read out after it stops (but SciPy interpolates rows between steps inside the propagation).
"""

from __future__ import annotations

from phasebench.integrators.compile import lazy as _lazy

from . import floating
from .integrate import integrate_peer
from .record import Claims, Peer, Run, Task

__all__ = ["BY_ID", "PACKAGES", "PEERS", "Claims", "Peer", "Run", "Task", "floating", "integrate_peer", "peer"]

# Modules of packages are imported on first access.
__getattr__ = _lazy.attributes(__name__, dict.fromkeys(("BY_ID", "PACKAGES", "PEERS", "peer"), "registry"))
