"""Projection and relaxation: fallbacks, any base, relaxed times, what is refused."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from phasebench.benchmarks.problems import problem
from phasebench.integrators.driver import integrate
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.families.projection import projection_method
from phasebench.integrators.families.relaxation import relaxation_method
from phasebench.integrators.registry import METHODS as REGISTRY
from phasebench.integrators.registry import method
from support.solutions import energy_errors, last

BOX = problem("henon-heiles:box")


def test_a_fallback_is_a_step_of_the_base_and_is_counted():
    """On a circular orbit the gradients of H and L are linearly dependent."""
    P = problem("kepler")
    s = integrate(P, "rk4-projected-invariants", h=0.02, steps=500, q0=[1.0, 0.0], p0=[0.0, 1.0])
    missed = np.flatnonzero(np.isnan(s.parameter))
    assert 0 < len(missed) == s.counts["fallbacks"]
    for i in missed[:5]:
        base = integrate(P, "rk4", h=0.02, steps=1, q0=s.q[i], p0=s.p[i])
        assert np.abs([base.q[-1] - s.q[i + 1], base.p[-1] - s.p[i + 1]]).max() < 1e-15


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
        assert np.abs(energy_errors(s)).max() < 2e-14 * 0.02
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


# -- relaxation -------------------------------------------------------------------------------------------------------


def offsets(gamma, h):
    """t_n - n h for steps with these gamma, each aimed at the next grid time."""
    found = [0.0]
    for g in gamma:
        found.append((g - 1) * (h - found[-1]))
    return np.array(found[1:])


def test_relaxation_of_a_low_order_is_refused():
    assert (relaxation_method("rk4").order, relaxation_method("rk4", adjust_time=False).order) == (4, 3)
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
