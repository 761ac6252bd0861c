"""Run systems with two degrees of freedom from a fixed state, with quadrature nodes in SIMD lanes or one by one."""

from __future__ import annotations

from unittest.mock import patch

from phasebench.integrators import Hamiltonian
from phasebench.integrators.driver import integrate

from .solutions import end


def of(H) -> Hamiltonian:
    """Return the system of a Hamiltonian H, a formula in q1, q2, p1, p2."""
    return Hamiltonian(q="q1 q2", p="p1 p2", H=H)


def run(system, id, h=0.1, steps=50):
    """Integrate a system by the method ``id``: (end state (q, p), array (4,); counts of steps, evaluations, ...).

    The run must end with status "ok".
    """
    s = integrate(system, id, h=h, steps=steps, q0=[0.7, 0.5], p0=[0.2, -0.3])
    return end(s), s.counts


def one_by_one(family, *arguments):
    """Do as `run`, but evaluate the quadrature nodes one after the other instead of in SIMD lanes.

    ``family`` is the module of the method's family; the further arguments are those of `run`.
    """
    with patch.object(family, "serves", lambda *_: False):
        return run(*arguments)
