"""Splittings with modified kicks: orders from their coefficients, steps beside a plain implementation, structure."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mpmath
import numpy as np
import pytest
import sympy as sp

from phasebench.benchmarks.measure import oscillator
from phasebench.benchmarks.measure.battery import SYSTEMS
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian
from phasebench.integrators.coefficients import force_gradient as tables
from phasebench.integrators.coefficients.fractions import DIGITS
from phasebench.integrators.coefficients.table import is_exact, value
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

ROUND_OFF, VISIBLE = mpmath.mpf("1e-50"), mpmath.mpf("1e-12")
IDS = [m.id for m in METHODS if m.family == "force_gradient"]
HESSIAN_FREE = [m.id for m in METHODS if m.family == "force_gradient" and m.data[1]]
each_table = pytest.mark.parametrize("table", tables.TABLES, ids=lambda t: t.name)


# -- coefficients -----------------------------------------------------------------------------------------------------


def largest(residuals) -> mpmath.mpf:
    """Size of the largest coefficient."""
    return max(abs(x) for r in residuals for x in r)


@each_table
def test_the_order_follows_from_the_coefficients(table):
    """All words up to the order vanish; one of the next degree does not."""
    found = tables.residuals(tables.FILE.steps(table.name), table.order[0] + 1)
    assert largest(found[:-1]) < ROUND_OFF
    assert largest(found[-1:]) > VISIBLE


@each_table
def test_control_a_number_off_by_1e_12_is_seen(table):
    steps = list(tables.FILE.steps(table.name))
    for k, (letter, weight, c) in enumerate(steps):
        moved = [(letter, weight + VISIBLE, c)] + ([(letter, weight, c + VISIBLE)] if letter == "B" else [])
        for other in moved[: 1 if table.order[0] == 2 else 2]:
            changed = [*steps[:k], other, *steps[k + 1 :]]
            assert largest(tables.residuals(changed, min(3, table.order[0]))) > VISIBLE / 1000


@each_table
def test_polished_numbers_agree_with_the_published_digits(table):
    stored = tables.FILE.stored[table.name]
    assert stored["published"] == table.digest, "python -m phasebench.integrators.coefficients.force_gradient"
    with mpmath.workdps(DIGITS):
        for text, number in zip(table.published, stored["numbers"], strict=True):
            assert abs(value(number) - value(text)) <= table.accuracy
            assert not is_exact(text) or number == text


@pytest.mark.parametrize("name", ["chin-4b", "omelyan-4-3f1g-p"])
def test_polishing_again_finds_the_same_numbers(name):
    table = tables.FILE.table(name)
    assert tables.FILE.entry(table) == tables.FILE.stored[name]
    with pytest.raises(ArithmeticError, match="has not the order 6"):
        tables.polish(replace(table, order=(6,)))


@pytest.mark.parametrize("name", [t.name for t in tables.TABLES if t.hessian_free and t.order[0] == 6])
def test_order_6_without_the_hessian_needs_one_more_condition(name):
    """The second force differs by c^2 / b at degree 5; the methods of order 6 with the Hessian do not meet this."""

    def sum_of(steps):
        return abs(mpmath.fsum(c * c / b for letter, b, c in steps if letter == "B"))

    with mpmath.workdps(DIGITS):
        assert sum_of(tables.FILE.steps(name)) < ROUND_OFF
        assert sum_of(tables.FILE.steps("omelyan-6-5f3g-p")) > 1e-5


def test_correctors_are_those_of_rebound():
    """REBOUND's `reb_saba_cc` for SABA_2 to SABA_4, whose halves stand at either end of the step."""
    known = {2: 0.01116454968463011276968973577, 3: 0.005634593363122809402267823769, 4: 0.003396775048208601331532}
    for n, c in known.items():
        first, *_, last = tables.FILE.steps(f"sabac-{n}")
        assert first[1] == last[1] == 0
        assert float(first[2] + last[2]) == pytest.approx(c, rel=1e-15)


def test_chin_4a_with_a_plain_kick_has_order_2():
    """The gradient is what makes the order 4."""
    without = [(letter, weight, 0 * c) for letter, weight, c in tables.FILE.steps("chin-4a")]
    assert largest(tables.residuals(without, 2)) < ROUND_OFF < largest(tables.residuals(without, 3))


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
    """With rows on the way; the other two of `KINDS` agree bit by bit (test_in_place.py)."""
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
    for letter, weight, c in tables.FILE.steps(id):
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
