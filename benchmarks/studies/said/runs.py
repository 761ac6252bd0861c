"""What the measurements of statements share: a run to its end, and Kepler's energy in extended precision."""

from __future__ import annotations

from typing import Any

import numpy as np

from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.store.cells import Unavailable
from phasebench.integrators.driver import OK, SKIPPED
from phasebench.integrators.solution import Solution


def ran(made: Any, id: str, **span: Any) -> Solution:
    """The solution of a problem by an integrator; raises Unavailable without its package."""
    s = integrator(id).run(made, **span)
    if s.status == SKIPPED:
        raise Unavailable(s.reason)
    return s


def finished(made: Any, id: str, **span: Any) -> Solution:
    """A solution that reaches its end; raises RuntimeError otherwise."""
    s = ran(made, id, **span)
    if s.status != OK:
        raise RuntimeError(f"{id}: {s.reason}")
    return s


def kepler_energies(q: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Kepler's energy, array (n,), of states q, p (n, 2), in extended precision."""
    q, p = q.astype(np.longdouble), p.astype(np.longdouble)
    return (p**2).sum(axis=-1) / 2 - 1 / np.sqrt((q**2).sum(axis=-1))
