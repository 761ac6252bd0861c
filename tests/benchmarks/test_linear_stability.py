"""Stability intervals of step maps on the oscillator: closed forms, narrow instability windows, growth from h = 0."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from phasebench.benchmarks.measure.linear_stability import LAST, SPACING, margins, radius, stability
from support.step_maps import of_trace


def drift(a):
    return np.array([[1.0, a], [0.0, 1.0]])


def kick(b):
    return np.array([[1.0, 0.0], [-b, 1.0]])


def verlet(z):
    return kick(z / 2) @ drift(z) @ kick(z / 2)


def scheme_i(lam, z):
    """Scheme I: Q = lam q' + (1 - lam) q, P = (1 - lam) p' + lam p; q' = q + z P, p' = p - z Q."""
    left = np.array([[1.0, -z * (1 - lam)], [z * lam, 1.0]])
    right = np.array([[1.0, z * lam], [-z * (1 - lam), 1.0]])
    return np.linalg.solve(left, right)


def triple_jump(z):
    g = 1 / (2 - 2 ** (1 / 3))
    return verlet(g * z) @ verlet((1 - 2 * g) * z) @ verlet(g * z)


def runge_kutta(*c):
    """The map of an explicit method with the stability polynomial sum c_k z^k."""

    def step(z):
        A = z * np.array([[0.0, 1.0], [-1.0, 0.0]])
        return sum(ck * np.linalg.matrix_power(A, k) for k, ck in enumerate(c))

    return step


def same(found, expected):
    return len(found) == len(expected) and np.allclose(found, expected, atol=1e-6)


def test_stormer_verlet_is_stable_below_2():
    found = stability(verlet)
    assert same(found.intervals, [(0, 2)])
    assert found.limit == pytest.approx(2, abs=1e-8)
    assert found.windows == ()


@pytest.mark.parametrize("lam", [-1.0, 0.0, 0.3, 0.45, 1.0, 2.5])
def test_scheme_i_has_its_proven_limit(lam):
    limit = 2 / abs(1 - 2 * lam)
    found = stability(lambda z: scheme_i(lam, z))
    assert (found.limit is None) is (limit > LAST)
    assert limit > LAST or found.limit == pytest.approx(limit, abs=1e-7)


def test_midpoint_rule_has_no_limit():
    found = stability(lambda z: scheme_i(0.5, z))
    assert (found.limit, found.intervals, found.scanned) == (None, ((0.0, LAST),), LAST)


def test_limits_of_runge_kutta_methods():
    assert stability(runge_kutta(1, 1, 1 / 2, 1 / 6, 1 / 24)).limit == pytest.approx(8**0.5, abs=1e-7)
    assert stability(runge_kutta(1, 1, 1 / 2, 1 / 6)).limit == pytest.approx(3**0.5, abs=1e-7)


@pytest.mark.parametrize("c", [(1, 1), (1, 1, 1 / 2), (1, 1, 1 / 2, 1 / 6, 1 / 24, 1 / 120)])
def test_methods_that_grow_at_every_step_have_limit_0(c):
    """Orders 1, 2 and 5: |R(i z)| > 1 for every small z, if only by z^6 / 144."""
    found = stability(runge_kutta(*c))
    assert found.limit == 0
    assert all(start > 0 for start, _ in found.intervals)
    assert radius(runge_kutta(*c)(0.5)) > 1


def test_growth_that_starts_below_round_off_is_growth():
    """|R|^2 - 1 = 2e-4 z^8 exceeds round-off from z = 0.2 on: no stable interval; a damped map has one."""

    def rotation(z):
        return np.array([[np.cos(z), np.sin(z)], [-np.sin(z), np.cos(z)]])

    assert stability(lambda z: (1 + 1e-4 * z**8) * rotation(z)).limit == 0
    damped = stability(lambda z: (1 - 1e-4 * z**2 * (1 - z**2)) * rotation(z))
    assert damped.limit == pytest.approx(1, abs=1e-5)


def test_windows_of_a_composition():
    """The triple jump of leapfrogs is unstable where |trace| > 2; each bound of an interval has |trace| = 2."""
    found = stability(triple_jump)
    trace = [abs(np.trace(triple_jump(z))) for z in np.arange(0.0005, 6, 0.001)]
    changes = [0.0005 + 0.001 * k for k, (a, b) in enumerate(pairwise(trace)) if (a > 2) != (b > 2)]
    bounds = [z for piece in found.intervals for z in piece if z > 0]
    assert np.allclose(bounds, changes, atol=0.0011)
    assert found.limit == pytest.approx(1.573, abs=1e-3)


@pytest.mark.parametrize(("width", "part"), [(0.3, 1 / 3), (1e-2, 1 / 3), (1e-3, 1 / 3), (1e-3, 0.1), (1e-3, 0.9)])
def test_narrow_window_between_scan_points_is_found(width, part):
    """Between two points of the scan the trace falls below -2 and returns."""
    at, bend = 3.0 + SPACING * part, 1.0
    low = -2 - bend * width**2 / 4
    found = stability(of_trace(lambda z: min(low + bend * (z - at) ** 2, 2 - 1e-3)))
    scan = np.arange(SPACING, LAST, SPACING)
    if width < SPACING / 2:
        assert all(abs(low + bend * (z - at) ** 2) <= 2 for z in scan if abs(z - at) < 1), "the scan does not see it"
    ((start, end),) = found.windows
    assert (start, end) == (pytest.approx(at - width / 2, abs=1e-6), pytest.approx(at + width / 2, abs=1e-6))


def test_trace_that_touches_minus_2_leaves_no_window():
    found = stability(of_trace(lambda z: 2 * np.cos(z)))
    assert found.intervals == ((0.0, LAST),)


def test_narrow_stable_interval_is_found():
    """The trace rises from far below -2 to far above 2 within the spacing of the scan."""
    found = stability(of_trace(lambda z: 1000 * (z - 5.01)))
    assert same(found.intervals, [(5.008, 5.012)])
    assert found.limit == 0


def test_failed_step_ends_the_scan():
    found = stability(lambda z: verlet(z) if z < 1 else None)
    assert found.limit is None
    assert found.scanned == pytest.approx(1 - SPACING)
    nowhere = stability(lambda z: None)
    assert (nowhere.intervals, nowhere.scanned) == ((), 0.0)


def test_failed_step_between_scan_points_is_not_stable():
    whole = stability(verlet, last=1.05)
    found = stability(lambda z: None if abs(z - 0.525) < 0.01 else verlet(z), last=1.05)
    assert (whole.intervals, found.intervals) == (((0.0, whole.scanned),), ())


def test_pole_does_not_end_the_scan():
    """A map with entries of 1e5 on an interval, trace 0 and determinant 1 is stable at every z."""

    def step(z):
        size = 1e5 if abs(z - 3) < 0.4 else 1.0
        return np.array([[0.0, -size], [1 / size, 0.0]])

    assert stability(step).intervals == ((0.0, LAST),)


def test_rounding_of_a_large_matrix_is_not_instability():
    """Large matrices with trace 1/2 and determinant 1 up to rounding are stable, with determinant 3 (control) not."""
    a = 1e7 * np.random.default_rng(3).uniform(-2, 2, 50)
    rotations = [np.array([[x, 1e7], [(x * (0.5 - x) - 1) / 1e7, 0.5 - x]]) for x in a]
    assert min(np.linalg.det(M) for M in rotations) < 0.999 or max(np.linalg.det(M) for M in rotations) > 1.001
    assert all((margins(M) >= 0).all() for M in rotations)
    growing = [np.array([[x, 1e7], [(x * (0.5 - x) - 3) / 1e7, 0.5 - x]]) for x in a]
    assert not any((margins(M) >= 0).all() for M in growing)


def test_symplectic_interval_ended_by_growth_is_stable():
    """The trace is 2.5 below z = 1, then 0; the determinant is 1 up to z = 2, then larger: stable from 1 to 2."""
    found = stability(lambda z: np.array([[2.5 * (z < 1), -max(1.0, z - 1)], [1.0, 0.0]]))
    assert same(found.intervals, [(1, 2)])


def test_scan_of_a_steep_polynomial_stops_early():
    called = []

    def step(z):
        called.append(z)
        return verlet(z**3)

    found = stability(step)
    assert found.limit == pytest.approx(2 ** (1 / 3), abs=1e-7)
    assert found.scanned < LAST
    assert max(called) < LAST


def test_large_entries_do_not_make_a_map_stable():
    """A map with entries 1e6 and trace 100 grows, whatever its rounded determinant is."""
    huge = stability(lambda z: 1e16 * np.array([[-1.0, 1.0], [-1.0, 1.0]]) + 1e9 * np.eye(2))
    assert huge.intervals == ()
    assert margins([[1e6, 1e6], [-1e6 - 100 / 1e6, 100 - 1e6]]).min() < 0
    assert (margins([[0.5, 100.0], [-0.0075, 0.5]]) > 0).all()
