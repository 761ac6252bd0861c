"""Projection and relaxation: conservation to round-off, symmetry, relaxed times, fallbacks, evaluations."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from phasebench.benchmarks.measure.metrics import order, slope
from phasebench.benchmarks.problems import problem
from phasebench.integrators.driver import integrate
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.families import projection
from phasebench.integrators.families.projection import projection_method
from phasebench.integrators.families.relaxation import relaxation_method
from phasebench.integrators.records.projection import METHODS
from phasebench.integrators.registry import METHODS as REGISTRY
from phasebench.integrators.registry import method
from support.solutions import last, relative_errors
from support.systems import chain

BOX, KEPLER = problem("henon-heiles:box"), problem("perturbed-kepler")
PROJECTED = {m.id: m for m in METHODS if m.family == "projection"}
CASES = [(P, h, id) for P, h in ((BOX, 0.05), (KEPLER, 0.01)) for id, m in PROJECTED.items() if not m.lacks(P.system)]
#: Relative error to which an invariant is conserved; invariants that are not err by FAR times more.
KEPT, FAR = 2e-14, 1e3


@pytest.mark.parametrize(("P", "h", "id"), CASES, ids=lambda x: getattr(x, "id", x))
def test_projected_invariants_are_conserved_to_round_off(P, h, id):
    m = PROJECTED[id]
    base, onto, _ = m.data
    s, plain = (integrate(P, x, h=h, t_end=200) for x in (m, base))
    assert s.status == "ok"
    assert s.counts["fallbacks"] == 0
    found = relative_errors(s)
    assert max(found if onto == "invariants" else found[:1]) < KEPT
    assert relative_errors(plain)[0] > FAR * KEPT
    if P is KEPLER and onto == "energy":
        assert found[1] > FAR * KEPT


def there_and_back(id, steps=300):
    s = integrate(KEPLER, id, h=0.02, steps=steps)
    back = integrate(KEPLER, id, h=0.02, steps=steps, q0=s.q[-1], p0=-s.p[-1])
    return np.abs([back.q[-1] - s.q[0], -back.p[-1] - s.p[0]]).max()


@pytest.mark.parametrize("id", PROJECTED)
def test_only_symmetric_projection_is_reversible(id):
    assert there_and_back(id) < 1e-10 if PROJECTED[id].symmetric else there_and_back(id) > 1e-8


@pytest.mark.parametrize("id", ["stormer-verlet-symmetric-projection"])
def test_multipliers_are_of_the_size_of_the_local_error(id):
    h = np.array([0.2, 0.1, 0.05])
    mu = [np.abs(integrate(BOX, id, h=x, t_end=50).parameter).max() for x in h]
    assert slope(np.log(h), np.log(mu)).value == pytest.approx(PROJECTED[id].order + 1, abs=0.3)


@pytest.mark.parametrize("id", ["rk4-projected-energy"])
def test_control_a_gradient_with_the_wrong_sign_fails(id, monkeypatch):
    right = projection.functions

    def wrong(system, invariants, arithmetic):
        constraint, gram, _ = right(system, invariants, arithmetic)
        return constraint, gram, right(system, [-e for e in invariants], arithmetic)[2]

    monkeypatch.setattr(projection, "functions", wrong)
    s = integrate(BOX, id, h=0.1, steps=500)
    assert s.status == "no-root"
    assert s.counts["fallbacks"] > 0.9 * s.counts["steps"]
    assert "could not be projected" in s.reason


def test_a_fallback_is_a_step_of_the_base_and_is_counted():
    """On a circular orbit the gradients of H and L are linearly dependent."""
    P = problem("kepler")
    s = integrate(P, "rk4-projected-invariants", h=0.02, steps=500, q0=[1.0, 0.0], p0=[0.0, 1.0])
    missed = np.flatnonzero(np.isnan(s.parameter))
    assert 0 < len(missed) == s.counts["fallbacks"]
    for i in missed[:5]:
        base = integrate(P, "rk4", h=0.02, steps=1, q0=s.q[i], p0=s.p[i])
        assert np.abs([base.q[-1] - s.q[i + 1], base.p[-1] - s.p[i + 1]]).max() < 1e-15


def test_a_correction_longer_than_the_state_is_rejected():
    s = integrate(problem("kepler"), "rk4-projected-energy", h=0.6, steps=200)
    assert s.status == "collision"
    assert np.abs(s.q).max() < 1000


def test_multipliers_are_retried_from_zero():
    """At this h the pericentre is hardly resolved: without a second attempt from zero 10% of steps fall back."""
    s = integrate(problem("kepler"), "stormer-verlet-symmetric-projection", h=0.2, steps=200)
    assert s.status == "ok"
    assert s.counts["fallbacks"] == 0


def test_any_base_and_its_parameters_can_be_projected():
    splitting = next(m.id for m in REGISTRY if m.family == "splitting")
    for base in ("explicit-euler", "symplectic-euler-q", "scheme-ii", splitting):
        m = projection_method(base)
        assert (m.id, m.order) == (f"{base}-projected-energy", method(base).order)
        s = integrate(BOX, m, h=0.02, t_end=20)
        assert s.status == "ok"
        assert relative_errors(s)[0] < KEPT
    m = projection_method("scheme-i", symmetric=True, lam=Fraction(1, 2))
    assert (m.order, m.symmetric, m.parameters["lam"]) == (2, True, Fraction(1, 2))
    with pytest.raises(InvalidInput, match="not symmetric"):
        m(lam=Fraction(1, 3))


def test_invalid_projections_are_refused():
    with pytest.raises(InvalidInput, match="is not symmetric"):
        projection_method("rk4", symmetric=True)
    with pytest.raises(InvalidInput, match="family averaged"):
        projection_method("avf")
    with pytest.raises(InvalidInput, match="energy, invariants"):
        projection_method("rk4", onto="momentum")
    with pytest.raises(InvalidInput, match="further invariants"):
        integrate(BOX, "rk4-projected-invariants", h=0.1, steps=1)


def test_a_long_correction_of_either_half_is_a_fallback():
    """Implicit Euler shrinks the energy of (1, 0) and (0, 1) of the oscillator to a hundredth."""
    P = problem("harmonic-oscillator")
    for start in (([1.0], [0.0]), ([0.0], [1.0])):
        long, short = (
            integrate(P, projection_method("implicit-euler"), h=h, steps=1, q0=start[0], p0=start[1])
            for h in (10.0, 0.5)
        )
        assert long.counts["fallbacks"] == 1
        assert abs(long.q[-1, 0] ** 2 + long.p[-1, 0] ** 2 - 1 / 101) < 1e-12, "it is the base's step"
        assert short.counts["fallbacks"] == 0


@pytest.mark.parametrize(("base", "most"), [("implicit-midpoint", 15.2), ("scheme-iii", 20.3)])
def test_stages_start_from_earlier_steps_and_attempts(base, most):
    """The two base methods take 14.2 and 19.3 evaluations per step.

    They take 16.1 and 21.3 without starting from earlier steps, 17.1 and 23.1 without starting from the last attempt.
    """
    s = integrate(BOX, projection_method(base, symmetric=True), h=0.02, steps=40)
    assert s.status == "ok"
    assert s.counts["fallbacks"] == 0
    assert s.counts["gradient"] < most * 40


# -- relaxation -------------------------------------------------------------------------------------------------------

RELAXED = {m.id: m for m in METHODS if m.family == "relaxation"}
#: Factor by which steps of a high-order method are longer, so that its error exceeds round-off.
LONGER = {"dop853-relaxation": 8}


@pytest.mark.parametrize(("P", "h"), [(BOX, 0.05), (KEPLER, 0.01)], ids=["box", "kepler"])
@pytest.mark.parametrize("id", ["rk4-relaxation", "dop853-relaxation"])
def test_relaxed_steps_conserve_energy_to_round_off(P, h, id):
    h *= LONGER.get(id, 1)
    s, plain = (integrate(P, m, h=h, t_end=200) for m in (RELAXED[id], RELAXED[id].data[0]))
    assert s.status == "ok"
    assert s.counts["fallbacks"] == 0
    assert relative_errors(s)[0] < KEPT
    assert relative_errors(plain)[0] > FAR * KEPT


def offsets(gamma, h):
    """t_n - n h for steps with these gamma, each aimed at the next grid time."""
    found = [0.0]
    for g in gamma:
        found.append((g - 1) * (h - found[-1]))
    return np.array(found[1:])


@pytest.mark.parametrize("id", RELAXED)
def test_the_relaxed_time_stays_near_the_grid(id):
    h = np.array([0.2, 0.1, 0.05]) * LONGER.get(id, 2) / 2
    greatest = []
    for x in h:
        gamma = integrate(BOX, id, h=x, t_end=1000).parameter
        offset = np.abs(offsets(gamma, x))
        greatest.append(offset.max())
        assert offset[-len(offset) // 4 :].max() < 1.2 * offset[: len(offset) // 4].max()
        # Control: steps that do not aim at the grid drift away from it.
        assert abs((gamma - 1).sum() * x) > 20 * offset.max()
    assert slope(np.log(h), np.log(greatest)).value == pytest.approx(RELAXED[id].order, abs=0.5)


def test_control_without_adjusted_time_an_order_is_lost():
    P, base, h = problem("pendulum"), method("rk4"), 0.1 / 2.0 ** np.arange(4)
    exact = last(integrate(P, "rk4", h=0.001, t_end=10))
    observed = []
    for adjust in (True, False):
        m = relaxation_method(base, adjust_time=adjust)
        e = [np.abs(last(integrate(P, m, h=x, t_end=10)) - exact).max() for x in h]
        observed.append(order(h, e))
        assert m.order == round(observed[-1].value)
    assert [o.value for o in observed] == pytest.approx([4, 3], abs=0.2)
    for id in ("explicit-euler", "stormer-verlet"):
        with pytest.raises(InvalidInput, match="order 2 or more"):
            relaxation_method(id)


def test_a_step_without_a_root_is_a_counted_base_step():
    P = problem("pendulum")
    s = integrate(P, "rk4-relaxation", h=0.8, steps=125, q0=[0.0], p0=[2.5])
    missed = np.flatnonzero(np.isnan(s.parameter))
    assert 0 < len(missed) == s.counts["fallbacks"]
    i = missed[0]
    length = 0.8 - [0.0, *offsets(s.parameter[:i], 0.8)][-1]
    base = integrate(P, "rk4", h=length, steps=1, q0=s.q[i], p0=s.p[i])
    assert np.abs(last(base) - np.concatenate([s.q[i + 1], s.p[i + 1]])).max() < 1e-13


@pytest.mark.parametrize("d", [2, 3])
def test_evaluations_are_stages_plus_newton_steps(d):
    """One or two Newton steps suffice near gamma = 1."""
    start = {"q0": np.linspace(0.3, 0.9, d), "p0": np.linspace(-0.2, 0.4, d)}
    told, plain = (integrate(chain(d), id, h=0.1, steps=20, **start).counts for id in ("rk4-relaxation", "rk4"))
    assert told["fallbacks"] == told["iterations"] == 0
    assert 0 < told["gradient"] - plain["gradient"] <= 3 * 20
