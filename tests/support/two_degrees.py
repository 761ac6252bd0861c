"""Systems with two degrees of freedom, run from a fixed state, with quadrature nodes in SIMD lanes or one by one."""

from __future__ import annotations

from unittest.mock import patch

import numpy as np

from phasebench.integrators import Hamiltonian
from phasebench.integrators.driver import integrate


def of(H) -> Hamiltonian:
    """The system of a Hamiltonian in q1, q2, p1, p2."""
    return Hamiltonian(q="q1 q2", p="p1 p2", H=H)


def run(system, id, h=0.1, steps=50):
    """(end state, counts) of a run that must end with status "ok"."""
    s = integrate(system, id, h=h, steps=steps, q0=[0.7, 0.5], p0=[0.2, -0.3])
    assert s.status == "ok", s.reason
    return np.concatenate([s.q[-1], s.p[-1]]), s.counts


def one_by_one(family, *arguments):
    """(end state, counts) of a run by a kernel of ``family`` that evaluates the nodes one after the other.

    The arguments are those of `run`.
    """
    with patch.object(family, "serves", lambda *_: False):
        return run(*arguments)
