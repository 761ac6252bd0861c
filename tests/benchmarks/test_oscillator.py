"""Stability intervals on the oscillator: known limits, gaps, long runs."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.measure import linear_stability, oscillator
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.studies.extremes import limits
from phasebench.integrators.errors import InvalidInput
from support.commands import call

DIGITS = 1e-10


def test_known_limits_are_found_to_ten_digits():
    found = limits.known_limits(True)
    assert len(found) > 25
    assert [row for row in found if not row["agrees"]] == []


def of_trace(trace):
    """A symplectic map, z -> matrix, with the trace ``trace(z)``."""
    return lambda z: np.array([[trace(z), -1.0], [1.0, 0.0]])


def rounded(trace, rng):
    """`of_trace` with the round-off of a step in the trace."""
    return of_trace(lambda z: trace(z) * (1 + 2e-16 * rng.standard_normal()))


def test_ends_and_touches_at_multiple_roots_are_found_to_ten_digits(monkeypatch):
    """tr = -2 + 4 u^n (1 + b z^2), u = 1 - (z/a)^2: for n = 3 an end at a, for n = 2 a touch."""
    rng = np.random.default_rng(7)
    traces = {}
    for _ in range(8):
        a, b = rng.uniform(1.2, 6), rng.uniform(-0.002, 0.002)
        for n in (2, 3):
            traces[a, n] = rounded(lambda z, a=a, b=b, n=n: -2 + 4 * (1 - (z / a) ** 2) ** n * (1 + b * z * z), rng)

    def errors(n):
        found = {a: oscillator.of_matrix(trace) for (a, m), trace in traces.items() if m == n}
        return [abs((f.touches[0] if n == 2 else f.limit) / a - 1) for a, f in found.items()]

    assert max(*errors(2), *errors(3)) < DIGITS
    monkeypatch.setattr(linear_stability, "multiple_root", lambda f, z, reach: z)
    assert min(max(errors(2)), max(errors(3))) > 10 * DIGITS


@pytest.mark.parametrize(("width", "part"), [(0.3, 1 / 3), (1e-2, 1 / 3), (1e-3, 1 / 3), (1e-3, 0.1), (1e-3, 0.9)])
def test_narrow_gap_after_the_first_interval(width, part):
    """Between two points of the scan the trace falls below -2 and returns."""
    at, low = 3.0 + linear_stability.SPACING * part, -2 - width**2 / 4
    found = oscillator.of_matrix(of_trace(lambda z: min(low + (z - at) ** 2, 1.99)))
    (_, first), (second, last) = found.intervals
    assert (first, second, last) == (
        pytest.approx(at - width / 2, rel=DIGITS),
        pytest.approx(at + width / 2, rel=DIGITS),
        None,
    )
    assert found.touches == ()


def test_gauss_touches_where_its_phase_is_pi():
    """The stability function R = (1 - z^2/12 + i z/2) / (1 - z^2/12 - i z/2) is -1 at z^2 = 12."""
    found = oscillator.find(integrator("gauss-2"))
    assert found.limit is None
    assert found.touches == pytest.approx([math.sqrt(12)], rel=1e-5)


def test_lobatto_has_a_gap():
    found = oscillator.find(integrator("lobatto-iiia-iiib-3"))
    assert np.allclose(found.intervals, [(0, math.sqrt(8)), (math.sqrt(12), math.sqrt(24))], rtol=DIGITS, atol=0)


def test_long_runs_confirm_limits_and_refute_a_wrong_one():
    chosen = integrator("blanes-moan-s6")
    found = oscillator.find(chosen)
    assert len(found.intervals) > 1
    right, runs = limits.confirm(chosen, found)
    assert right == runs >= 4
    wrong = oscillator.Found(((0.0, found.limit * 1.004), *found.intervals[1:]), (), found.scanned, found.how)
    assert limits.confirm(chosen, wrong)[0] < limits.confirm(chosen, wrong)[1]


def test_nonlinear_map_is_judged_by_long_runs():
    found = oscillator.find(integrator("rk4-relaxation"))
    assert found.how == oscillator.RUNS
    assert found.limit == pytest.approx(math.sqrt(8), rel=2e-3)
    assert found.reason


def test_a_step_may_be_linear_on_the_unit_vectors_alone():
    assert oscillator.linear(integrator(lambda system, q, p, h: (q, -p)))
    assert not oscillator.linear(integrator(lambda system, q, p, h: (q, abs(p))))


def test_integrators_without_a_step_are_refused():
    with pytest.raises(InvalidInput, match="tolerance"):
        pb.stability("heyoka")
    with pytest.raises(InvalidInput, match="requires"):
        pb.stability("wisdom-holman")


def test_command_prints_the_contract():
    found = json.loads(call("stability", "scheme-i", "--param", "lam=1/2", "--json").stdout)
    assert {"method", "params", "limit", "intervals", "how"} <= found.keys()
    assert (found["limit"], found["intervals"], found["params"]) == (None, [[0.0, None]], {"lam": "1/2"})
    assert pb.stability("scheme-i", parameters={"lam": "1/3"}).to_frame()["limit"].tolist() == [pytest.approx(6.0)]
    done = call("stability", "stormer-verlet")
    assert done.exit_code == 0
    assert "trace of the step map" in done.stdout
    assert call("stability", "stormer-verlett", "--json").exit_code == 2


# -- intervals of a matrix -------------------------------------------------------------------------------------------


def runge_kutta(*c):
    """The map of an explicit method with the stability polynomial sum c_k z^k."""

    def step(z):
        A = z * np.array([[0.0, 1.0], [-1.0, 0.0]])
        return sum(ck * np.linalg.matrix_power(A, k) for k, ck in enumerate(c))

    return step


def same(found, expected):
    return len(found) == len(expected) and np.allclose(found, expected, atol=1e-6)


@pytest.mark.parametrize("c", [(1, 1), (1, 1, 1 / 2), (1, 1, 1 / 2, 1 / 6, 1 / 24, 1 / 120)])
def test_methods_that_grow_at_every_step_have_limit_0(c):
    """Orders 1, 2 and 5: |R(i z)| > 1 for every small z, if only by z^6 / 144."""
    found = linear_stability.stability(runge_kutta(*c))
    assert found.limit == 0
    assert all(start > 0 for start, _ in found.intervals)
    assert linear_stability.radius(runge_kutta(*c)(0.5)) > 1


def test_growth_that_starts_below_round_off_is_growth():
    """|R|^2 - 1 = 2e-4 z^8 exceeds round-off from z = 0.2 on: no stable interval; a damped map has one."""

    def rotation(z):
        return np.array([[np.cos(z), np.sin(z)], [-np.sin(z), np.cos(z)]])

    assert linear_stability.stability(lambda z: (1 + 1e-4 * z**8) * rotation(z)).limit == 0
    damped = linear_stability.stability(lambda z: (1 - 1e-4 * z**2 * (1 - z**2)) * rotation(z))
    assert damped.limit == pytest.approx(1, abs=1e-5)


def test_narrow_stable_interval_is_found():
    """The trace rises from far below -2 to far above 2 within the spacing of the scan."""
    found = linear_stability.stability(of_trace(lambda z: 1000 * (z - 5.01)))
    assert same(found.intervals, [(5.008, 5.012)])
    assert found.limit == 0


def test_failed_step_ends_the_scan():
    verlet_s = of_trace(lambda z: 2 - z**2)
    found = linear_stability.stability(lambda z: verlet_s(z) if z < 1 else None)
    assert found.limit is None
    assert found.scanned == pytest.approx(1 - linear_stability.SPACING)
    nowhere = linear_stability.stability(lambda z: None)
    assert (nowhere.intervals, nowhere.scanned) == ((), 0.0)
