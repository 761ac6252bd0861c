"""Stability intervals on the oscillator: closed forms to ten digits, gaps, points of |trace| = 2, long runs."""

from __future__ import annotations

import json
import math
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.measure import linear_stability, oscillator
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.studies.extremes import limits
from phasebench.integrators.errors import InvalidInput
from support.commands import call
from support.step_maps import of_trace

DIGITS = 1e-10


@pytest.mark.parametrize(
    ("method", "limit"),
    [
        ("stormer-verlet", 2.0),
        ("rk4", math.sqrt(8)),
        ("forest-ruth", (2 - 2 ** (1 / 3)) * math.sqrt(2 + 2 * 2 ** (1 / 3))),
        ("explicit-euler", 0.0),
        ("chin-4a", 2 * math.sqrt(3)),
        ("hessian-free-badab", 2 * math.sqrt(3)),
    ],
)
def test_limits_to_ten_digits(method, limit):
    found = oscillator.find(integrator(method))
    assert found.how == oscillator.TRACE
    assert found.limit == pytest.approx(limit, rel=DIGITS)


def rounded(trace, rng):
    """`of_trace` with the round-off of a step in the trace."""
    return of_trace(lambda z: trace(z) * (1 + 2e-16 * rng.standard_normal()))


def test_ends_and_touches_at_multiple_roots_are_found_to_ten_digits(monkeypatch):
    """tr = -2 + 4 u^n (1 + b z^2), u = 1 - (z/a)^2: for n = 3 an end at a, for n = 2 a touch."""
    rng = np.random.default_rng(7)
    traces = {}
    for _ in range(20):
        a, b = rng.uniform(1.2, 6), rng.uniform(-0.002, 0.002)
        for n in (2, 3):
            traces[a, n] = rounded(lambda z, a=a, b=b, n=n: -2 + 4 * (1 - (z / a) ** 2) ** n * (1 + b * z * z), rng)

    def errors(n):
        found = {a: oscillator.of_matrix(trace) for (a, m), trace in traces.items() if m == n}
        return [abs((f.touches[0] if n == 2 else f.limit) / a - 1) for a, f in found.items()]

    assert max(*errors(2), *errors(3)) < DIGITS
    monkeypatch.setattr(linear_stability, "multiple_root", lambda f, z, reach: z)
    assert min(max(errors(2)), max(errors(3))) > 10 * DIGITS


def test_scheme_i_has_one_interval_next_to_a_pole():
    """Its trace has a pole at 1/sqrt(lambda (lambda - 1)), where round-off is large; at 1/2 it has no limit.

    At lambda = 3 the pole, 0.408, is between the same points of the scan as the limit, 0.4.
    """
    drawn = [Fraction(round(64 * x), 64) for x in np.random.default_rng(31).uniform(-8, 9, 60)]
    for lam in (Fraction(1, 3), *(Fraction(k, 4) for k in range(-40, 45) if k != 2), *drawn):
        found = oscillator.find(integrator("scheme-i", parameters={"lam": lam}))
        assert found.limit == pytest.approx(float(2 / abs(1 - 2 * lam)), rel=DIGITS), lam
        assert len(found.intervals) == 1, lam


def test_pole_between_scan_points_is_not_the_limit():
    """tr = 2 - z^2 / (1 - 6 z^2): -2 at 0.4, infinite at 0.40825, then above 2 for all z."""
    found = linear_stability.stability(of_trace(lambda z: 2 - z**2 / (1 - 6 * z**2)))
    assert found.limit == pytest.approx(0.4, abs=1e-6)


@pytest.mark.parametrize("width", [1e-2, 1e-3])
def test_narrow_gap_after_the_first_interval(width):
    """Between two points of the scan the trace falls below -2 and returns."""
    at, low = 3.0 + linear_stability.SPACING / 3, -2 - width**2 / 4
    found = oscillator.of_matrix(of_trace(lambda z: min(low + (z - at) ** 2, 1.99)))
    (_, first), (second, last) = found.intervals
    assert (first, second, last) == (
        pytest.approx(at - width / 2, rel=DIGITS),
        pytest.approx(at + width / 2, rel=DIGITS),
        None,
    )
    assert found.touches == ()


def test_double_root_is_a_touch_not_an_end():
    found = oscillator.of_matrix(of_trace(lambda z: 2 * np.cos(z)))
    assert found.intervals == ((0.0, None),)
    assert np.allclose(found.touches[:3], np.pi * np.arange(1, 4), atol=1e-6)


def test_close_touches_are_all_found():
    found = oscillator.of_matrix(of_trace(lambda z: 2 * np.cos(8 * z) if z < 5 else 3.0))
    assert np.allclose(found.touches, np.pi / 8 * np.arange(1, 13), atol=1e-6)


def test_trace_just_below_2_has_no_touch():
    found = oscillator.of_matrix(of_trace(lambda z: 1.99999 * np.cos(z)))
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


def test_user_step_and_step_with_memory():
    """A Runge-Kutta step is a linear map; a step with memory is no map of the state."""
    found = pb.stability(limits.OTHERS["kutta-3"])
    assert found.limit == pytest.approx(math.sqrt(3), rel=DIGITS)

    def remembering(system, q, p, h, last=[0.0]):  # noqa: B006
        last[0] += h
        return q + h * p * (1 + last[0] % 0.7), p - h * q

    assert not oscillator.linear(integrator(remembering))


def test_stability_as_a_frame_and_as_before():
    found = pb.stability("scheme-i", parameters={"lam": "1/3"})
    assert found.parameters == {"lam": "1/3"}
    assert found.to_frame()["limit"].tolist() == [found.limit]
    with pytest.warns(DeprecationWarning, match=r"write \.to_frame\(\)\.iloc"):
        assert found.iloc[0]["limit"] == found.limit
    assert not hasattr(found, "limits")


def test_nonlinear_map_that_always_grows_has_limit_0():
    found = oscillator.find(integrator(lambda system, q, p, h: (1.02 * q + h * p, 1.02 * p - h * q * abs(q))))
    assert (found.how, found.limit, found.intervals) == (oscillator.RUNS, 0.0, ())
    assert found.reason


def test_integrators_without_a_step_are_refused():
    with pytest.raises(InvalidInput, match="tolerance"):
        pb.stability("heyoka")
    with pytest.raises(InvalidInput, match="requires"):
        pb.stability("wisdom-holman")


def test_command_prints_the_contract():
    found = json.loads(call("stability", "scheme-i", "--param", "lam=1/2", "--json").stdout)
    assert {"method", "params", "limit", "intervals", "how"} <= found.keys()
    assert (found["limit"], found["intervals"], found["params"]) == (None, [[0.0, None]], {"lam": "1/2"})
    done = call("stability", "stormer-verlet")
    assert done.exit_code == 0
    assert "trace of the step map" in done.stdout
    assert call("stability", "stormer-verlett", "--json").exit_code == 2


@pytest.mark.parametrize(
    ("method", "limit", "stable"),
    [("explicit-euler", "0", "no step"), ("stormer-verlet", "2", "0 to 2")]
    + [("implicit-midpoint", "none up to 100", "0 to beyond")],
)
def test_zero_limit_and_missing_limit_are_printed(method, limit, stable):
    lines = [" ".join(line.split()) for line in call("stability", method).stdout.splitlines()]
    assert f"limit of h omega {limit}" in lines
    assert f"stable for {stable}" in lines


def test_known_limits_agree_to_their_printed_digits():
    assert limits.agrees(2.553145, 2.55, 3)
    assert not limits.agrees(2.5563, 2.55, 3)
    assert not limits.agrees(math.inf, 2.0, 3)
    assert not limits.agrees(2.0, math.inf, 3)


def test_undefined_step_does_not_end_the_scan():
    method = integrator("gautschi")
    assert oscillator.matrix(method, float(np.pi)) is None
    assert oscillator.matrix(method, 3.0) is not None
    assert oscillator.find(method).scanned > 4


# -- with fake runs and scans -----------------------------------------------------------------------------------------


def replace_runs(monkeypatch, stays) -> list[tuple[float, int]]:
    """Replace long runs on the oscillator by made-up ones, stable where ``stays(z)`` with z = h omega.

    Returns the list of the (z, steps) of the runs made, which grows.
    """
    made: list[tuple[float, int]] = []

    def lost(chosen, z: float, steps: int) -> str:
        made.append((z, steps))
        return "" if stays(z) or steps < oscillator.LONG else "grown"

    monkeypatch.setattr(oscillator, "failure_of_run", lost)
    return made


def test_runs_find_every_interval(monkeypatch):
    made = replace_runs(monkeypatch, lambda z: z < 1.234 or 2.4 < z < 4.1 or z > 5.6)
    found = oscillator.of_runs(None)
    ends = [x for pair in found.intervals for x in pair[:2] if x]
    assert np.allclose(ends, [1.234, 2.4, 4.1, 5.6], rtol=oscillator.SHARPNESS)
    assert (found.intervals[0][0], found.intervals[-1][1], found.limit) == (0.0, None, found.intervals[0][1])
    assert (found.scanned, found.reason, found.how) == (linear_stability.LAST, "grown", oscillator.RUNS)
    inside = [z for pair in found.intervals for z in pair if z]
    assert all(z < 1.234 or 2.4 < z < 4.1 or z > 5.6 for z in inside), "an end is a step that was seen to be stable"
    assert min(z for z, _ in made) == oscillator.COARSE
    assert len(made) < 2 * (40 + 4 * 12)


def test_runs_that_all_fail_end_the_scan(monkeypatch):
    replace_runs(monkeypatch, lambda z: z > 5)
    found = oscillator.of_runs(None)
    assert (found.intervals, found.limit) == ((), 0.0)
    assert found.scanned == oscillator.COARSE * oscillator.HOPELESS


def test_long_runs_of_a_method_for_constraints_are_constrained():
    chosen = integrator("rattle")
    assert [oscillator.failure_of_run(chosen, z, 1000) for z in (1.0, 2.1)] == ["", "diverged"]


def test_run_is_lost_by_its_status_or_by_growth():
    def ends(status: str, q: float, p: float):
        rows = SimpleNamespace(status=status, q=np.array([[1.0], [q]]), p=np.array([[0.0], [p]]))
        return oscillator.failure_of_run(SimpleNamespace(record=None, run=lambda problem, **asked: rows), 0.1, 100)

    grown = 1.01 * oscillator.GROWN
    assert [ends("ok", *end) for end in ((1.0, 0.5), (0.99 * oscillator.GROWN, 0.0))] == ["", ""]
    assert [ends("ok", *end) for end in ((grown, 0.0), (0.0, -grown))] == ["grown", "grown"]
    assert [ends("unstable", *end) for end in ((1.0, 0.5), (grown, 0.0))] == ["unstable", "unstable"]


def test_solver_noise_is_no_gap_and_a_gap_beside_it_is_found():
    """Noise of 1e-8 in the entries, above the allowance for a solver, moves the determinant of a rotation off 1."""

    def noisy(z):
        draws = np.random.default_rng(int(z * 1e9)).uniform(-1e-8, 1e-8, (2, 2))
        growth = 1.001 if 5 < z < 6 else 1.0
        return growth * np.array([[np.cos(0.3), np.sin(0.3)], [-np.sin(0.3), np.cos(0.3)]]) + draws

    assert len(oscillator.of_matrix(noisy).intervals) > 10
    (first, second) = oscillator.of_matrix(noisy, lambda z: 1e-8).intervals
    assert first == (0.0, pytest.approx(5.0, abs=1e-6))
    assert second == (pytest.approx(6.0, abs=1e-6), None)


def test_noise_of_a_step_is_measured():
    """The substeps of the composed method amplify its solver's error where h omega is large."""
    assert oscillator.noise(integrator("jayawardana-ohsawa-4"), 50.0) > 1e-8
    assert oscillator.noise(integrator("jayawardana-ohsawa-4"), 1.0) < 1e-14


def test_scan_that_ends_stable_is_extended(monkeypatch):
    def scans(*second):
        found = iter(
            [linear_stability.Stability(((0.0, 2.0), (3.0, 10.0)), 10.0), linear_stability.Stability(second, 90.0)]
        )
        monkeypatch.setattr(linear_stability, "stability", lambda *scan, **more: next(found))
        return oscillator._pieces(None, lambda z: 0.0)

    assert scans((0.0, 2.0), (3.0, 12.0), (20.0, 90.0)) == ([(0.0, 2.0), (3.0, 12.0), (20.0, 90.0)], 90.0)
    assert scans((0.0, 2.0), (3.0, 10.0), (20.0, 90.0)) == ([(0.0, 2.0), (3.0, 10.0), (20.0, 90.0)], 90.0)
    assert scans((0.0, 2.0), (3.0, 10.0)) == ([(0.0, 2.0), (3.0, 10.0)], 90.0)
