"""Splittings with modified kicks: orders from their coefficients, steps beside a plain implementation, structure."""

from __future__ import annotations

from pathlib import Path

import mpmath
import numpy as np
import pytest
import sympy as sp

from phasebench.benchmarks.measure import oscillator
from phasebench.benchmarks.measure.battery import SYSTEMS
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian, coefficients
from phasebench.integrators.coefficients.force_gradient import residuals
from phasebench.integrators.compile.codegen import TUPLE_LIMIT
from phasebench.integrators.driver import integrate
from phasebench.integrators.ensemble import integrate_ensemble
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.families import force_gradient as family
from phasebench.integrators.registry import METHODS
from support import force_gradients
from support import step_matrices as exact
from support.solutions import last
from support.systems import chain

IDS = [m.id for m in METHODS if m.family == "force_gradient"]
HESSIAN_FREE = [m.id for m in METHODS if m.family == "force_gradient" and m.data[1]]


def test_chin_4a_with_a_plain_kick_has_order_2():
    """The gradient is what makes the order 4."""

    def largest(degree):
        return max(abs(x) for r in residuals(without, degree) for x in r)

    without = [(letter, weight, 0 * c) for letter, weight, c in coefficients.steps("chin-4a")]
    assert largest(2) < mpmath.mpf("1e-50") < largest(3)


# -- steps beside an independent implementation in 30 digits -----------------------------------------------------------


@pytest.fixture(scope="module")
def plain(of_each):
    """Function id -> measurements of `support.force_gradients`."""
    return of_each(force_gradients)


@pytest.mark.parametrize("id", IDS)
def test_one_and_50_steps_are_those_of_a_plain_implementation(plain, id):
    """In 30 digits and more; with a mass matrix that is not diagonal."""
    found = plain(id)
    assert max(found["distance"]) < 1e-34
    assert min(found["control"]) > 1e-27, "the control: gradients changed in the 18th digit"


@pytest.mark.parametrize("id", IDS)
def test_doubles_agree_to_round_off(plain, id):
    """Rows are saved on the way, which parts the kicks that steps share."""
    for steps, end in zip(force_gradients.STEPS, plain(id)["ends"], strict=True):
        q, p = force_gradients.START
        s = integrate(force_gradients.SYSTEM, id, h=force_gradients.H, steps=steps, q0=q, p0=p, save_every=7)
        np.testing.assert_allclose([*s.q[-1], *s.p[-1]], end, rtol=0, atol=1e-15 * (3 + steps))


@pytest.mark.parametrize("id", IDS)
def test_without_the_hessian_a_step_keeps_the_volume_but_is_not_symplectic(plain, id):
    found = plain(id)
    assert found["volume"] < 1e-26
    if id in HESSIAN_FREE:
        assert found["form"] > 1e-18
    else:
        assert found["form"] < 1e-26


# -- kinds of value ----------------------------------------------------------------------------------------------------

KINDS = ["chin-4a", "sabac-2", "omelyan-6-5f5g-p", "hessian-free-adada"]


@pytest.mark.parametrize("id", KINDS)
def test_lanes_integrate_the_same_orbits(id):
    system, q, p = SYSTEMS["henon-heiles"]()
    Q = np.array(q) + np.linspace(0, 0.02, 9)[:, None]
    P = np.tile(p, (9, 1))
    found = [integrate_ensemble(system, id, Q, P, h=0.05, steps=200, lanes=lanes) for lanes in (True, False)]
    assert found[0].in_lanes.all()
    assert not found[1].in_lanes.any()
    np.testing.assert_allclose(found[0].q, found[1].q, rtol=0, atol=1e-14)
    np.testing.assert_allclose(found[0].p, found[1].p, rtol=0, atol=1e-14)
    assert np.ptp(found[0].q[:, 0]) > 1e-3, "the control: the orbits differ"


@pytest.mark.parametrize("id", ["sabac-2", "omelyan-6-5f5g-p"])
def test_arrays_and_tuples_agree(id, monkeypatch):
    """With rows on the way; the other two of `KINDS` agree bit by bit (test_values.py)."""
    d = family.MOST + 1
    q, p = np.linspace(0.3, 0.9, d), np.linspace(-0.2, 0.4, d)
    ends = []
    for most in (family.MOST, TUPLE_LIMIT):
        monkeypatch.setattr(family, "MOST", most)
        ends.append(last(integrate(chain(d), id, h=0.02, steps=50, q0=q, p0=p, save_every=10)))
    np.testing.assert_allclose(*ends, rtol=0, atol=1e-14)
    assert np.abs(ends[0][:d] - q).max() > 0.1, "the control: it moves"


def test_loops_without_a_formula_need_no_hessian():
    """A chain by loops: the Hessian-free step runs and has order 4; the one with the Hessian says what is missing."""
    made = problem(str(Path(__file__).parents[2] / "examples" / "problems" / "chain.py"), N=30)
    ends = [
        integrate(made.system, "hessian-free-badab", h=h, t_end=1.0, q0=made.q0, p0=made.p0).q[-1]
        for h in (0.1, 0.05, 0.025)
    ]
    ratio = np.abs(ends[0] - ends[1]).max() / np.abs(ends[1] - ends[2]).max()
    assert abs(np.log2(ratio) - 4) < 0.2
    with pytest.raises(InvalidInput, match="loops and no formula"):
        integrate(made.system, "chin-4a", h=0.1, t_end=1.0, q0=made.q0, p0=made.p0)


# -- stability --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("id", ["takahashi-imada", "chin-4a", "chin-4b", "chin-4c", "sabac-2", "hessian-free-adadada"])
def test_stability_limits_follow_from_the_step_matrix(id):
    """On the oscillator a modified kick is p - (b z - 2 c z^3) q, with the Hessian or without."""

    def kick(b, c):
        return sp.Matrix([[1, 0], [-b * exact.Z + 2 * c * exact.Z**3, 1]])

    parts = []
    for letter, weight, c in coefficients.steps(id):
        a, c = (sp.Float(str(x), exact.DIGITS) for x in (weight, c))
        parts.append(exact.drift(a) if letter == "A" else kick(a, c))
    wanted = float(exact.first_end(exact.product(*parts)))
    found = oscillator.find(integrator(id)).limit
    assert found == pytest.approx(wanted, rel=2e-6 if id == "chin-4a" else 1e-9), "2 3^(1/2), a double root, of chin-4a"


def trace_error(weight: float, h: float) -> float:
    """tr M - 2 cos h of a step drift, kick, drift on the oscillator whose kick is p - (h - 2 weight h^3) q."""
    drift, kick = np.array([[1.0, h / 2], [0.0, 1.0]]), np.array([[1.0, 0.0], [-(h - 2 * weight * h**3), 1.0]])
    return float(np.trace(drift @ kick @ drift) - 2 * np.cos(h))


def test_takahashi_imada_has_effective_order_four():
    """A trace does not change under conjugation: the order of its error less two is that of the best conjugate."""
    weight = float(next(m for m in METHODS if m.id == "takahashi-imada").data[0][1][2])
    orders = [np.log2(trace_error(w, 0.2) / trace_error(w, 0.1)) for w in (weight, 1.001 * weight)]
    assert orders[0] == pytest.approx(6, abs=0.05)
    assert orders[1] < 5.5, "the control"
    made = Hamiltonian(q="q", p="p", H="p**2/2 + q**2/2")
    first, second = (integrate(made, "takahashi-imada", h=0.2, steps=1, q0=[q], p0=[1 - q]) for q in (1.0, 0.0))
    assert first.q[-1, 0] + second.p[-1, 0] - 2 * np.cos(0.2) == pytest.approx(trace_error(weight, 0.2), rel=1e-6)
