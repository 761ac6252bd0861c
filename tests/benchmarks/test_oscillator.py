"""Stability intervals on the oscillator: known limits, gaps, long runs; measures of the studies of extremes."""

from __future__ import annotations

import dataclasses
import json
import math
from types import SimpleNamespace

import mpmath
import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.measure import linear_stability, oscillator
from phasebench.benchmarks.measure.exact_maps import DIGITS, exact_matrix
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.studies.extremes import limits, multistep, round_off
from phasebench.benchmarks.studies.kepler import orbit as kepler
from phasebench.benchmarks.studies.kepler import runs
from phasebench.integrators.coefficients.multistep import QUINLAN_TREMAINE
from phasebench.integrators.errors import InvalidInput
from phasebench.reference.solvers.exact import exact as exact_solution
from support.commands import call

TEN_DIGITS = 1e-10


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

    assert max(*errors(2), *errors(3)) < TEN_DIGITS
    monkeypatch.setattr(linear_stability, "multiple_root", lambda f, z, reach: z)
    assert min(max(errors(2)), max(errors(3))) > 10 * TEN_DIGITS


@pytest.mark.parametrize(("width", "part"), [(0.3, 1 / 3), (1e-3, 0.1), (1e-3, 0.9)])
def test_narrow_gap_after_the_first_interval(width, part):
    """Between two points of the scan the trace falls below -2 and returns."""
    at, low = 3.0 + linear_stability.SPACING * part, -2 - width**2 / 4
    found = oscillator.of_matrix(of_trace(lambda z: min(low + (z - at) ** 2, 1.99)))
    (_, first), (second, last) = found.intervals
    assert (first, second, last) == (
        pytest.approx(at - width / 2, rel=TEN_DIGITS),
        pytest.approx(at + width / 2, rel=TEN_DIGITS),
        None,
    )
    assert found.touches == ()


def test_lobatto_has_a_gap():
    found = oscillator.find(integrator("lobatto-iiia-iiib-3"))
    assert np.allclose(found.intervals, [(0, math.sqrt(8)), (math.sqrt(12), math.sqrt(24))], rtol=TEN_DIGITS, atol=0)


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
    assert np.allclose(found.intervals, [(5.008, 5.012)], atol=1e-6)
    assert found.limit == oscillator.Found(found.intervals, (), 6.0, oscillator.TRACE).limit == 0


def test_failed_step_ends_the_scan():
    verlet_s = of_trace(lambda z: 2 - z**2)
    found = linear_stability.stability(lambda z: verlet_s(z) if z < 1 else None)
    assert found.limit is None
    assert found.scanned == pytest.approx(1 - linear_stability.SPACING)
    nowhere = linear_stability.stability(lambda z: None)
    assert (nowhere.intervals, nowhere.scanned) == ((), 0.0)


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


# -- errors on the Kepler problem --------------------------------------------------------------------------------------


#: Odd multiples of an eighth of an orbit, within 40 orbits: no special phase.
EIGHTHS = [1, 3, 5, 7, 9, 101, 207, 313]


@pytest.mark.parametrize("e", [0.0, 0.9])
def test_elements_of_exact_kepler_motion(e):
    p = problem("kepler", e=e)
    truth = kepler.truth(p)
    h = truth.period / 8
    q, v = (np.array(x, dtype=float) for x in exact_solution(p, [h * n for n in EIGHTHS]))
    when = kepler.times(h, EIGHTHS, exactly=False)
    found = kepler.errors(truth, when, q, v)
    assert np.abs(found.phase).max() < 2e-13
    assert np.abs(found.energy).max() < 1e-13
    assert np.abs(found.momentum).max() < 1e-15
    if e:
        assert np.abs([found.perihelion, found.anomaly]).max() < 2e-13
        assert np.abs(kepler.elements(q, v).eccentricity - e).max() < 1e-14
    else:
        assert np.isnan(found.perihelion).all()
    # Another eccentricity changes only the angular momentum, another speed the energy and the phase.
    assert np.abs(kepler.errors(kepler.truth(problem("kepler", e=e + 0.05)), when, q, v).momentum).max() > 1e-3
    faster = SimpleNamespace(q0=p.q0, p0=(0.0, p.p0[1] * 1.0001), parameters={})
    other = kepler.errors(kepler.truth(faster), when, q, v)
    assert np.abs(other.energy).max() > 1e-4
    assert np.abs(other.phase).max() > 1e-2


@pytest.mark.parametrize(
    ("method", "e", "n", "status", "reason"),
    [
        ("explicit-euler", 0.6, 60, "diverged", "no bound orbit"),
        ("scheme-iii", 0.6, 200, "ok", ""),
    ],
)
def test_failed_run_has_a_status_and_reason(method, e, n, status, reason):
    made, values = problem("kepler", e=e), {"lam": "0"} if method == "scheme-iii" else {}
    chosen, setting = integrator(method, parameters=values), runs.Setting(f"{n} steps", n)
    run, rows = runs.on_the_way(chosen, made, kepler.truth(made), setting, 30)
    assert (run["status"], bool(run["reason"])) == (status, status != "ok")
    assert reason in run["reason"]
    assert all(r["orbits"] <= run["reached"] for r in rows)
    assert status != "ok" or [r["orbits"] for r in rows] == [1.5, 3.5, 10.5, 30.5]


# -- perturbed initial states -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("others", "found"),
    [
        ([2e-9, 3e-9, 4e-9, 5e-9, 6e-9, 7e-9, 8e-9, 9e-9], ((5e-9, 2e-9, 8e-9), 9)),
        ([9e-9] + [1.1e-9] * 7, ((1.1e-9, 1.1e-9, 1.1e-9), 9)),
        ([1.04e-9, 1.02e-9, 9e-9, 9e-9], ((1.02e-9, 1e-9, 1.04e-9), 3)),
        ([1.06e-9, 1e-9, 2e-9], ((1.03e-9, 1e-9, 2e-9), 4)),
        ([], ((1e-9, 1e-9 / 30, 3e-8), 1)),
    ],
    ids=["spread", "an outlier", "truncation", "hardly truncation", "too dear"],
)
def test_median_phase_error_from_draws(others, found):
    ((value, low, high), count), taken = runs.median_phase(1e-9, iter(others)), found
    assert (value, low, high) == pytest.approx(taken[0])
    assert count == taken[1]


def test_a_matrix_known_to_an_error_may_be_off_by_it():
    off = np.array([[1.0, 0.0], [0.0, 1.0 + 1e-4]])  # det > 1, so that the third margin is negative
    assert linear_stability.margins(off).min() < 0
    assert linear_stability.margins(off, noise=1e-6).min() < 0 < linear_stability.margins(off, noise=1e-4).min()
