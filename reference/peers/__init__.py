"""PEERS: the established integrators that methods are measured against, one module per package, one record each.

A peer's ``seconds`` are of the propagation alone: it is built and compiled before the clock starts, and states are
read out after it stops (SciPy's rows between steps are interpolated inside it).
"""

from __future__ import annotations

from phasebench.integrators.engine import lazy as _lazy

from . import floating
from .record import Claims, Peer, Run, Task
from .run import integrate_peer

__all__ = ["BY_ID", "PACKAGES", "PEERS", "Claims", "Peer", "Run", "Task", "floating", "integrate_peer", "peer"]

# The packages' modules load when one of them is asked for.
__getattr__ = _lazy.attributes(__name__, dict.fromkeys(("BY_ID", "PACKAGES", "PEERS", "peer"), "registry"))
