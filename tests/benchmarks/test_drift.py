"""The drift of an oscillating error: known slopes, coverage, controls that must fail; its page, both ways."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.experiments.drift import bench_drift, coverage, page
from phasebench.benchmarks.measure import drift as module
from phasebench.benchmarks.measure import metrics
from phasebench.benchmarks.measure.drift import drift, signed_ranks, without_lines
from phasebench.integrators.record import DRIFT
from phasebench.integrators.registry import BY_ID

T = np.arange(4000) * 0.05


def swing(t, periods, phase=0.3):
    angle = 2 * np.pi * periods * t / t[-1] + phase
    return 1e-3 * (np.cos(angle) + 0.2 * np.cos(3 * angle))


@pytest.mark.parametrize("t", [T, T[:300]], ids=["long", "short"])
@pytest.mark.parametrize("periods", [2.3, 7.7, 31.4, 66.6])
def test_a_drift_is_found_in_an_oscillation_a_million_times_as_large(t, periods):
    slope = 1e-9 / t[-1]
    for sign in (-1, 0, 1):
        found = drift(t, swing(t, periods) + sign * slope * t)
        assert abs(found.value - sign * slope) < 1e-3 * slope
        assert found.low <= found.value <= found.high
        assert found.high - found.low < 0.01 * slope
        naive = metrics.slope(t, swing(t, periods) + sign * slope * t)
        assert abs(naive.value) > 10 * slope, "the control: a line through all points is led astray"


def test_two_frequencies_close_to_each_other_are_told_apart():
    found = drift(T, swing(T, 12.0) + swing(T, 16.5) + 1e-12 * T)
    assert found.low <= 1e-12 <= found.high
    assert found.high < 2e-12


def test_it_is_linear_in_the_error_and_the_same_each_time():
    e = swing(T, 9.1) + 1e-6 * np.sin(T**1.5)
    one, again, more = drift(T, e), drift(T, e), drift(T, 8 * e + 3)
    assert one == again
    assert more.value == pytest.approx(8 * one.value, rel=1e-4)
    assert more.high - more.low == pytest.approx(8 * (one.high - one.low), rel=1e-4)


@pytest.mark.parametrize("kind", coverage.KINDS)
@pytest.mark.parametrize("points", [400, 1500])
def test_the_interval_covers(kind, points):
    found = [coverage.covered(kind, periods, points, drawn=60) for periods in (3, 20)]
    # Of 120 draws at 95.75 % fewer than 105 are covered once in 10 000 times.
    assert sum(r["covered"] for r in found) * 60 >= 105
    assert found[0]["covered by the line"] < 0.6, "the control: the line through all points"


def test_coverage_is_of_intervals_neither_too_narrow_nor_too_wide(monkeypatch):
    hits = sum(coverage.covered("with both and a drift", p, 400, drawn=150)["covered"] for p in (5, 40)) / 2
    assert 0.9 <= hits <= 0.99
    monkeypatch.setattr(module, "_outside", lambda n: 30)
    assert coverage.covered("with both and a drift", 5, 400, drawn=60)["covered"] < 0.8, "the control: narrower"


def test_an_oscillation_slower_than_the_series_is_not_told_from_a_drift():
    assert coverage.covered("oscillation", 0.5, 400, drawn=30)["covered"] < 0.75


@pytest.mark.parametrize(
    ("n", "outside"), [(6, 0), (7, 2), (8, 3), (9, 5), (10, 8), (11, 10), (12, 13), (15, 25), (20, 52)]
)
def test_signed_ranks_are_those_of_the_printed_table(n, outside):
    """Wilcoxon's critical values, two-sided 5 % (F. Wilcoxon, R. A. Wilcox 1964)."""
    assert module._outside(n) == outside


def test_signed_ranks_cover_whatever_the_scales():
    generator = np.random.default_rng(4)
    inside = 0
    for _ in range(600):
        s = signed_ranks(generator.standard_normal(12) * 10.0 ** generator.uniform(-3, 0, 12) + 1)
        assert s.low <= s.value <= s.high
        inside += s.low <= 1 <= s.high
    assert 0.935 < inside / 600 < 0.98


def test_noise_is_no_line():
    generator = np.random.default_rng(5)
    for _ in range(20):
        white = generator.standard_normal(512)
        walk = np.cumsum(generator.standard_normal(512))
        for noise in (white, walk):
            assert np.array_equal(without_lines(T[:512], noise), noise) or np.allclose(
                without_lines(T[:512], noise), noise - noise.mean(), atol=1e-9
            )


@pytest.mark.parametrize("rate", [3, 10, 30, 100, 300])
def test_an_error_that_decays_has_no_drift_larger_than_itself(rate):
    for swinging in (0, 200):
        e = np.exp(-rate * T / T[-1]) * (1 + 0.3 * np.cos(swinging * T / T[-1]))
        found = drift(T, e)
        assert max(abs(found.low), abs(found.high)) * T[-1] < 12


def test_a_series_that_does_not_move_has_no_drift():
    found = drift(T, np.zeros(len(T)))
    assert (found.value, found.low, found.high) == (0, 0, 0)


def test_too_few_points_are_refused():
    with pytest.raises(ValueError, match="too few"):
        drift(np.arange(47.0), np.zeros(47))
    assert drift(np.arange(48.0), 2 * np.arange(48.0)).value == pytest.approx(2)


# -- methods -----------------------------------------------------------------------------------------------------------


def pendulum(step, h, steps):
    """(t, H - H0) of the pendulum from 2 radians."""
    q, p = 2.0, 0.0
    H = [-np.cos(q)]
    for _ in range(steps):
        q, p = step(q, p, h)
        H.append(p * p / 2 - np.cos(q))
    return np.arange(steps + 1) * h, np.array(H) - H[0]


def verlet(q, p, h):
    p -= h / 2 * np.sin(q)
    q += h * p
    return q, p - h / 2 * np.sin(q)


def euler(q, p, h):
    return q + h * p, p - h * np.sin(q)


def rk4(q, p, h):
    def f(q, p):
        return p, -np.sin(q)

    a = f(q, p)
    b = f(q + h / 2 * a[0], p + h / 2 * a[1])
    c = f(q + h / 2 * b[0], p + h / 2 * b[1])
    d = f(q + h * c[0], p + h * c[1])
    return tuple(x + h / 6 * (a[i] + 2 * b[i] + 2 * c[i] + d[i]) for i, x in enumerate((q, p)))


def test_stormer_verlet_does_not_drift_and_others_do():
    t, e = pendulum(verlet, 0.1, 4000)
    found = drift(t, e)
    assert found.low <= 0 <= found.high
    assert max(-found.low, found.high) * t[-1] < 1e-7 * abs(e).max()
    for step, h in ((rk4, 0.1), (euler, 0.001)):
        t, e = pendulum(step, h, 4000)
        found = drift(t, e)
        assert found.low * found.high > 0, step
        assert abs(found.value) * t[-1] > 0.3 * abs(e).max()


# -- the page ----------------------------------------------------------------------------------------------------------


def covering(**values) -> pd.DataFrame:
    row = {"kind": "oscillation", "points": 400, "periods": 4.0, "drawn": 200, "covered": 0.95}
    row |= {"covered by the line": 0.1, "half-width": 1e-20, "half-width by the line": 1e-22}
    return pd.DataFrame([row, row | {"kind": "with white noise"} | values])


@pytest.mark.parametrize("share", [0.89, 0.995])
def test_coverage_is_judged_from_both_sides(share):
    good, bad = (page.coverage({"drift_coverage": t}.get) for t in (covering(), covering(covered=share)))
    assert good.holds
    assert not bad.holds
    assert "95.0% to 95.0%" in good.text
    assert f"95.0% to {share:.1%} of the draws" in bad.text or f"{share:.1%} to 95.0% of the draws" in bad.text
    assert bad.text.endswith("too seldom or too often: with white noise.")
    assert page.coverage({"drift_coverage": covering(covered=share, periods=1.0)}.get).holds
    assert page.coverage({"drift_coverage": covering(periods=1.0).tail(1)}.get) is None


def test_an_oscillation_is_resolved_beyond_the_slowest_that_is_fitted():
    assert [page.resolved(p) for p in (1.0, module.SLOWEST, 1.6)] == [False, False, True]


def test_the_page_says_how_sure_a_coverage_is():
    """Of 400 draws: sqrt(0.95 0.05 / 400)."""
    assert any("of 400 draws a coverage has a standard error of 0.011." in said for said in page.PAGE.limits)


def test_a_kind_is_judged_by_the_mean_over_its_lengths():
    several = pd.concat([covering(covered=share).tail(1) for share in (0.9, 0.999, 0.999)])
    found = page.coverage({"drift_coverage": several}.get)
    assert found.holds
    assert "in 96.6% to 96.6% of the draws, and for one length and period in 90.0% to 99.9%" in found.text


def test_the_numbers_of_the_coverage_are_those_of_the_resolved_rows():
    rows = covering(periods=9.0, **{"covered by the line": 0.8})
    text = page.coverage({"drift_coverage": pd.concat([rows, covering(periods=1.0, covered=0.1)])}.get).text
    assert "On 2 kinds of series, with 4 to 9 periods" in text
    assert "(the line through all points in 10% to 80%)" in text


def test_the_farthest_from_the_nominal_coverage_is_shown_first():
    rows = pd.concat([covering(covered=0.9), covering(covered=0.98, periods=2.0), covering(covered=0.1, periods=1.0)])
    shown = page.table({"drift_coverage": rows}.get).frame
    assert list(shown["covered"]) == [0.9, 0.98, 0.95, 0.95, 0.95, 0.1]


def test_a_single_length_covered_too_seldom_is_not_hidden_by_the_others():
    table = pd.concat([covering(covered=0.97), covering(covered=0.89).tail(1)])
    assert not page.coverage({"drift_coverage": table}.get).holds
    assert page.coverage({"drift_coverage": pd.concat([covering(), covering(covered=0.995)])}.get).holds


def test_the_main_job_fails_for_too_little_coverage():
    assert not bench_drift.off(covering().to_dict("records"))
    assert not bench_drift.off(covering(covered=0.5, periods=1.0).to_dict("records"))
    assert len(bench_drift.off(covering(covered=0.89).to_dict("records"))) == 1


def runs(id: str, *drifts: float, error: float = 1e-6) -> pd.DataFrame:
    same = {"purpose": "drift", "status": "ok", "kind": "phasebench", "t_end": 1000.0, "fallbacks": 0, "h": 0.1}
    same |= {"scene": "pendulum-t1000", "problem": "pendulum:swinging", "id": id, "method": id, "energy_max": error}
    rows = [{"energy_drift": d, "energy_drift_low": d - 1e-12, "energy_drift_high": d + 1e-12} for d in drifts]
    return pd.DataFrame([same | row for row in rows])


def test_bounded_methods_are_counted():
    good = page.bounded({"rows": runs("stormer-verlet", *[0.0] * 9, 5e-12)}.get)
    assert good.holds
    assert "Of 10 long runs of methods declared bounded 90.0%" in good.text
    assert "adds for certain at most 0.004 of" in good.text
    bad = page.bounded({"rows": runs("stormer-verlet", *[0.0] * 8, 5e-12, -5e-12)}.get)
    assert not bad.holds
    assert page.bounded({"rows": runs("rk4", 0.0)}.get) is None
    assert "(stormer-verlet on pendulum-t1000, h = 0.1)" in good.text
    prey = runs("stormer-verlet", 5e-12).assign(problem="lotka-volterra")
    assert page.bounded({"rows": pd.concat([runs("stormer-verlet", 0.0), prey])}.get).text.startswith("Of 1 long runs")
    all_hold = page.bounded({"rows": runs("stormer-verlet", 0.0)}.get)
    assert all_hold.holds
    assert all_hold.text == "Of 1 long runs of methods declared bounded 100.0% have an interval that holds 0."


def test_a_scene_whose_intervals_cover_too_seldom_is_not_hidden_by_the_others():
    """Of 30 runs on one scene all hold 0, of 10 on another 8: 95 % of all."""
    many = runs("stormer-verlet", *[0.0] * 30)
    few = runs("stormer-verlet", *[0.0] * 8, 5e-12, -5e-12).assign(scene="kepler-100-orbits", problem="kepler")
    found = page.bounded({"rows": pd.concat([many, few])}.get)
    assert not found.holds
    assert "Of 40 long runs of methods declared bounded 95.0% have an interval that holds 0, least 80.0%" in found.text
    assert found.short == "Of bounded methods' intervals 95.0% hold 0, 80.0% of the 10 on kepler-100-orbits."
    fine = page.bounded({"rows": pd.concat([many, few.iloc[:-1].iloc[1:], few.iloc[:2]])}.get)
    assert fine.holds
    assert "least 90.0% of the 10 on kepler-100-orbits;" in fine.text


def test_the_condition_of_the_coverage_stands_in_the_short_sentence_too():
    slow = pd.concat([covering(periods=0.5, covered=share).tail(1) for share in (0.5, 0.55)])
    found = page.coverage({"drift_coverage": pd.concat([covering(periods=2.0), slow])}.get)
    assert found.holds
    assert "of 2 periods and more, the 95% interval" in found.short
    assert found.short.endswith("; with 0.5 in 50% to 55%.")
    assert "of fewer periods, which are not told from a drift, with 0.5 in 50% to 55%." in found.text
    assert page.coverage({"drift_coverage": covering()}.get).short.endswith("of the draws.")


RK4, RADAU = (runs(id, 1e-9, -1e-9) for id in page.CONTROLS)


@pytest.mark.parametrize("id", page.CONTROLS)
def test_every_run_of_every_control_must_exclude_0(id):
    good = page.controls({"rows": pd.concat([RK4, RADAU])}.get)
    assert good.holds
    assert "rk4 in 2 of 2 runs and radau-iia-2 in 2 of 2 runs" in good.text
    assert "declared to drift 4 of 4 runs that end." in good.text
    more = page.controls({"rows": pd.concat([RK4, RADAU, runs(id, 0.0)])}.get)
    assert not more.holds
    assert f"{id} in 2 of 3 runs" in more.text
    assert f"4 of 5 runs that end; not so {id} on pendulum-t1000, h = 0.1." in more.text


@pytest.mark.parametrize(("left", "id"), [(RK4, "radau-iia-2"), (RADAU, "rk4")])
def test_a_control_that_measured_nothing_does_not_pass(left, id):
    """Runs that do not end have no interval, runs of round-off are none of the method."""
    for nothing in (runs(id, 1e-9).assign(status="diverged"), runs(id, 1e-9, error=1e-13), runs(id)):
        found = page.controls({"rows": pd.concat([left, nothing])}.get)
        assert not found.holds
        assert f"{id} in 0 of 0 runs" in found.text
        assert f"nothing was measured of {id}" in found.text
    assert page.controls({"rows": runs("rk4", 1e-9).assign(status="diverged")}.get) is None


def test_another_method_that_is_declared_to_drift_must_drift_too():
    other = page.controls({"rows": pd.concat([RK4, RADAU, runs("dop853", 0.0)])}.get)
    assert not other.holds
    assert "not so dop853 on" in other.text
    assert page.controls({"rows": pd.concat([RK4, RADAU, runs("stormer-verlet", 0.0)])}.get).holds


def test_the_controls_are_declared_to_drift():
    assert [BY_ID[id].energy for id in page.CONTROLS] == [DRIFT, DRIFT]
