"""Brouwer's law for every method: passing and failing verdicts, exact maps, runs in lanes, errors in integers."""

from __future__ import annotations

import mpmath
import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.experiments.extremes import brouwer, exact_maps, round_off_page
from phasebench.benchmarks.experiments.extremes import brouwer_every as every
from phasebench.benchmarks.experiments.extremes import round_off_verdicts as verdicts
from phasebench.benchmarks.page.verdict import FINDING, PASS, Count
from phasebench.benchmarks.problems import problem
from phasebench.integrators.driver import integrate
from phasebench.integrators.registry import METHODS
from support import known_maps

FITTED = {"energy exponent": 0.5, "energy low": 0.45, "energy high": 0.55}
FITTED |= {"phase exponent": 0.6, "phase low": 0.5, "phase high": 0.7, "in units": 1.0}


def table(*rows) -> pd.DataFrame:
    base = {"h": every.H, "steps": 4096, "reason": "", "starts": 100}
    return pd.DataFrame([base | {"label": f"m{k}"} | row for k, row in enumerate(rows)])


def judge(verdict, *rows):
    """A page's verdict on these fabricated rows of ensembles."""
    return verdict({"extremes_growth_every": table(*rows)}.get)


@pytest.mark.parametrize(
    ("verdict", "change", "outcome"),
    [
        (verdicts.energy, {"energy low": verdicts.ENERGY + verdicts.ABOVE}, PASS),
        (verdicts.energy, {"energy low": verdicts.ENERGY + verdicts.ABOVE + 0.01}, FINDING),
        (verdicts.phase, {"phase low": verdicts.PHASE + verdicts.ABOVE}, PASS),
        (verdicts.phase, {"phase low": verdicts.PHASE + verdicts.ABOVE + 0.01}, FINDING),
    ],
)
def test_method_fails_beyond_a_tolerance(verdict, change, outcome):
    """A value equal to the tolerance passes."""
    found = judge(verdict, FITTED, FITTED | change, {"reason": "lacks a trait"})
    assert (found.measured, found.outcome) == (Count(1 + (outcome == PASS), 2), outcome)
    assert found.where.partition(":")[0] == ("" if outcome == PASS else "m1 at h = 0.0987654321")


def test_method_without_a_phase_error_is_not_judged_by_it():
    found = judge(verdicts.phase, FITTED, FITTED | {"phase exponent": np.nan, "phase low": np.nan})
    assert found.measured == Count(1, 1)


@pytest.mark.parametrize(("units", "outcome"), [(verdicts.UNITS, PASS), (2 * verdicts.UNITS, FINDING)])
def test_largest_round_off_of_all_methods_is_judged(units, outcome):
    found = judge(verdicts.size, FITTED, FITTED | {"in units": units})
    assert (found.measured, found.outcome, found.where) == (units, outcome, "m1 at h = 0.0987654321, 4096 steps")


def test_methods_without_an_ensemble_are_not_judged():
    for verdict in (verdicts.energy, verdicts.phase, verdicts.size, verdicts.bias):
        assert judge(verdict, FITTED | {"reason": "lacks a trait"}) is None


def test_every_suitable_own_method_has_a_cell():
    wanted = {m.id for m in METHODS if m.symplectic or m.energy == "round-off"}
    assert {id for cell in every.cells() for id in cell.names} == wanted
    assert len({cell.id for cell in every.cells()}) == len(wanted) > 140


@pytest.fixture(scope="module")
def distances(of_each):
    """A function: method -> distance of its step matrix on the oscillator from the exact one, measured uncompiled."""
    return of_each(known_maps)


@pytest.mark.parametrize("id", known_maps.KNOWN)
def test_methods_equal_to_a_known_one_on_the_oscillator(distances, id):
    assert distances(id) <= 4e-16


def test_other_methods_are_not_taken_for_a_known_one():
    assert exact_maps.has_exact_map("stormer-verlet")
    assert not exact_maps.has_exact_map("r-respa")
    assert [every.how(id, {})[0] for id in ("gauss-2", "scheme-v", "gauss-equip-2")] == [
        every.EXACT,
        *(every.ENERGY,) * 2,
    ]
    assert every.how("r-respa", {}) is None


def test_run_in_lanes_equals_a_single_run():
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


def test_integer_errors_equal_multiprecision_errors():
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


def test_row_states_why_a_method_has_no_ensemble():
    row = every.measure_rows("gauss-4-adaptive", {}, "gauss-4-adaptive")[every.TABLE][0]
    assert "singular distances" in row["reason"]
    assert "energy exponent" not in row


def test_table_order_explained_runs_then_the_worst():
    long = pd.DataFrame([FITTED | {"label": "f", "kind": brouwer.FRACTION, "h": 0.1, "steps": 9, "bias per step": 0.0}])
    long["bias in its errors"] = 0.0
    rows = [FITTED | {"in units": float(k), "bias per step": 0.0, "bias in its errors": 0.0} for k in range(40)]
    rows[7] |= {"energy low": 0.9}
    tables = {"extremes_growth": long, "extremes_growth_every": table(*rows, {"reason": "lacks a trait"})}
    shown = list(round_off_page.table(tables.get).frame["run"])
    assert shown[:3] == ["f", "m7", "m39"]
    assert len(shown) == 25
    assert len(round_off_page.full_table(tables.get)) == 42
    assert round_off_page.table({}.get) is None
