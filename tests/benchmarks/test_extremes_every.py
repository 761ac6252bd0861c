"""Brouwer's law for every method: the sentence both ways, the maps, the runs in lanes, the errors in integers."""

from __future__ import annotations

import mpmath
import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.experiments.extremes import brouwer, exact_maps, round_off_page
from phasebench.benchmarks.experiments.extremes import brouwer_every as every
from phasebench.benchmarks.experiments.extremes import round_off_verdicts as verdicts
from phasebench.benchmarks.measure import oscillator
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.problems import problem
from phasebench.integrators.driver import integrate
from phasebench.integrators.registry import METHODS

FITTED = {"energy exponent": 0.5, "energy low": 0.45, "energy high": 0.55}
FITTED |= {"phase exponent": 0.6, "phase low": 0.5, "phase high": 0.7, "in units": 1.0}


def table(*rows) -> pd.DataFrame:
    base = {"h": every.H, "steps": 4096, "reason": "", "starts": 100}
    return pd.DataFrame([base | {"label": f"m{k}"} | row for k, row in enumerate(rows)])


def said(*rows):
    return verdicts.every_method(lambda name: table(*rows))


def test_every_method_has_three_ways_to_fail():
    good = said(FITTED, FITTED | {"phase exponent": np.nan, "phase low": np.nan}, {"reason": "lacks a trait"})
    assert good.holds
    assert "2 of 2 methods at h = 0.0988" in good.text
    assert "the phase's than n^1.5 in 1 of 1;" in good.text
    assert good.text.endswith("; 1 have none here: m2.")
    assert "at most 1 (m0 at h = 0.0987654321, 4096 steps);" in good.text
    assert (
        verdicts.every_method(lambda name: table({"reason": "lacks a trait"}).assign(**{"energy exponent": 0.0}))
        is None
    )
    fast = said(FITTED, FITTED | {"energy low": verdicts.ENERGY + verdicts.ABOVE + 0.01})
    assert not fast.holds
    assert "1 of 2 methods" in fast.text
    assert "(above it: m1 at h = 0.0987654321, n^0.50 [0.56, 0.55])" in fast.text
    assert not said(FITTED, FITTED | {"phase low": verdicts.PHASE + verdicts.ABOVE + 0.01}).holds
    assert said(FITTED | {"phase low": verdicts.PHASE + verdicts.ABOVE}).holds, "on the line is not above it"
    assert said(FITTED).text.endswith("4096 steps)."), "none is without an ensemble"
    large = said(FITTED, FITTED | {"in units": 2 * verdicts.UNITS})
    assert not large.holds
    assert "at most 20 (m1 at" in large.text


def test_every_method_of_ours_that_could_has_a_cell():
    wanted = {m.id for m in METHODS if m.symplectic or m.energy == "round-off"}
    assert {id for cell in every.cells() for id in cell.names} == wanted
    assert len({cell.id for cell in every.cells()}) == len(wanted) > 140


KNOWN = ["scheme-ii", "generating-function", *sorted({*exact_maps.SAME} - {"avf"})]


@pytest.mark.parametrize("id", [*KNOWN[:2], *KNOWN[2::4]])
def test_methods_that_are_another_on_the_oscillator_are_that(id):
    with mpmath.workdps(brouwer.DIGITS):
        M = np.array(exact_maps.exact_matrix(id, {}, 0.3).tolist(), float)
    assert np.allclose(M, oscillator.matrix(integrator(id), 0.3), rtol=0, atol=4e-16)


def test_what_is_another_method_is_not_taken_for_a_known_one():
    assert exact_maps.known("stormer-verlet")
    for id in exact_maps.OTHERS:
        assert not exact_maps.known(id)
    assert [every.how(id, {})[0] for id in ("gauss-2", "scheme-v", "gauss-equip-2")] == [
        every.EXACT,
        *(every.ENERGY,) * 2,
    ]
    assert every.how("r-respa", {}) is None


def test_runs_in_lanes_are_those_of_a_run_alone():
    starts = brouwer.starts_of(9)
    Q, P = brouwer.runs("implicit-midpoint", {}, 0.1, 640, starts, 64)
    alone = integrate(
        problem(brouwer.PROBLEM),
        "implicit-midpoint",
        h=0.1,
        steps=640,
        q0=starts[3, :1],
        p0=starts[3, 1:],
        save_every=10,
    )
    assert np.array_equal(Q[3], alone.q[:, 0])
    assert np.array_equal(P[3], alone.p[:, 0])


def test_errors_in_integers_are_those_in_many_digits():
    rng, n = np.random.default_rng(1), np.array([0, 3, 7])
    Q, P = rng.uniform(-1, 1, (2, 4, 3))
    with mpmath.workdps(brouwer.DIGITS):
        M = exact_maps.exact_matrix("stormer-verlet", {}, 0.1)
        energy, phase = brouwer.errors(M, n, Q, P)
        turn = mpmath.mpc((M[0, 0] + M[1, 1]) / 2, mpmath.sqrt(1 - ((M[0, 0] + M[1, 1]) / 2) ** 2))
        for i in range(4):
            w = [M[1, 0] * q + (turn - M[0, 0]) * p for q, p in zip(Q[i], P[i], strict=True)]
            for k in range(3):
                assert energy[i, k] == pytest.approx(float(abs(w[k]) ** 2 / abs(w[0]) ** 2 - 1), rel=1e-14, abs=1e-30)
                late = mpmath.arg(w[k] / w[0] * mpmath.expj(-mpmath.arg(turn) * int(n[k])))
                assert phase[i, k] == pytest.approx(float(late), rel=1e-14, abs=1e-30)


def test_a_row_says_why_a_method_has_no_ensemble():
    row = every.measured("gauss-4-adaptive", {}, "gauss-4-adaptive")[every.TABLE][0]
    assert "singular distances" in row["reason"]
    assert "energy exponent" not in row


def test_the_table_shows_explained_runs_first_and_then_the_worst():
    long = pd.DataFrame([FITTED | {"label": "f", "kind": brouwer.FRACTION, "h": 0.1, "steps": 9, "bias per step": 0.0}])
    long["bias in its errors"] = 0.0
    rows = [FITTED | {"in units": float(k), "bias per step": 0.0, "bias in its errors": 0.0} for k in range(40)]
    rows[7] |= {"energy low": 0.9}
    tables = {"extremes_growth": long, "extremes_growth_every": table(*rows, {"reason": "lacks a trait"})}
    shown = list(round_off_page.table(tables.get).frame["run"])
    assert shown[:3] == ["f", "m7", "m39"]
    assert len(shown) == 25
    assert len(round_off_page.whole(tables.get)) == 42
    assert round_off_page.table({}.get) is None
