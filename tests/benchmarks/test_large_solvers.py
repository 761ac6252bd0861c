"""Solvers of implicit steps of lattices: the measured row, and each verdict passing and failing."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.experiments.large import solvers, solvers_page
from phasebench.benchmarks.page.verdict import FAIL, FINDING, MISSING, PASS, Count, Range


@pytest.mark.parametrize("step", [pytest.param("short", marks=pytest.mark.thorough), "long"])
def test_row_of_both_solvers(step, monkeypatch):
    monkeypatch.setattr(solvers, "ROUNDS", 1)
    row = solvers.row("toda", 24, step)
    assert row["by"] == (solvers.MATRIX if step == "long" else solvers.FIXED)
    assert row["solved, usual"]
    assert row["solved, banded"]
    assert row["apart"] < solvers_page.SAME
    assert row["kB, banded"] < row["kB, usual"]
    assert (row["evaluations, banded"] < row["evaluations, usual"] / 5) == (step == "long")
    assert all(row[f"ns, {who}"] > 0 for who in ("usual", "banded"))


def test_steps_lie_on_both_sides_of_contraction(monkeypatch):
    for name, steps in solvers.LATTICES.items():
        monkeypatch.setattr(solvers, "_time_columns", lambda runs, h: {})
        by = [solvers.row(name, 24, step)["by"] for step in steps._fields]
        assert by == [solvers.FIXED, solvers.MATRIX], name


def test_large_long_step_skips_full_matrices(monkeypatch):
    monkeypatch.setattr(solvers, "FULL", 23)
    monkeypatch.setattr(solvers, "_time_columns", lambda runs, h: {"timed": tuple(runs)})
    assert solvers.row("toda", 24, "long")["timed"] == ("banded",)
    assert "by" not in solvers.row("toda", 24, "long")
    assert solvers.row("toda", 24, "short")["timed"] == ("usual", "banded")


# -- the verdicts -----------------------------------------------------------------------------------------------------


def rows(power=1.0, long=0.1, short=3.0, apart=1e-15, memory=1.0, solved=True, wide=1.2):
    """Fabricated costs of one lattice at four d, the banded Newton solver beside the usual one.

    Parameters
    ----------
    power, memory : exponents in d of the banded solver's time and memory
    short, long : ratio of times, banded over usual, at a short and a long step; intervals extend by the factor ``wide``
    apart : distance of the end states of both solvers
    solved : whether the banded solver solves the steps at the largest d
    """
    out = []
    for d in (32, 128, 2048, 10_000):
        for step, times in (("short", short), ("long", long)):
            both = step == "short" or d <= 128
            row = {"system": "toda", "d": d, "step": step, "h": 0.1, "by": "x", "kB, usual": d**2.0}
            row |= {"kB, banded": d**memory, "ns, banded": 5.0 * d**power, "solved, banded": solved or d < 10_000}
            row |= {"banded / usual": times if both else np.nan, "apart": apart if both else np.nan}
            row |= {"banded / usual, low": row["banded / usual"] / wide, "banded / usual, high": times * wide}
            out.append(row)
    return pd.DataFrame(out)


def judge(verdict, table):
    """The page's verdict on a table of solver costs."""
    return verdict({solvers.TABLE: table}.get)


def test_banded_solver_must_solve_long_steps():
    found = judge(solvers_page.solves, rows())
    assert (found.measured, found.outcome) == (Count(4, 4), PASS)
    lost = judge(solvers_page.solves, rows(solved=False))
    assert (lost.measured, lost.outcome, lost.where) == (Count(3, 4), FAIL, "toda, d = 10000")
    assert judge(solvers_page.solves, rows().query("step == 'short'")).outcome == MISSING


def test_both_solvers_must_agree():
    assert judge(solvers_page.same, rows()).outcome == PASS
    other = judge(solvers_page.same, rows(apart=1e-9))
    assert (other.measured, other.outcome) == (1e-9, FAIL)
    assert judge(solvers_page.same, rows(apart=np.nan)) is None


@pytest.mark.parametrize(("ratio", "outcome"), [(0.1, PASS), (0.9, FINDING), (1.5, FINDING)])
def test_long_step_is_faster_by_its_whole_interval(ratio, outcome):
    """The verdict is on the whole interval of the ratio of times, from ratio / 1.2 to 1.2 ratio."""
    found = judge(solvers_page.faster, rows(long=ratio))
    assert found.measured == Range(ratio / 1.2, ratio * 1.2)
    assert found.outcome == outcome


def test_band_without_a_comparison_is_not_judged():
    alone = rows().assign(**{"banded / usual": np.nan})
    assert judge(solvers_page.faster, alone) is None
    assert judge(solvers_page.answer, alone) is None


@pytest.mark.parametrize(("change", "n"), [({}, 2), ({"power": 1.5}, 1), ({"memory": 2.0}, 1)])
def test_time_and_memory_may_grow_like_the_lattice(change, n):
    found = judge(solvers_page.scaling, rows(**change))
    assert (found.measured, found.outcome) == (Count(n, 2), PASS if n == 2 else FINDING)
    assert judge(solvers_page.scaling, rows().head(4)) is None


def test_fixed_point_is_kept_unless_the_band_is_faster():
    assert judge(solvers_page.where_it_contracts, rows()).measured == Count(0, 4)
    faster = judge(solvers_page.where_it_contracts, rows(short=0.5))
    assert (faster.measured, faster.outcome) == (Count(4, 4), FINDING)
    assert judge(solvers_page.where_it_contracts, rows(short=0.9)).outcome == PASS, "a tie is no finding"
    assert judge(solvers_page.where_it_contracts, rows().query("step == 'long'")).outcome == MISSING


def test_table_has_every_row_of_the_selected_sizes():
    more = pd.concat([rows(), rows().head(2).assign(d=512)])
    shown = solvers_page.table({solvers.TABLE: more}.get).frame
    assert list(shown["d"]) == list(rows()["d"])
    assert len(solvers.LATTICES) * 2 * len(solvers_page.SHOWN) <= 25
    assert set(solvers_page.SHOWN) <= set(solvers.SIZES)
