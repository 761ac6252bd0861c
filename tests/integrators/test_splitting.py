"""Splittings with diagonal masses: the drift multiplies by numbers, with the same bits as with the function grad T."""

import numpy as np
import pytest
import sympy as sp

from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian
from phasebench.integrators.compile import codegen
from phasebench.integrators.driver import integrate
from phasebench.integrators.registry import METHODS, method
from phasebench.integrators.stepping import kernel
from support.solutions import last
from support.systems import chain, of_masses


def end(system):
    """End state of 200 steps of a splitting."""
    q, p = np.linspace(0.3, 0.7, system.d), np.linspace(-0.2, 0.4, system.d)
    return last(integrate(system, "stormer-verlet", q0=q, p0=p, h=0.01, steps=200))


@pytest.mark.processor
@pytest.mark.parametrize("d", [2, codegen.TUPLE_LIMIT + 1])
def test_masses_and_grad_t_agree_bit_by_bit(d, monkeypatch):
    with_masses = end(chain(d))
    monkeypatch.setattr(Hamiltonian, "inverse_masses", None)
    system = chain(d)
    assert not isinstance(kernel.prepare(method("stormer-verlet"), system).step.dT, np.ndarray)
    np.testing.assert_array_equal(end(system), with_masses)


def test_control_another_mass_would_be_seen():
    others = chain(2, lambda p: of_masses(p) + p[-1] ** 2 / 10**9)
    assert np.any(end(others) != end(chain(2)))


@pytest.mark.parametrize("arithmetic", [codegen.DOUBLE, codegen.MULTIPRECISION])
def test_a_drift_multiplies_by_inverse_masses(arithmetic):
    with codegen.precision(40):
        dT = kernel.prepare(method("stormer-verlet"), chain(2), arithmetic).step.dT
        assert list(dT) == [codegen.to_number(sp.Rational(k, 3), arithmetic) for k in (1, 2)]
        assert not dT.flags.writeable


def test_a_quartic_kinetic_energy_has_no_inverse_masses():
    """Quadratic ones: test_hamiltonian.py."""
    assert chain(2, lambda p: p[0] ** 4 + p[1] ** 2).inverse_masses is None


@pytest.mark.parametrize("h", [1.0, 2.0])
def test_a_kick_of_length_1_is_not_special(h):
    """The last kick of a step is merged with the first of the next; a merged kick may have length 1."""
    s = integrate(Hamiltonian(q="q", p="p", H="p**2/2 + q**2/50"), "stormer-verlet", h=h, steps=2, q0=[0.3], p0=[0.2])
    q, p = 0.3, 0.2
    for _ in range(2):
        p -= h / 2 * q / 25
        q += h * p
        p -= h / 2 * q / 25
    assert [s.q[-1, 0], s.p[-1, 0]] == pytest.approx([q, p], abs=1e-15)


SUBSTEPS = ["stormer-verlet", "stormer-verlet-dkd", "symplectic-euler-q", "suzuki-4"]


@pytest.mark.parametrize("id", [*SUBSTEPS, *(m.id for m in METHODS if m.family == "splitting")])
def test_drifts_and_kicks_add_up_to_the_step(id):
    """For any coefficients, including 1 and cancelling fractions; adjacent drifts or kicks are merged."""
    step = kernel.prepare(method(id), chain(2)).step
    assert np.all(step.a[1:] != 0)
    assert np.all(step.b[1:-1] != 0)
    assert [np.sum(step.a), np.sum(step.b)] == pytest.approx([1, 1], abs=4e-15)


def test_the_outer_planets_have_inverse_masses():
    assert len(problem("outer-solar-system").system.inverse_masses) == 18
