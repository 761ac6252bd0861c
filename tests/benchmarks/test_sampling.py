"""Acceptance of Hamiltonian Monte Carlo, and the verdicts of its page."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.experiments.sampling import (
    acceptance,
    bench_sampling,
    cost,
    limits,
    page,
)
from phasebench.benchmarks.page.page import ROWS
from phasebench.benchmarks.page.verdict import FINDING, PASS, Count
from phasebench.integrators.coefficients import sampling as tables
from phasebench.integrators.coefficients.order_conditions import classical_order

# -- the methods -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("table", tables.TABLES, ids=lambda t: t.name)
def test_splittings_for_sampling_have_order_2_with_the_numbers_as_printed(table):
    steps = tables.steps(table.name)
    assert classical_order("splitting", steps) == 2
    letter, weight = steps[0]
    assert classical_order("splitting", [(letter, weight + 1e-9), *steps[1:]], tolerance=1e-12) == 0, "the control"


@pytest.mark.parametrize("id", acceptance.EVALUATIONS)
def test_evaluations_per_step_are_those_of_the_method(id):
    """By the counts of a run, in which the first kick of the first step comes on top."""
    q, p = acceptance.draws("quartic", 1)
    found = acceptance.integrate_ensemble(acceptance.system("quartic"), id, q, p, h=0.001, steps=100)
    assert found.counts["gradient"] // 100 == acceptance.EVALUATIONS[id]


# -- acceptance --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("target", acceptance.TARGETS)
def test_draws_have_the_moments_of_the_target(target):
    """Means of (w q)^2 and p^2 over draws, against one-dimensional quadrature, within four standard errors."""
    q, p = acceptance.draws(target, 4000)
    x = np.linspace(-8, 8, 4001)
    density = np.exp(-(x**2 / 2 + (x**4 / 4 if target == "quartic" else 0)))
    wanted = (x**2 * density).sum() / density.sum()
    squares = (q * 2 * np.arange(1, acceptance.D + 1)) ** 2
    assert abs(squares.mean() - wanted) < 4 * squares.std() / math.sqrt(squares.size)
    assert abs((p**2).mean() - 1) < 4 * math.sqrt(2 / p.size)
    assert (wanted < 0.6) == (target == "quartic"), "the control: a normal x has the mean 1"


def test_acceptance_by_stormer_verlet_is_that_of_a_plain_run():
    """Stormer-Verlet in NumPy from the same draws."""
    budget, n = 48, 500
    q, p = acceptance.draws("quartic", n)
    omega, h = 2.0 * np.arange(1, acceptance.D + 1), acceptance.TIME / budget

    def gradient(q):
        return omega * (omega * q + (omega * q) ** 3)

    def energy(q, p):
        return (p**2 / 2 + (omega * q) ** 2 / 2 + (omega * q) ** 4 / 4).sum(axis=1)

    x, v = q.copy(), p.copy()
    with np.errstate(all="ignore"):
        for _ in range(budget):
            v = v - h / 2 * gradient(x)
            x = x + h * v
            v = v - h / 2 * gradient(x)
        error = energy(x, v) - energy(q, p)
        accepted = np.where(np.isfinite(error), np.exp(-np.clip(error, 0, 700)), 0.0)
    found = acceptance.acceptance("quartic", acceptance.VERLET, budget, n)
    assert found["acceptance"] == pytest.approx(accepted.mean(), abs=0.01)
    assert found["low"] < found["acceptance"] < found["high"]
    assert 0.3 < accepted.mean() < 0.9, "the control: it is no trivial share"


def test_hessian_free_kicks_are_the_same_on_a_gaussian_target():
    """There gradients are linear, and a second force is exact."""
    both = [acceptance.acceptance("Gaussian", id, 48, 200)["acceptance"] for id in ("chin-4a", "hessian-free-badab")]
    assert both[0] == pytest.approx(both[1], abs=1e-12)


# -- the pages ---------------------------------------------------------------------------------------------------------


def accepted(**shares) -> pd.DataFrame:
    """Rows of both targets and all budgets; ``shares`` are acceptances by method, others accept 0.5."""
    rows = [
        {"target": t, "method": m, "budget": b, "evaluations per step": n, "h": 0.1, "acceptance": a}
        | {"low": a - 0.01, "high": a + 0.01, "failed": 0, "median energy error": 0.1}
        for t, budgets in acceptance.BUDGETS.items()
        for b in budgets
        for m, n in acceptance.EVALUATIONS.items()
        for a in [shares.get(m.replace("-", "_"), 0.5)]
    ]
    return pd.DataFrame(rows)


def test_verdicts_on_the_acceptance():
    better = {acceptance.TABLE: accepted(predescu_3=0.9)}.get
    assert [v.outcome for v in page.PAGE.judge(better)] == [PASS, PASS, PASS]
    equal = {acceptance.TABLE: accepted()}.get
    assert page.gaussian(equal).measured == Count(0, len(acceptance.BUDGETS["Gaussian"]))
    assert page.quartic(equal).outcome == FINDING
    gradients = page.gradients({acceptance.TABLE: accepted(chin_4a=0.9)}.get)
    assert gradients.outcome == FINDING
    assert gradients.measured.n == gradients.measured.of
    assert "predescu-3 rejects 10 %" in page.answer(better)


def test_verdict_on_the_time_of_an_accepted_proposal():
    def judge(**times):
        rows = [
            {"target": t, "method": m, "budget": b, "ns an accepted proposal": times.get(m.replace("-", "_"), 2.0) * b}
            for t in acceptance.TARGETS
            for m in acceptance.STAGES
            for b in (1, 2)
        ]
        return page.cheapest({cost.TABLE: pd.DataFrame(rows)}.get)

    assert judge(predescu_3=1.0).outcome == PASS
    assert judge(predescu_3=1.0).measured.high == 0.5
    assert judge(stormer_verlet=1.0).outcome == FINDING


def test_time_of_a_proposal_is_measured_with_its_acceptance(monkeypatch):
    monkeypatch.setattr(cost, "ROUNDS", 2)
    monkeypatch.setattr(cost, "EVALUATIONS", {"stormer-verlet": 1})
    monkeypatch.setattr(acceptance, "BUDGETS", {"Gaussian": (36,)})
    (row,) = cost.measure_rows("Gaussian")[cost.TABLE]
    assert row["acceptance"] == acceptance.acceptance("Gaussian", "stormer-verlet", 36)["acceptance"]
    assert row["ns an accepted proposal"] == row["ns a proposal"] / row["acceptance"] > row["ns a proposal"]


def test_verdict_on_the_printed_limits():
    rows = pd.DataFrame(
        [{"method": "a", "limit": 4.672, "printed": "4.67"}, {"method": "b", "limit": 2.0, "printed": ""}]
    )
    assert page.printed({limits.TABLE: rows}.get).outcome == PASS
    rows.loc[0, "limit"] = 4.6618
    assert page.printed({limits.TABLE: rows}.get).outcome == FINDING
    assert page.printed({limits.TABLE: rows.iloc[[1]]}.get) is None


def test_checks_of_the_rows():
    assert bench_sampling.off(accepted().to_dict("records")) == []
    assert len(bench_sampling.off(accepted(pefrl=1.5).to_dict("records"))) == 8


def test_pages_draw_and_list_their_rows(tmp_path):
    rows, stable = accepted(), pd.DataFrame([limits.measure_rows("chin-4a")[limits.TABLE][0]])
    times = rows.assign(**{"ns an accepted proposal": 1.0})
    untimed = page.table({acceptance.TABLE: rows, limits.TABLE: stable}.get).frame
    assert 0 < len(untimed) <= ROWS
    assert "ns an accepted proposal" not in untimed
    data = {acceptance.TABLE: rows, limits.TABLE: stable, cost.TABLE: times}.get
    (picture,) = page.PAGE.figures(data, tmp_path)
    assert (tmp_path / picture.file).exists()
    assert 0 < len(page.PAGE.table(data).frame) <= ROWS
