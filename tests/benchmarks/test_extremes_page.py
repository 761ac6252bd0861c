"""The page of extremes: its sentences on tables for which they must change, its measures where the answer is known."""

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
    meetings,
    page,
    push,
    regions,
    resonances,
    stiff,
    verdicts,
)
from phasebench.benchmarks.experiments.extremes import brouwer_controls as controls
from phasebench.benchmarks.measure import oscillator
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.integrators.driver import OK
from phasebench.integrators.prepared import prepare
from phasebench.integrators.registry import BY_ID


def data(**tables):
    """name -> table, as a page is given them."""
    return lambda name: tables.get(name)


def limits(agrees=True, off=0.0, confirmed=4):
    known = pd.DataFrame([{"method": "a", "agrees": True}, {"method": "b", "agrees": agrees}])
    known["evidence"] = ["derived", "derived and printed"]
    sweep = pd.DataFrame([{"limit": 2.0 + off, "closed form": 2.0}, {"limit": math.inf, "closed form": math.inf}])
    linear = pd.DataFrame(
        [{"label": "c", "runs": 4, "confirmed": confirmed}, {"label": "d", "runs": 0, "confirmed": 0}]
    )
    return verdicts.limits(data(extremes_published=known, extremes_scheme_i=sweep, extremes_linear=linear))


def test_limits_hold_only_where_everything_does():
    good = limits()
    assert good.holds
    assert "2 of 2 known" in good.text
    assert "2 derived and 1 printed" in good.text
    assert not limits(agrees=False).holds
    assert "not b" in limits(agrees=False).text
    assert not limits(off=1e-8).holds
    assert not limits(confirmed=3).holds
    assert "not of c" in limits(confirmed=3).text


def test_long_runs_are_counted_over_all_methods_and_the_astray_are_named():
    known = pd.DataFrame([{"method": "a", "agrees": True, "evidence": "derived"}])
    sweep = pd.DataFrame([{"limit": 2.0, "closed form": 2.0}])
    linear = pd.DataFrame([{"label": id, "runs": 4, "confirmed": n} for id, n in (("c", 4), ("d", 3))])
    found = verdicts.limits(data(extremes_published=known, extremes_scheme_i=sweep, extremes_linear=linear))
    assert not found.holds
    assert "7 of 8 long runs stay or grow as the step maps of 2 methods say (not of d)." in found.text


def encountered(**held):
    rows = [
        {"method": m, "kind": m.partition("_")[0], "e": e, "held": h, "error": 1e-9 if h else 1.0}
        for m, flags in held.items()
        for e, h in zip((0.9, 0.99, 0.999), flags, strict=True)
    ]
    return pd.DataFrame(rows)


def test_the_reach_ends_at_the_first_loss():
    reach = verdicts.reach(encountered(fixed_a=(1, 0, 1), fixed_b=(0, 1, 1), adaptive_c=(1, 1, 1)))
    assert reach.to_dict() == {"fixed_a": 0.9, "fixed_b": 0.0, "adaptive_c": 0.999}


def test_the_reach_is_in_the_order_of_the_table():
    assert list(verdicts.reach(encountered(b=(1, 1, 1), a=(1, 1, 1), c=(1, 1, 1))).index) == ["b", "a", "c"]


def test_a_kind_that_holds_nowhere_names_no_integrator():
    rows = encountered(fixed_a=(0, 0, 0), adaptive_c=(1, 1, 1), adaptive_d=(1, 0, 0))
    found = verdicts.close(data(extremes_encounters=rows))
    assert "fixed steps reach e = 0 (none); adaptive steps reach e = 0.999 (adaptive_c)" in found.text
    assert found.text.endswith("1 of 3 integrators hold 1.00e-06 at e = 0.999.")


def test_close_encounters_are_told_by_kind():
    good = verdicts.close(data(extremes_encounters=encountered(fixed_a=(1, 0, 0), adaptive_c=(1, 1, 1))))
    assert good.holds
    assert "fixed steps reach e = 0.9 (fixed_a)" in good.text
    bad = verdicts.close(data(extremes_encounters=encountered(fixed_a=(1, 0, 0), adaptive_c=(1, 1, 0))))
    assert not bad.holds
    assert "0 of 2" in bad.text
    assert [verdicts.kind(m, "fixed") for m in ("stormer-verlet", "wisdom-holman", "rebound-whfast")] == [
        "fixed",
        "Kepler-solving",
        "Kepler-solving",
    ]


def meeting(fixed=1.0, adaptive=1e-9):
    base = {"scene": "three bodies", "status": OK, "evaluations": 0}
    rows = [
        base | {"method": "a", "kind": "fixed", "error": fixed, "steps": 4096},
        base | {"method": "a", "kind": "fixed", "error": 2.0, "steps": 1024},
        base | {"method": "b", "kind": "adaptive", "error": adaptive, "steps": 700},
    ]
    return pd.DataFrame(rows)


def test_meetings_are_told_by_kind():
    good = verdicts.met(data(extremes_meetings=meeting()))
    assert good.holds
    assert "fixed steps do not (least 1)" in good.text
    assert "adaptive steps do in 700 (b)" in good.text
    assert good.short == "Not held: fixed steps in three bodies."
    assert "(all lost)" in verdicts.met(data(extremes_meetings=meeting().assign(error=math.inf))).text
    assert "fixed steps do in 4096 (a)" in verdicts.met(data(extremes_meetings=meeting(fixed=1e-7))).text
    assert not verdicts.met(data(extremes_meetings=meeting(adaptive=1e-3))).holds
    two = pd.concat([meeting(), meeting().assign(scene="a whirl")])
    text = verdicts.met(data(extremes_meetings=two)).text
    assert text.index("three bodies") < text.index("a whirl"), "in the order in which they were measured"


def test_a_meeting_is_judged_at_its_certified_state():
    assert meetings.apart([1.5, 101.0], [1.0, 100.0]) == 0.5
    rows = meetings.measured("zoom-whirl", "rk4")[meetings.TABLES[0]]
    assert rows[-1]["error"] < rows[0]["error"]
    assert rows[-1]["steps"] == rows[-1]["asked"]
    held = meetings.cheapest(pd.DataFrame(rows))
    assert len(held) == 1
    assert bool(held["held"].iloc[0]) == (rows[-1]["error"] <= encounters.HELD)


def test_of_the_whole_state_exact_products_lose_least_and_plain_sums_most():
    """The distance from the exact matrix's orbit after four million steps of 0.01: the rounded state drifts."""
    steps = 4_000_000
    with mpmath.workdps(brouwer.DIGITS):
        exact = exact_maps.exact_matrix("stormer-verlet", {}, 0.01) ** steps * mpmath.matrix([0.7, 0.4])
        far = {kind: [x[-1] for x in controls.runner(kind, 0.01, 10)(0.7, 0.4, steps)] for kind in controls.KINDS}
        error = {kind: float(mpmath.norm(mpmath.matrix(y) - exact)) for kind, y in far.items()}
    assert error[controls.WHOLE] < 2e-15
    assert error[controls.HALF] > 1e-14
    assert error[controls.PLAIN] > 1e-13


@pytest.mark.parametrize("exponent", [0.5, 1.0])
def test_growth_is_fitted_with_an_interval_that_covers(exponent):
    """Random walks, and lines of random slopes."""
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
def test_the_exact_matrix_is_the_methods(id, values):
    with mpmath.workdps(brouwer.DIGITS):
        M = np.array(exact_maps.exact_matrix(id, values, 0.3).tolist(), float)
    assert np.allclose(M, oscillator.matrix(integrator(id, **values), 0.3), rtol=0, atol=4e-16)


def test_the_exact_orbit_has_no_error_and_another_has():
    with mpmath.workdps(brouwer.DIGITS):
        M = exact_maps.exact_matrix("stormer-verlet", {}, 0.01)
        y, far = mpmath.matrix([1, 0]), M**100_000 * mpmath.matrix([1, 0])
        energy, phase = brouwer.errors(M, [0, 100_000], [y[0], far[0]], [y[1], far[1]])
        assert abs(energy[1]) < 1e-15
        assert abs(phase[1]) < 1e-15
        energy, phase = brouwer.errors(M, [0, 100_000], [y[0], far[0] * (1 + 1e-9)], [y[1], far[1] * (1 + 1e-9)])
        assert energy[1] == pytest.approx(2e-9, rel=1e-6)
        assert abs(phase[1]) < 1e-15


def test_elements_of_an_exact_orbit_have_no_error_and_a_late_one_has():
    """a = 1, e = 0.6, at E = 1: M = 1 - 0.6 sin 1; a clock that is late by 1e-9 shows as that."""

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
def test_the_largest_step_is_bisected(edge_at):
    h, fails = push.largest(lambda h: OK if h <= edge_at else "lost", 0.1)
    assert h <= edge_at < h * 2 ** (1.01 / push.PARTS)
    assert fails == "lost"


def test_nothing_or_everything_survives():
    assert push.largest(lambda h: "lost", 0.1) == (0.0, "lost")
    assert push.largest(lambda h: OK, 0.1) == (math.inf, "")


def test_runs_are_judged():
    pendulum, near = cases.BY_ID["pendulum"], cases.BY_ID["pendulum, 1e-12 below the separatrix"]
    assert cases.judged(pendulum, "stormer-verlet", 0.1, 1000) == OK
    assert cases.judged(pendulum, "stormer-verlet", 2.2, 1000) == cases.LOST
    assert cases.judged(near, "stormer-verlet", 0.3, 1000) == cases.WRONG
    assert cases.size(pendulum) == pytest.approx(-math.cos(2), rel=1e-3)


def test_what_keeps_its_energy_at_a_step_of_a_period_is_no_orbit():
    """At a step of nearly a period the energy alone has nothing against the run; the clock has."""
    case = cases.BY_ID["Henon-Heiles, box"]
    by_energy = dataclasses.replace(case, ranged=False, timed=False)
    assert cases.judged(case, "blanes-moan-s6", 0.5, 300) == OK
    assert cases.judged(by_energy, "blanes-moan-s6", 5.4, 300) == OK
    assert cases.judged(case, "blanes-moan-s6", 5.4, 300) == cases.CLOCK


def test_a_course_is_left_by_range_and_by_clock():
    case = cases.BY_ID["pendulum"]
    known, t = cases.course(case), np.linspace(0, 200, 2001)
    swing = (known.high + known.low) / 2 + (known.high - known.low) / 2 * np.sin(np.pi * known.rate * t)[:, None]
    assert cases.strays(case, swing, 200.0, True) == OK
    assert cases.strays(case, swing * 2.5, 200.0, True) == cases.WRONG
    assert cases.strays(case, swing, 500.0, True) == cases.CLOCK
    assert cases.strays(case, swing, 500.0, False) == OK
    assert cases.crossings(np.array([1.0, -1.0, -1.0, 1.0]), 0.0) == 2


def test_an_orbit_that_escapes_is_no_failure():
    start = (0.0, 0.5), (0.3, 0.8)  # H is about 0.45
    gone = cases.Case("gone", "henon-heiles", *start, escapes=3.0)
    assert cases.judged(gone, "stormer-verlet", 0.02, 20_000) == OK
    kept = cases.Case("kept", "henon-heiles", *start)
    assert cases.judged(kept, "stormer-verlet", 0.02, 20_000) != OK


def test_the_apocentre_is_that_of_the_doubles():
    half, far = encounters.apocentre(0.4, 2.0)  # a = 1, e = 0.6
    assert (half, far) == (pytest.approx(math.pi, rel=1e-15), pytest.approx(1.6, rel=1e-15))
    rows = {r["e"]: r for r in encounters.measured("wisdom-holman")[encounters.TABLES[0]]}
    assert all(rows[e]["held"] for e in encounters.ECCENTRICITIES[:3])
    assert not encounters.measured("symplectic-euler-p")[encounters.TABLES[0]][-1]["held"]


def test_a_cliff_ends_at_the_first_loss():
    table = pd.DataFrame({"h omega": [1.0, 0.1, 10.0, 100.0], "I changes": [0.1, 0.01, 1.0, 0.0]})
    assert stiff.cliff(table) == 1.0
    assert stiff.cliff(table.assign(**{"I changes": 1.0})) == 0.0


def test_stability_functions():
    """R of the classical method is the series of exp; Gauss's is a Pade approximation."""
    rows = {r["method"]: r for r in regions.measured()[regions.TABLES[0]]}
    assert np.allclose([float(c) for c in rows["rk4"]["above"].split()], [1 / 24, 1 / 6, 1 / 2, 1, 1])
    assert np.allclose([float(c) for c in rows["gauss-2"]["below"].split()], [1 / 12, -1 / 2, 1])


def test_resonances_are_where_theory_has_them():
    """Modes of Stormer-Verlet end at 2; the impulse method resonates at h (1 + ratio) = 2 pi, a filtered one not."""
    coupled = resonances.Coupled(resonances.RATIOS[0] * 2)
    run = {id: prepare(coupled, BY_ID[id]) for id in ("stormer-verlet", "deuflhard", "hairer-lubich")}
    assert resonances.radius(run["stormer-verlet"], 0.9) < 1 + 1e-9
    assert resonances.radius(run["stormer-verlet"], 1.1) > 1.1
    at = 2 * math.pi / 3
    assert resonances.radius(run["deuflhard"], at) > 1.01 > resonances.radius(run["hairer-lubich"], at)


def test_outcomes_of_solvers():
    rows = edge.measured("scheme-ii", "pendulum", "lam")[edge.TABLES[0]]
    found = {(r["value"], r["h"]): r["outcome"] for r in rows}
    assert found[1.0, edge.H_PENDULUM[0]] == edge.FIXED_POINT
    assert found[11.0, edge.H_PENDULUM[-1]] != edge.FIXED_POINT
    assert len(found) == len(edge.LAMBDAS) * len(edge.H_PENDULUM)


def test_gates_see_what_is_wrong():
    assert bench_extremes.unlike([{"agrees": True}]) == []
    wrong = {"agrees": False, "method": "a", "parameters": "", "measured": 1.0, "known limit": 2.0}
    assert bench_extremes.unlike([wrong]) == ["a : 1.0, known 2.0"]
    assert bench_extremes.unconfirmed([{"label": "a", "runs": 2, "confirmed": 1}, {"label": "b"}]) == ["a: 1 of 2"]


def test_intervals_are_read_back():
    assert figures.pieces("0..2.5 3..") == [(0.0, 2.5), (3.0, math.inf)]
    assert figures.pieces(math.nan) == []


def test_the_summary_lacks_nothing_but_what_was_not_measured():
    steps = pd.DataFrame([{"method": "rk4", "orbit": "pendulum", "largest h": 0.25, "fails": "energy-lost"}])
    linear = pd.DataFrame([{"method": "rk4", "limit": math.inf}])
    grown = pd.DataFrame([{"label": "scheme-i(lam=-1)", "h": brouwer.PLAIN, "energy exponent": 0.9}])
    grown = pd.concat([grown, grown.assign(label="scheme-i(lam=1/3)", **{"energy exponent": 0.7})])
    found = page.summary(linear, steps, encountered(rk4=(1, 0, 0)), grown).set_index("method")
    row = found.loc["rk4"]
    assert found.loc["scheme-i"]["growth"] == "0.70"
    assert (row["limit of h ω"], row["pendulum"], row["worst e"]) == ("none", "0.25", "0.9")
    assert row["how it fails"] == "energy-lost"
    assert page.table(data()) is None
    only = page.table(data(extremes_steps=steps)).frame.set_index("method").loc["rk4"]
    assert (only["pendulum"], only["worst e"], only["how it fails"]) == ("0.25", "", "energy-lost")


def test_ways_to_fail_that_are_none_are_not_told():
    """The commonest first; a run to any h has none, as NaN or as an empty text."""
    fails = ["", math.nan, "lost", "energy-lost", "energy-lost"]
    steps = pd.DataFrame(
        [{"method": "rk4", "orbit": f"{k}", "largest h": 1.0, "fails": f} for k, f in enumerate(fails)]
    )
    steps = pd.concat([steps, steps.tail(2), steps.iloc[:1].assign(fails="collision")])
    assert page.summary(None, steps, None, None).set_index("method").loc["rk4", "how it fails"] == "energy-lost, lost"


def test_the_page_shows_the_first_methods_and_keeps_every_interval():
    linear = pd.DataFrame([{"method": "rk4", "label": "rk4", "limit": 2.8}])
    assert page.whole(data()) is None
    assert list(page.whole(data(extremes_linear=linear)).columns) == ["label", "limit"]
    shown = page.table(data(extremes_linear=linear)).frame
    assert list(shown["method"])[:3] == list(page.REPRESENTATIVE)[:3]
    assert shown.set_index("method").loc["rk4", "limit of h ω"] == "2.8"
    assert any(f"at most {max(encounters.LADDER)} steps" in said for said in page.PAGE.setting)
