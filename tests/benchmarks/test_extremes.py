"""Measures of the studies of extremes where the answer is known; `test_studies` measures stored rows again."""

from __future__ import annotations

import dataclasses
import math

import mpmath
import numpy as np
import pytest

from phasebench.benchmarks.measure import oscillator
from phasebench.benchmarks.measure.exact_maps import DIGITS, exact_matrix
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.studies.extremes import limits, multistep, round_off
from phasebench.integrators.coefficients.multistep import QUINLAN_TREMAINE

# -- stability ---------------------------------------------------------------------------------------------------------


def test_limit_at_a_triple_root_is_confirmed_where_growth_shows():
    """Of chin-4a tr M + 2 = (12 - z^2)^3 / 432; Stormer-Verlet's trace leaves -2 with a slope, at once."""
    chosen = integrator("chin-4a")
    M = oscillator.matrix(chosen, 3.0)
    assert np.trace(M) + 2 == pytest.approx(3**3 / 432, rel=1e-12)
    found = oscillator.find(chosen)
    assert found.limit == pytest.approx(math.sqrt(12), rel=2e-6)
    assert not limits.grows(chosen, found.limit * (1 + limits.BESIDE))
    assert limits.beyond(chosen, found) == [found.limit * (1 + 100 * limits.BESIDE)]
    assert limits.confirm(chosen, found) == (2, 2)
    verlet = integrator("stormer-verlet")
    found = oscillator.find(verlet)
    assert limits.beyond(verlet, found) == [found.limit * (1 + limits.BESIDE)]
    following = dataclasses.replace(found, intervals=(*found.intervals, (found.limit * (1 + limits.BESIDE), None)))
    assert limits.beyond(verlet, following) == []


# -- round-off ---------------------------------------------------------------------------------------------------------


def test_elements_and_phase_error_of_a_kepler_orbit():
    """a = 1, e = 0.6, E = 1: M = 1 - 0.6 sin 1; a mean anomaly late by 1e-9 is a phase error of 1e-9."""

    def at(E):
        x, y, r = math.cos(E) - 0.6, 0.8 * math.sin(E), 1 - 0.6 * math.cos(E)
        return (x, y), (-math.sin(E) / r, 0.8 * math.cos(E) / r)

    with mpmath.workdps(DIGITS):
        a, M = map(float, round_off.elements(*at(1.0)))
        assert (a, M) == (pytest.approx(1, rel=1e-14), pytest.approx(1 - 0.6 * math.sin(1), rel=1e-14))
        Q, P = zip(at(0.0), at(1.0), strict=True)
        energy, phase = round_off.kepler_errors([0, 1], Q, P, M - 1e-9)
    assert abs(energy[1]) < 1e-14
    assert phase[1] == pytest.approx(1e-9, rel=1e-5)


def test_state_error_by_kind_of_summation():
    """After 4e6 steps of 0.01 on the oscillator plain sums have lost most digits."""
    steps = 4_000_000
    with mpmath.workdps(DIGITS):
        exact = exact_matrix("stormer-verlet", {}, 0.01) ** steps * mpmath.matrix([0.7, 0.4])
        far = {kind: [x[-1] for x in round_off.by_hand(kind, 0.01, steps, 10, 0.7, 0.4)] for kind in round_off.BY_HAND}
        error = {kind: float(mpmath.norm(mpmath.matrix(y) - exact)) for kind, y in far.items()}
    assert error[round_off.WHOLE] < 2e-15
    assert error[round_off.HALF] > 1e-14
    assert error[round_off.PLAIN] > 1e-13


# -- multistep methods -------------------------------------------------------------------------------------------------


def test_stability_limit_of_a_multistep_method_is_that_of_its_roots():
    """On one side of it all roots of rho + (h omega)^2 sigma are on the circle, on the other one is outside."""
    limit, table = oscillator.find(integrator("quinlan-tremaine-8")).limit, QUINLAN_TREMAINE[8]
    rho, sigma = (np.array(x, dtype=float)[::-1] for x in (table.rho, table.sigma))
    inside, outside = (np.abs(np.roots(rho + (limit * x) ** 2 * sigma)).max() - 1 for x in (1 - 1e-6, 1 + 1e-6))
    assert inside < 1e-9 < 1e-5 < outside


@pytest.mark.parametrize(("order", "N"), [(8, 10.0), (8, 60.0), (14, 132.0)])
def test_both_theories_agree_on_the_circle(order, N):
    """The closed form, and the eigenvalues of the product of all steps."""
    table = QUINLAN_TREMAINE[order]
    one, other = multistep.circular_rate(table, N), multistep.floquet_rate(table, N, 0.0)
    assert one > 0.01
    # the closed form has the radius of the recursion's own circle, the product the exact one
    assert one == pytest.approx(other, rel=0.35 if N < 60 else 0.01)
