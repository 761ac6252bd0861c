"""Stability intervals of step maps on the oscillator: closed forms, narrow instability windows, growth from h = 0."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.measure.linear_stability import LAST, SPACING, radius, stability
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
