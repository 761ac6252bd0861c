"""Compare runs whose states are tuples, arrays, or SIMD lanes."""

from __future__ import annotations

from collections.abc import Sequence
from unittest import mock

import numpy as np

from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian
from phasebench.integrators.compile import codegen
from phasebench.integrators.driver import integrate
from phasebench.integrators.ensemble import integrate_ensemble
from phasebench.integrators.record import Method
from phasebench.integrators.stepping.orbit_lanes import LANES

from .solutions import end


def arrays_and_tuples_apart(id: str) -> float:
    """Return the distance of two ends of the method ``id`` on Henon-Heiles, with states that are arrays and tuples.

    The system is made anew for each because functions are cached on it.
    """
    made, ends = problem("henon-heiles"), []
    for limit in (codegen.TUPLE_LIMIT, 1):
        with mock.patch.object(codegen, "TUPLE_LIMIT", limit):
            system = Hamiltonian(q=made.system.q, p=made.system.p, H=made.system.H)
            ends.append(end(integrate(system, id, h=0.05, steps=200, q0=made.q0, p0=made.p0)))
            kind = codegen.value_kind(system.d)
    assert kind == "array"
    return float(np.abs(ends[0] - ends[1]).max())


def lanes_and_one_apart(system: Hamiltonian, method: Method | str, q: Sequence, p: Sequence, spread: float) -> float:
    """Return the distance of two ends of an orbit, beside others in SIMD lanes and alone; fail if none are in lanes.

    The others start from (q, p) as well, with all coordinates larger by a multiple of ``spread``.
    """
    n = 2 * LANES.n
    Q, P = np.tile(q, (n, 1)) + spread * np.arange(n)[:, None], np.tile(p, (n, 1))
    many = integrate_ensemble(system, method, Q, P, h=0.05, steps=40)
    assert set(many.status) == {"ok"}
    assert many.in_lanes.all()
    alone = end(integrate(system, method, h=0.05, steps=40, q0=Q[3], p0=P[3]))
    return float(np.abs(np.concatenate([many.q[3], many.p[3]]) - alone).max())
