"""What a system's formulae become is made ready once in a process, whoever made the system object; systems travel."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian, integrate
from phasebench.integrators.engine import printing

PENDULUM = {"q": "q", "p": "p", "H": "p**2/2 - cos(q)"}


def end(system):
    return integrate(system, "scheme-i", h=0.1, steps=5, q0=[1.0], p0=[0.2]).q[-1]


def test_equal_formulae_share_their_functions_and_others_do_not():
    one, same, other = Hamiltonian(**PENDULUM), Hamiltonian(**PENDULUM), Hamiltonian(q="q", p="p", H="p**2/2 - sin(q)")
    assert one.field() is same.field()
    assert one.grad_V() is same.grad_V()
    assert one.field() is not other.field()


def test_nothing_is_generated_again(monkeypatch):
    end(Hamiltonian(**PENDULUM))

    def refuse(*_):
        raise AssertionError("generated again")

    monkeypatch.setattr(printing, "source", refuse)
    end(Hamiltonian(**PENDULUM))
    with pytest.raises(AssertionError, match="generated again"):
        end(Hamiltonian(q="q", p="p", H="p**2/2 - cos(q) + q**6/7919"))


def test_a_problem_is_made_once_for_equal_parameters():
    assert problem("kepler", e=0.2).system is problem("kepler", e=0.2).system
    assert problem("kepler", e=0.2).q0 != problem("kepler", e=0.3).q0


@pytest.mark.parametrize(
    ("name", "parameters"),
    [(n, {}) for n in ("pendulum", "kepler", "lotka-volterra", "rigid-body")] + [("nls", {}), ("fpu", {"m": 1})],
)
def test_systems_are_pickled(name, parameters):
    made = problem(name, **parameters)
    integrate(made, "implicit-midpoint", h=0.01, steps=1)
    again = pickle.loads(pickle.dumps(made.system))
    before, after = (
        integrate(s, "implicit-midpoint", h=0.01, steps=3, q0=made.q0, p0=made.p0) for s in (made.system, again)
    )
    assert np.array_equal(before.q, after.q)
    assert np.array_equal(before.p, after.p)
