"""The page on extremes: verdicts on fabricated tables, passing and failing; measurements where the answer is known."""

from __future__ import annotations

import dataclasses
import math

import mpmath
import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.experiments.extremes import (
    bench_extremes,
    brouwer,
    brouwer_kepler,
    cases,
    edge,
    encounters,
    exact_maps,
    figures,
    linear,
    page,
    push,
    regions,
    resonances,
    verdicts,
)
from phasebench.benchmarks.experiments.extremes import brouwer_controls as controls
from phasebench.benchmarks.measure import oscillator
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.page.verdict import FAIL, FINDING, MISSING, PASS, Count
from phasebench.integrators.driver import OK
from phasebench.integrators.prepared import prepare
from phasebench.integrators.registry import BY_ID
from support.pages import data


@pytest.mark.parametrize(("agrees", "outcome"), [(True, PASS), (False, FAIL)])
def test_every_known_limit_must_be_met(agrees, outcome):
    known = pd.DataFrame([{"method": "a", "agrees": True}, {"method": "b", "agrees": agrees}])
    found = verdicts.known_limits(data(extremes_published=known))
    assert (found.measured, found.outcome) == (Count(1 + agrees, 2), outcome)
    assert found.where == ("" if agrees else "b")


@pytest.mark.parametrize(("off", "outcome"), [(0.0, PASS), (1e-8, FAIL), (-1e-8, FAIL)])
def test_scheme_i_must_meet_its_closed_form(off, outcome):
    rows = [("0", 2.0, 2.0), ("1", 2.0 + off, 2.0), ("1/2", math.inf, math.inf)]
    sweep = pd.DataFrame(rows, columns=["lam", "limit", "closed form"])
    found = verdicts.closed_form(data(extremes_scheme_i=sweep))
    assert found.outcome == outcome
    assert found.measured == pytest.approx(abs(off) / 2)
    assert found.where == ("λ = 1" if off else "λ = 0")
    assert verdicts.closed_form(data(extremes_scheme_i=sweep.tail(1))) is None


def test_long_runs_are_counted_over_all_methods():
    rows = [("c", 4, 4), ("d", 4, 3), ("e", 0, 0), ("f", math.nan, math.nan)]
    linear = pd.DataFrame(rows, columns=["label", "runs", "confirmed"])
    bad, good = (verdicts.long_runs(data(extremes_linear=t)) for t in (linear, linear.head(1)))
    assert (bad.measured, bad.outcome, bad.where) == (Count(7, 8), FAIL, "d")
    assert (good.measured, good.outcome, good.where) == (Count(4, 4), PASS, "")
    assert verdicts.long_runs(data(extremes_linear=linear.tail(2))).outcome == MISSING


def encounter_table(**held):
    """A fabricated table of close encounters: method -> whether its error is small at e = 0.9, 0.99 and 0.999."""
    rows = [
        {"method": m, "kind": m.partition("_")[0], "e": e, "held": h, "error": 1e-9 if h else 1.0}
        for m, flags in held.items()
        for e, h in zip((0.9, 0.99, 0.999), flags, strict=True)
    ]
    return pd.DataFrame(rows)


def test_reach_ends_at_the_first_loss():
    reach = verdicts.reach(encounter_table(fixed_a=(1, 0, 1), fixed_b=(0, 1, 1), adaptive_c=(1, 1, 1)))
    assert reach.to_dict() == {"fixed_a": 0.9, "fixed_b": 0.0, "adaptive_c": 0.999}


def test_reach_keeps_the_order_of_the_table():
    assert list(verdicts.reach(encounter_table(b=(1, 1, 1), a=(1, 1, 1), c=(1, 1, 1))).index) == ["b", "a", "c"]


@pytest.mark.parametrize(
    ("flags", "n", "outcome"), [((1, 1, 1), 1, PASS), ((1, 1, 0), 0, FINDING), ((1, 0, 1), 0, FINDING)]
)
def test_one_integrator_must_hold_every_eccentricity(flags, n, outcome):
    found = verdicts.close(
        data(extremes_encounters=encounter_table(fixed_a=(1, 0, 0), fixed_b=(0, 0, 0), adaptive_c=flags))
    )
    assert (found.measured, found.outcome) == (n, outcome)
    assert found.where.startswith("fixed steps: to e = 0.9,")


def test_kind_of_integrators_that_solve_kepler_exactly():
    assert [verdicts.kind(m, "fixed") for m in ("stormer-verlet", "wisdom-holman", "rebound-whfast")] == [
        "fixed",
        "Kepler-solving",
        "Kepler-solving",
    ]


def test_state_error_by_kind_of_summation():
    """Errors of three kinds of summation after 4e6 steps of 0.01 on the oscillator: plain sums lose most digits."""
    steps = 4_000_000
    with mpmath.workdps(brouwer.DIGITS):
        exact = exact_maps.exact_matrix("stormer-verlet", {}, 0.01) ** steps * mpmath.matrix([0.7, 0.4])
        far = {kind: [x[-1] for x in controls.runner(kind, 0.01, 10)(0.7, 0.4, steps)] for kind in controls.KINDS}
        error = {kind: float(mpmath.norm(mpmath.matrix(y) - exact)) for kind, y in far.items()}
    assert error[controls.WHOLE] < 2e-15
    assert error[controls.HALF] > 1e-14
    assert error[controls.PLAIN] > 1e-13


@pytest.mark.parametrize("exponent", [0.5, 1.0])
def test_interval_of_the_growth_exponent_covers(exponent):
    """In 16 of 20 draws the interval contains the exponent: 1/2 of random walks, 1 of lines with random slopes."""
    generator, n = np.random.default_rng(0), 10 * 2 ** np.arange(10)
    covered = 0
    for _ in range(20):
        if exponent == 1.0:
            e = generator.standard_normal((100, 1)) * n
        else:
            e = np.cumsum(generator.standard_normal((100, n[-1])), axis=1)[:, n - 1]
        value, low, high = brouwer.growth(n, e)
        assert low - 1e-12 <= value <= high + 1e-12, "lines are fitted to round-off"
        covered += low - 1e-9 <= exponent <= high + 1e-9
    assert covered >= 16


EXACT = ("stormer-verlet", "pefrl", "blanes-moan-srkn6b", "gauss-2", "lobatto-iiia-iiib-3", "avf", "deuflhard")


@pytest.mark.parametrize(("id", "values"), [*((id, {}) for id in EXACT), ("scheme-i", {"lam": "1/3"})])
def test_exact_matrix_is_the_methods_matrix(id, values):
    with mpmath.workdps(brouwer.DIGITS):
        M = np.array(exact_maps.exact_matrix(id, values, 0.3).tolist(), float)
    assert np.allclose(M, oscillator.matrix(integrator(id, parameters=values), 0.3), rtol=0, atol=4e-16)


def test_limit_at_a_triple_root_is_confirmed_where_growth_shows():
    """Of chin-4a tr M + 2 = (12 - z^2)^3 / 432; Stormer-Verlet's trace leaves -2 with a slope, at once."""
    chosen = integrator("chin-4a")
    M = oscillator.matrix(chosen, 3.0)
    assert np.trace(M) + 2 == pytest.approx(3**3 / 432, rel=1e-12)
    found = oscillator.find(chosen)
    assert found.limit == pytest.approx(math.sqrt(12), rel=2e-6)
    assert not linear.grows(chosen, found.limit * (1 + linear.BESIDE))
    assert linear._beyond(chosen, found) == [found.limit * (1 + 100 * linear.BESIDE)]
    assert linear.confirm(chosen, found) == (2, 2)
    verlet = integrator("stormer-verlet")
    found = oscillator.find(verlet)
    assert linear._beyond(verlet, found) == [found.limit * (1 + linear.BESIDE)]
    following = dataclasses.replace(found, intervals=(*found.intervals, (found.limit * (1 + linear.BESIDE), None)))
    assert linear._beyond(verlet, following) == []


def test_energy_and_phase_error_of_known_orbits():
    with mpmath.workdps(brouwer.DIGITS):
        M = exact_maps.exact_matrix("stormer-verlet", {}, 0.01)
        y, far = mpmath.matrix([1, 0]), M**100_000 * mpmath.matrix([1, 0])
        energy, phase = brouwer.errors(M, [0, 100_000], [y[0], far[0]], [y[1], far[1]])
        assert abs(energy[1]) < 1e-15
        assert abs(phase[1]) < 1e-15
        energy, phase = brouwer.errors(M, [0, 100_000], [y[0], far[0] * (1 + 1e-9)], [y[1], far[1] * (1 + 1e-9)])
        assert energy[1] == pytest.approx(2e-9, rel=1e-6)
        assert abs(phase[1]) < 1e-15


def test_elements_and_phase_error_of_a_kepler_orbit():
    """a = 1, e = 0.6, E = 1: M = 1 - 0.6 sin 1; a mean anomaly late by 1e-9 is a phase error of 1e-9."""

    def at(E):
        x, y, r = math.cos(E) - 0.6, 0.8 * math.sin(E), 1 - 0.6 * math.cos(E)
        return (x, y), (-math.sin(E) / r, 0.8 * math.cos(E) / r)

    with mpmath.workdps(brouwer.DIGITS):
        a, M = map(float, brouwer_kepler.elements(*at(1.0)))
        assert (a, M) == (pytest.approx(1, rel=1e-14), pytest.approx(1 - 0.6 * math.sin(1), rel=1e-14))
        Q, P = zip(at(0.0), at(1.0), strict=True)
        energy, phase = brouwer_kepler.errors([0, 1], Q, P, M - 1e-9)
    assert abs(energy[1]) < 1e-14
    assert phase[1] == pytest.approx(1e-9, rel=1e-5)


@pytest.mark.parametrize("edge_at", [0.013, 0.1, 3.0])
def test_largest_step_is_bisected(edge_at):
    h, fails = push.largest(lambda h: OK if h <= edge_at else "lost", 0.1)
    assert h <= edge_at < h * 2 ** (1.01 / push.PARTS)
    assert fails == "lost"


def test_all_steps_survive_or_none():
    assert push.largest(lambda h: "lost", 0.1) == (0.0, "lost")
    assert push.largest(lambda h: OK, 0.1) == (math.inf, "")


def test_status_of_runs_on_known_orbits():
    pendulum, near = cases.BY_ID["pendulum"], cases.BY_ID["pendulum, 1e-12 below the separatrix"]
    assert cases.judge_run(pendulum, "stormer-verlet", 0.1, 1000) == OK
    assert cases.judge_run(pendulum, "stormer-verlet", 2.2, 1000) == cases.LOST
    assert cases.judge_run(near, "stormer-verlet", 0.3, 1000) == cases.WRONG
    assert cases.size(pendulum) == pytest.approx(-math.cos(2), rel=1e-3)


def test_orbit_with_good_energy_and_wrong_clock_fails():
    """At an h near the period the energy error is small, but the phase is wrong."""
    case = cases.BY_ID["Henon-Heiles, box"]
    by_energy = dataclasses.replace(case, ranged=False, timed=False)
    assert cases.judge_run(case, "blanes-moan-s6", 0.5, 300) == OK
    assert cases.judge_run(by_energy, "blanes-moan-s6", 5.4, 300) == OK
    assert cases.judge_run(case, "blanes-moan-s6", 5.4, 300) == cases.CLOCK


def test_orbit_out_of_range_or_out_of_phase():
    case = cases.BY_ID["pendulum"]
    known, t = cases.course(case), np.linspace(0, 200, 2001)
    swing = (known.high + known.low) / 2 + (known.high - known.low) / 2 * np.sin(np.pi * known.rate * t)[:, None]
    assert cases.strays(case, swing, 200.0, True) == OK
    assert cases.strays(case, swing * 2.5, 200.0, True) == cases.WRONG
    assert cases.strays(case, swing, 500.0, True) == cases.CLOCK
    assert cases.strays(case, swing, 500.0, False) == OK
    assert cases.crossings(np.array([1.0, -1.0, -1.0, 1.0]), 0.0) == 2


def test_escape_is_no_failure():
    start = (0.0, 0.5), (0.3, 0.8)  # H is about 0.45
    gone = cases.Case("gone", "henon-heiles", *start, escapes=3.0)
    assert cases.judge_run(gone, "stormer-verlet", 0.02, 20_000) == OK
    kept = cases.Case("kept", "henon-heiles", *start)
    assert cases.judge_run(kept, "stormer-verlet", 0.02, 20_000) != OK


def test_apocentre_is_computed_from_the_rounded_state():
    half, far = encounters.apocentre(0.4, 2.0)  # a = 1, e = 0.6
    assert (half, far) == (pytest.approx(math.pi, rel=1e-15), pytest.approx(1.6, rel=1e-15))
    rows = {r["e"]: r for r in encounters.measure_rows("wisdom-holman")[encounters.TABLES[0]]}
    assert all(rows[e]["held"] for e in encounters.ECCENTRICITIES[:3])
    assert not encounters.measure_rows("symplectic-euler-p")[encounters.TABLES[0]][-1]["held"]


def test_stability_functions():
    """R of the classical method is the truncated exponential series; that of Gauss is a Pade approximation."""
    rows = {r["method"]: r for r in regions.measure_rows()[regions.TABLES[0]]}
    assert np.allclose([float(c) for c in rows["rk4"]["above"].split()], [1 / 24, 1 / 6, 1 / 2, 1, 1])
    assert np.allclose([float(c) for c in rows["gauss-2"]["below"].split()], [1 / 12, -1 / 2, 1])


def test_resonances_are_where_theory_predicts():
    """Stormer-Verlet is stable to 2; the impulse method resonates at h (1 + ratio) = 2 pi, a filtered one does not."""
    coupled = resonances.CoupledOscillators(resonances.RATIOS[0] * 2)
    run = {id: prepare(coupled, BY_ID[id]) for id in ("stormer-verlet", "deuflhard", "hairer-lubich")}
    assert resonances.radius(run["stormer-verlet"], 0.9) < 1 + 1e-9
    assert resonances.radius(run["stormer-verlet"], 1.1) > 1.1
    at = 2 * math.pi / 3
    assert resonances.radius(run["deuflhard"], at) > 1.01 > resonances.radius(run["hairer-lubich"], at)


def test_outcomes_of_solvers():
    rows = edge.measure_rows("scheme-ii", "pendulum", "lam")[edge.TABLES[0]]
    found = {(r["value"], r["h"]): r["outcome"] for r in rows}
    assert found[1.0, edge.H_PENDULUM[0]] == edge.FIXED_POINT
    assert found[11.0, edge.H_PENDULUM[-1]] != edge.FIXED_POINT
    assert len(found) == len(edge.LAMBDAS) * len(edge.H_PENDULUM)


def test_gates_report_wrong_rows():
    assert bench_extremes.unlike([{"agrees": True}]) == []
    wrong = {"agrees": False, "method": "a", "parameters": "", "measured": 1.0, "known limit": 2.0}
    assert bench_extremes.unlike([wrong]) == ["a : 1.0, known 2.0"]
    assert bench_extremes.unconfirmed_limits([{"label": "a", "runs": 2, "confirmed": 1}, {"label": "b"}]) == [
        "a: 1 of 2"
    ]


def test_text_of_intervals_is_parsed():
    assert figures.pieces("0..2.5 3..") == [(0.0, 2.5), (3.0, math.inf)]
    assert figures.pieces(math.nan) == []


def test_summary_of_the_measured_columns():
    steps = pd.DataFrame([{"method": "rk4", "orbit": "pendulum", "largest h": 0.25, "fails": "energy-lost"}])
    linear = pd.DataFrame([{"method": "rk4", "limit": math.inf}])
    grown = pd.DataFrame([{"label": "scheme-i(lam=-1)", "h": brouwer.PLAIN, "energy exponent": 0.9}])
    grown = pd.concat([grown, grown.assign(label="scheme-i(lam=1/3)", **{"energy exponent": 0.7})])
    found = page.summary(linear, steps, encounter_table(rk4=(1, 0, 0)), grown).set_index("method")
    row = found.loc["rk4"]
    assert found.loc["scheme-i"]["round-off"] == "0.70"
    assert (row["limit of h ω"], row["pendulum"], row["largest e"]) == ("none", "0.25", "0.9")
    assert row["how it fails"] == "energy-lost"
    assert page.table(data()) is None
    only = page.table(data(extremes_steps=steps)).frame.set_index("method").loc["rk4"]
    assert (only["pendulum"], only["largest e"], only["how it fails"]) == ("0.25", "", "energy-lost")


def test_missing_failures_are_left_out_of_the_summary():
    """The most frequent failure first; a run stable at any h has none, as NaN or as an empty text."""
    fails = ["", math.nan, "lost", "energy-lost", "energy-lost"]
    steps = pd.DataFrame(
        [{"method": "rk4", "orbit": f"{k}", "largest h": 1.0, "fails": f} for k, f in enumerate(fails)]
    )
    steps = pd.concat([steps, steps.tail(2), steps.iloc[:1].assign(fails="collision")])
    assert page.summary(None, steps, None, None).set_index("method").loc["rk4", "how it fails"] == "energy-lost, lost"


def test_page_shows_representative_methods_first():
    linear = pd.DataFrame([{"method": "rk4", "label": "rk4", "limit": 2.8}])
    assert page.full_table(data()) is None
    assert list(page.full_table(data(extremes_linear=linear)).columns) == ["label", "limit"]
    shown = page.table(data(extremes_linear=linear)).frame
    assert list(shown["method"])[:3] == list(page.REPRESENTATIVE)[:3]
    assert shown.set_index("method").loc["rk4", "limit of h ω"] == "2.8"
    assert any(f"at most {max(encounters.LADDER)} steps" in said for said in page.PAGE.setting)
