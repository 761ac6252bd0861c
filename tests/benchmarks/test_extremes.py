"""Measures of the studies of extremes where the answer is known: theory in two ways, known orbits, hand-made maps."""

from __future__ import annotations

import dataclasses
import math

import mpmath
import numpy as np
import pandas as pd
import pytest
from scipy import stats

from phasebench.benchmarks.measure import exact_maps, oscillator
from phasebench.benchmarks.measure.exact_maps import DIGITS, exact_matrix
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.studies.extremes import (
    encounters,
    limits,
    maps,
    multistep,
    push,
    round_off,
    springs,
    summary,
)
from phasebench.integrators.coefficients.multistep import QUINLAN_TREMAINE
from phasebench.integrators.driver import OK, integrate
from phasebench.integrators.prepared import prepare
from phasebench.integrators.registry import BY_ID
from support import known_maps

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


def test_text_of_intervals_is_parsed():
    assert limits.pieces("0..2.5 3..") == [(0.0, 2.5), (3.0, math.inf)]
    assert limits.pieces(math.nan) == []


def test_stability_functions():
    """R of the classical method is the truncated exponential series; that of Gauss is a Pade approximation."""
    rows = {r["method"]: r for r in maps.stability_functions(True)}
    assert np.allclose([float(c) for c in rows["rk4"]["above"].split()], [1 / 24, 1 / 6, 1 / 2, 1, 1])
    assert np.allclose([float(c) for c in rows["gauss-2"]["below"].split()], [1 / 12, -1 / 2, 1])


def test_resonances_are_where_theory_predicts():
    """Stormer-Verlet is stable to 2; the impulse method resonates at h (1 + ratio) = 2 pi, a filtered one does not."""
    coupled, start = maps.coupled(maps.RATIOS[0] * 2), {"q0": (1, 0), "p0": (0, 0)}
    run = {id: prepare(coupled, BY_ID[id], **start) for id in ("stormer-verlet", "deuflhard", "hairer-lubich")}
    assert maps.radius(run["stormer-verlet"], 0.9) < 1 + 1e-9
    assert maps.radius(run["stormer-verlet"], 1.1) > 1.1
    at = 2 * math.pi / 3
    assert maps.radius(run["deuflhard"], at) > 1.01 > maps.radius(run["hairer-lubich"], at)


def test_outcomes_of_solvers():
    found = {(r["value"], r["h"]): r["outcome"] for r in maps.solvers("scheme-ii", "pendulum", "lam")}
    assert found[1.0, maps.H_PENDULUM[0]] == maps.FIXED_POINT
    assert found[11.0, maps.H_PENDULUM[-1]] != maps.FIXED_POINT
    assert len(found) == len(maps.LAMBDAS) * len(maps.H_PENDULUM)


# -- largest steps -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("edge_at", [0.013, 0.1, 3.0])
def test_largest_step_is_bisected(edge_at):
    h, fails = push.largest(lambda h: OK if h <= edge_at else "lost", 0.1)
    assert h <= edge_at < h * 2 ** (1.01 / push.PARTS)
    assert fails == "lost"


def test_all_steps_survive_or_none():
    assert push.largest(lambda h: "lost", 0.1) == (0.0, "lost")
    assert push.largest(lambda h: OK, 0.1) == (math.inf, "")


def test_status_of_runs_on_known_orbits():
    """At an h near the period of the box orbit the energy error is small, but the clock is wrong."""
    pendulum, near, box = (
        push.CASES[name] for name in ("pendulum", "pendulum, 1e-12 below the separatrix", "Henon-Heiles, box")
    )
    assert push.judge_run(pendulum, "stormer-verlet", 0.1, 1000) == OK
    assert push.judge_run(pendulum, "stormer-verlet", 2.2, 1000) == push.LOST
    assert push.judge_run(near, "stormer-verlet", 0.3, 1000) == push.WRONG
    assert push.course(pendulum).size == pytest.approx(-math.cos(2), rel=1e-3)
    by_energy = dataclasses.replace(box, ranged=False, timed=False)
    assert push.judge_run(box, "blanes-moan-s6", 0.5, 300) == OK
    assert push.judge_run(by_energy, "blanes-moan-s6", 5.4, 300) == OK
    assert push.judge_run(box, "blanes-moan-s6", 5.4, 300) == push.CLOCK


def test_orbit_out_of_range_or_out_of_phase():
    case = push.CASES["pendulum"]
    known, t = push.course(case), np.linspace(0, 200, 2001)
    swing = (known.high + known.low) / 2 + (known.high - known.low) / 2 * np.sin(np.pi * known.rate * t)[:, None]
    assert push.strays(case, swing, 200.0, True) == OK
    assert push.strays(case, swing * 2.5, 200.0, True) == push.WRONG
    assert push.strays(case, swing, 500.0, True) == push.CLOCK
    assert push.strays(case, swing, 500.0, False) == OK
    assert push.crossings(np.array([1.0, -1.0, -1.0, 1.0]), 0.0) == 2


def test_escape_is_no_failure():
    start = (0.0, 0.5), (0.3, 0.8)  # H is about 0.45
    gone, kept = push.Case("henon-heiles", *start, escapes=3.0), push.Case("henon-heiles", *start)
    assert push.judge_run(gone, "stormer-verlet", 0.02, 20_000) == OK
    assert push.judge_run(kept, "stormer-verlet", 0.02, 20_000) != OK


# -- round-off ---------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def distances(of_each):
    """A function: method -> distance of its step matrix on the oscillator from the exact one, measured uncompiled."""
    return of_each(known_maps)


@pytest.mark.parametrize("id", known_maps.KNOWN)
def test_methods_equal_to_a_known_one_on_the_oscillator(distances, id):
    assert distances(id) <= 4e-16


EXACT = ("stormer-verlet", "pefrl", "blanes-moan-srkn6b", "gauss-2", "lobatto-iiia-iiib-3", "avf", "deuflhard")


@pytest.mark.parametrize(("id", "values"), [*((id, {}) for id in EXACT), ("scheme-i", {"lam": "1/3"})])
def test_exact_matrix_is_the_methods_matrix(id, values):
    with mpmath.workdps(DIGITS):
        M = np.array(exact_matrix(id, values, 0.3).tolist(), float)
    assert np.allclose(M, oscillator.matrix(integrator(id, parameters=values), 0.3), rtol=0, atol=4e-16)


def test_how_errors_of_methods_are_measured():
    found = [round_off.how(id, {})[0] for id in ("gauss-2", "scheme-v", "gauss-equip-2")]
    assert found == [round_off.EXACT, round_off.ENERGY_KEPT, round_off.ENERGY_KEPT]
    assert round_off.how("r-respa", {}) is None
    row = round_off.every("abc-2", round_off.H, 64)
    assert "parts" in row["reason"]
    assert "energy exponent" not in row


def test_integer_errors_equal_multiprecision_errors():
    rng, n = np.random.default_rng(1), np.array([0, 3, 7])
    Q, P = rng.uniform(-1, 1, (2, 4, 3))
    with mpmath.workdps(DIGITS):
        M = exact_matrix("stormer-verlet", {}, 0.1)
        energy, phase = exact_maps.errors(M, n, Q, P)
        turn = mpmath.mpc((M[0, 0] + M[1, 1]) / 2, mpmath.sqrt(1 - ((M[0, 0] + M[1, 1]) / 2) ** 2))
        for i in range(4):
            w = [M[1, 0] * q + (turn - M[0, 0]) * p for q, p in zip(Q[i], P[i], strict=True)]
            for k in range(3):
                assert energy[i, k] == pytest.approx(float(abs(w[k]) ** 2 / abs(w[0]) ** 2 - 1), rel=1e-14, abs=1e-30)
                late = mpmath.arg(w[k] / w[0] * mpmath.expj(-mpmath.arg(turn) * int(n[k])))
                assert phase[i, k] == pytest.approx(float(late), rel=1e-14, abs=1e-30)


def test_energy_and_phase_error_of_known_orbits():
    with mpmath.workdps(DIGITS):
        M = exact_matrix("stormer-verlet", {}, 0.01)
        y, far = mpmath.matrix([1, 0]), M**100_000 * mpmath.matrix([1, 0])
        for off in (0.0, 1e-9):
            Q, P = ([float(y[k]), float(far[k] * (1 + off))] for k in (0, 1))
            energy, phase = exact_maps.errors(M, [0, 100_000], Q, P)
            assert energy[1] == pytest.approx(2 * off, rel=1e-6, abs=1e-15)
            assert abs(phase[1]) < 1e-15


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


def test_run_in_lanes_equals_a_single_run():
    starts = round_off.starts(9)
    Q, P = round_off.run("implicit-midpoint", {}, 0.1, 640, starts, 64)
    start = {"q0": starts[3, :1], "p0": starts[3, 1:]}
    alone = integrate(problem("harmonic-oscillator"), "implicit-midpoint", h=0.1, steps=640, save_every=10, **start)
    assert np.array_equal(Q[3], alone.q[:, 0])
    assert np.array_equal(P[3], alone.p[:, 0])


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
        value, low, high = round_off.power(n, e)
        assert low - 1e-12 <= value <= high + 1e-12, "lines are fitted to round-off"
        covered += low - 1e-9 <= exponent <= high + 1e-9
    assert covered >= 16


@pytest.mark.parametrize("h", [0.01, 0.25])
def test_error_in_units_of_eps_h_sqrt_n(h):
    """An error of eps h sqrt(n) is one unit for any n; as a control, 4 n steps halve it."""
    for n in (100, 400):
        size = round_off.EPS * h * np.sqrt(n)
        ends = np.array([[0.0, size], [0.0, -size], [0.0, size], [0.0, size]])
        assert round_off.summary(np.array([n // 2, n]), h, ends)["in units"] == pytest.approx(1, rel=1e-12)
    assert round_off.summary(np.array([n, 4 * n]), h, ends)["in units"] == pytest.approx(0.5, rel=1e-12)


def test_threshold_of_a_bias_grows_with_the_ensembles():
    rows = pd.DataFrame({"starts": [100] * 144})
    assert round_off.critical(rows.head(1)) == pytest.approx(1.984, abs=1e-3)  # Student's t, 99 degrees of freedom
    for k in (18, 144):
        beyond = 2 * stats.t.sf(round_off.critical(rows.head(k)), 99)
        assert (1 - beyond) ** k == pytest.approx(0.95, abs=1e-9)
    assert round_off.critical(rows.assign(starts=10)) > 5


def test_largest_bias_is_named_first():
    """The two tables have thresholds of their own; runs at fractions, and by hand, do not count."""
    base = {"h": 0.02, "steps": 1000, "starts": 100, "reason": "", "by": "", "kind": round_off.USUAL}
    rows = [base | {"label": str(k), round_off.MEAN: 0.1} for k in range(20)]
    rows += [base | {"label": "c", round_off.MEAN: 4.0, "by": round_off.ENERGY_KEPT}]
    rows += [base | {"label": "b", round_off.MEAN: -5.0}]
    far = [base | {"label": "f", "kind": kind, round_off.MEAN: 40.0} for kind in (round_off.FRACTION, round_off.HAND)]
    tables = pd.DataFrame([*far, base | {"label": "a", round_off.MEAN: 2.1}]), pd.DataFrame(rows).drop(columns="kind")
    found = round_off.means({round_off.CHOSEN: tables[0], round_off.EVERY: tables[1]}.get)
    far = found[found[round_off.MEAN].abs() > found["limit"]]
    assert [f"{r['at']} ({r['note']})" for _, r in far.iterrows()] == [
        "b at h = 0.02 (leads after 4000 steps)",
        "c at h = 0.02 (an offset)",
        "a at h = 0.02 (leads after 2.3e+04 steps)",
    ]
    assert len(found) == 23


def test_steps_after_which_a_bias_dominates():
    """Walks with a mean step of 1/50 standard deviations: the drift equals the walk after 2500 steps."""
    generator, n = np.random.default_rng(1), 400
    ends = generator.standard_normal((4000, n)).sum(1) + n / 50
    mean = ends.mean() / (ends.std(ddof=1) / np.sqrt(len(ends)))
    assert round_off.overtaken({"steps": n, "starts": len(ends), round_off.MEAN: mean}) == pytest.approx(2500, rel=0.2)


@pytest.mark.parametrize(("id", "is_biased"), [("implicit-midpoint", True), ("stormer-verlet", False)])
def test_bias_is_reproduced_from_other_starts(monkeypatch, id, is_biased):
    """Four other seeds: the means of four ensembles add up if biased, else grow by the square root."""
    means = []
    for seed in (101, 102, 103, 104):
        monkeypatch.setattr(round_off, "SEED", seed)
        means.append(round_off.every(id, round_off.H, round_off.steps_of(id))[round_off.MEAN])
    together = abs(sum(means)) / len(means) ** 0.5
    assert (together > 6) is is_biased
    assert (together < 3.5) is not is_biased


# -- close encounters --------------------------------------------------------------------------------------------------


def test_apocentre_is_computed_from_the_rounded_state():
    half, far = encounters.apocentre(0.4, 2.0)  # a = 1, e = 0.6
    assert (half, far) == (pytest.approx(np.pi, rel=1e-15), pytest.approx(1.6, rel=1e-15))
    rows = {r["e"]: r for r in encounters.kepler("wisdom-holman")}
    assert all(rows[e]["held"] for e in encounters.ECCENTRICITIES[:3])
    assert not encounters.kepler("symplectic-euler-p")[-1]["held"]


def test_reach_ends_at_the_first_loss():
    held = {"b": (1, 0, 1), "a": (0, 1, 1), "c": (1, 1, 1)}
    es = (0.9, 0.99, 0.999)
    rows = [{"method": m, "e": e, "held": x} for m, all_ in held.items() for e, x in zip(es, all_, strict=True)]
    assert list(summary.reach(pd.DataFrame(rows)).items()) == [("b", 0.9), ("a", 0.0), ("c", 0.999)]
    kinds = [summary.kind(m, "fixed") for m in ("stormer-verlet", "wisdom-holman", "rebound-whfast")]
    assert kinds == ["fixed", "Kepler-solving", "Kepler-solving"]


def test_encounter_is_judged_at_its_certified_state():
    assert encounters.distance([1.5, 101.0], [1.0, 100.0]) == 0.5
    rows = encounters.meet("zoom-whirl", "rk4")
    assert rows[-1]["error"] < rows[0]["error"]
    assert rows[-1]["steps"] == rows[-1]["asked"]
    (held,) = encounters.cheapest(pd.DataFrame(rows).assign(scene="zoom-whirl", method="rk4"))["held"]
    assert held == (rows[-1]["error"] <= encounters.HELD)


def test_cheapest_run_that_holds_or_the_most_accurate():
    rows = [("a", 4096, 1e-7), ("a", 1024, 2.0), ("a", 512, 1e-7), ("b", 700, 1.0), ("b", 100, 2.0)]
    found = encounters.cheapest(pd.DataFrame(rows, columns=["method", "steps", "error"]).assign(scene="s"))
    assert found.set_index("method")["steps"].to_dict() == {"a": 512, "b": 700}


# -- stiff springs -----------------------------------------------------------------------------------------------------


def test_distance_from_the_resonance_lines():
    found = springs.lines(2, 2.0)
    assert {(1, 0, 1), (0, 1, 1), (1, 1, 1), (2, 0, 1), (0, 2, 1)} <= {*found}
    assert springs.lines(2, 1.0) == [(0, 2, 1), (1, 1, 1), (2, 0, 1)]
    assert springs.lines(2, 0.9) == []
    x, y = np.array([0.5, 1.0, 0.3]), np.array([1.5, 0.2, 0.3])
    assert springs.distance(x, y, 2) == pytest.approx([0, 0, 0.7])
    assert springs.distance(x, y, 4)[2] == pytest.approx(0.2)
    assert springs.distance(np.array([0.1, 0.1]), np.array([0.3, 1.95]), 2)[1] == pytest.approx(0.05 / 2**0.5)


@pytest.mark.parametrize(("a", "b"), [(1, 0), (0, 1), (1, 1), (1, -1)])
def test_ridge_in_any_of_four_directions_is_found(a, b):
    """High everywhere except on both sides of the centre along one line: a row, a column or a diagonal."""
    drift = np.full((13, 13), 100.0)
    for k, low in ((1, 50.0), (2, 1.0)):
        drift[6 + k * a, 6 + k * b] = drift[6 - k * a, 6 - k * b] = low
    assert np.argwhere(springs.crests(drift)).tolist() == [[6, 6]]
    for place, high in (((6 - 2 * a, 6 - 2 * b), 100.0), ((6 - a, 6 - b), 101.0), ((6 + a, 6 + b), 101.0)):
        other = drift.copy()
        other[place] = high
        assert not springs.crests(other)[6, 6], "the controls: as high on one side"


def test_a_step_and_a_border_are_no_crests():
    step, border = np.ones((9, 9)), np.ones((9, 9))
    step[4:] = border[0] = 100.0
    assert not springs.crests(step).any()
    assert not springs.crests(border).any()


def test_crests_of_a_map_are_counted_with_the_highest():
    """1e-3 on the line x + y = 2 or five nodes beside it, 1e-6 elsewhere."""
    for aside in (0, 5):
        rows = [
            {"method": "a", "node 1": i, "node 2": j, "h omega 2": j / 10, "nodes": 36}
            | {"drift": 1e-3 if i + j == 72 - aside else 1e-6}
            for i in range(4, 70)
            for j in range(i, 70)
        ]
        found = springs.summary({springs.TABLE: pd.DataFrame(rows)}.get).iloc[0]
        assert found["crests"] > 15
        assert (found["crests on lines"] == found["crests"]) == (aside == 0)
        assert (found["at"] == "(0.5, 6.7)") == (aside == 0)


def test_single_spring_preserves_the_energy_of_its_step():
    turns = springs.Turns("stormer-verlet", [0.5, 1.5, 2.5])
    assert len(turns.z) == 2
    assert turns.angles == pytest.approx(2 * np.arcsin([0.25, 0.75]))
    orbit = np.array([np.linalg.matrix_power(turns.matrices[1], n) @ [1.0, 0.3] for n in range(50)]).T
    assert np.ptp(turns.energy(1, *orbit)) < 1e-13
    assert np.ptp((orbit**2).sum(axis=0)) > 0.1
    exact = springs.Turns("deuflhard", [np.pi, 4.0])
    assert exact.angles == pytest.approx([np.pi, 4.0])
    assert exact.energy(1, 1.0, 2.0) == pytest.approx(2.5)
    assert exact.energy(0, 1.0, 2.0) == pytest.approx(2.5)


def test_grid_is_at_multiples_of_the_angle():
    z = springs.grid("stormer-verlet", 36)[:-2]
    assert np.allclose(z, 2 * np.sin(np.pi * np.arange(springs.LEAST, 36) / 72)[: len(z)], atol=1e-4)
    assert len(z) > 36 - springs.LEAST - 5


@pytest.mark.parametrize("id", ["stormer-verlet", "deuflhard"])
def test_springs_equal_the_registered_problem(id):
    q0, p0 = [*springs.SOFT_Q, 1 / 40, 1 / 40], [*springs.SOFT_P, 1.0, 1.0]
    known = integrate(problem("fpu", omega=40.0, m=2), id, h=springs.H, steps=30, q0=q0, p0=p0)
    Q, P = springs.Springs(id)(np.array([40.0, 40.0]), 30)
    assert np.allclose(Q, known.q.T, rtol=0, atol=1e-13)
    assert np.allclose(P, known.p.T, rtol=0, atol=1e-12)


def test_impulse_method_drifts_at_a_resonance():
    run, z = springs.Springs("deuflhard"), np.array([2.0, 2 * np.pi - 2.0])
    drifts = []
    for at in (z, z + 0.3):
        turns = springs.Turns("deuflhard", at)
        Q, P = run(at / springs.H, 1500)
        fast = sum(turns.energy(k, at[k] / springs.H * Q[2 + k], P[2 + k]) for k in (0, 1))
        drifts.append(springs.drift(Q, P, fast))
    assert drifts[0] > 100 * drifts[1]
    assert springs.drift(Q * np.nan, P, fast) == np.inf


# -- multistep methods -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("order", "N"), [(8, 10.0), (8, 59.5), (8, 60.0), (10, 40.0), (12, 33.5), (14, 132.0)])
def test_both_theories_agree_on_the_circle(order, N):
    """The closed form, and the eigenvalues of the product of all steps."""
    table = QUINLAN_TREMAINE[order]
    one, other = multistep.circular_rate(table, N), multistep.floquet_rate(table, N, 0.0)
    assert one > 0.01
    # the closed form has the radius of the recursion's own circle, the product the exact one
    assert one == pytest.approx(other, rel=0.35 if N < 60 else 0.01)


def test_a_resonance_of_two_parasitic_roots_is_found():
    """Roots of order 8 at 72 and 60 degrees: twice the orbit's angle is their difference with 60 steps an orbit."""
    assert multistep.circular_rate(QUINLAN_TREMAINE[8], 60.0) > 0.05
    assert abs(multistep.circular_rate(QUINLAN_TREMAINE[8], 62.0)) < 1e-6
    assert abs(multistep.floquet_rate(QUINLAN_TREMAINE[8], 62.0, 0.0)) < 1e-3
    assert multistep.floquet_rate(QUINLAN_TREMAINE[8], 90.0, 0.2) > 0.01


def test_points_are_on_keplers_orbit():
    t = np.linspace(0, 2 * np.pi, 9)
    q = multistep.orbit(0.2, t)
    assert np.abs(q[[0, -1]] - [0.8, 0]).max() < 1e-14
    assert np.abs(q[4] - [-1.2, 0]).max() < 1e-14
    E = np.arccos(np.clip(q[1, 0] + 0.2, -1, 1))
    assert pytest.approx(t[1], abs=1e-13) == E - 0.2 * np.sin(E)


def test_runs_are_lost_where_theory_says_so(monkeypatch):
    monkeypatch.setattr(multistep, "ORBITS", 600)
    monkeypatch.setattr(multistep, "steps_asked", lambda table: np.array([60.0, 62.0]))
    rows = pd.DataFrame(multistep.steps("quinlan-tremaine-8", 0.0)).assign(method="quinlan-tremaine-8")
    found = multistep.judged({multistep.TABLE: rows}.get)
    assert list(found["lost"]) == list(found["unstable"]) == [True, False]
    assert found["decided"].all()
    assert multistep.spans(pd.Series([59.5, 60.0, 60.5, 90.0])) == "59.5 to 60.5, 90"


def test_the_control_drifts(monkeypatch):
    monkeypatch.setattr(multistep, "SHORT", 100)
    monkeypatch.setattr(multistep, "WINDOWS", 60)
    assert multistep.long(multistep.CONTROL, multistep.OFF)["high"] < -1e-11, "its interval excludes 0"
