"""How implicit steps of lattices are solved: what is measured, and each sentence both ways."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.experiments.large import solvers, solvers_page


@pytest.mark.parametrize("step", ["short", "long"])
def test_a_row_says_what_was_solved_by_what(step, monkeypatch):
    monkeypatch.setattr(solvers, "ROUNDS", 1)
    row = solvers.row("toda", 24, step)
    assert row["by"] == (solvers.MATRIX if step == "long" else solvers.FIXED)
    assert row["solved, usual"]
    assert row["solved, banded"]
    assert row["apart"] < solvers_page.SAME
    assert row["kB, banded"] < row["kB, usual"]
    assert (row["evaluations, banded"] < row["evaluations, usual"] / 5) == (step == "long")
    assert all(row[f"ns, {who}"] > 0 for who in ("usual", "banded"))


def test_steps_on_either_side_of_the_fixed_point_are_on_either_side_of_it(monkeypatch):
    for name, steps in solvers.LATTICES.items():
        monkeypatch.setattr(solvers, "_timed", lambda runs, h: {})
        by = [solvers.row(name, 24, step)["by"] for step in steps._fields]
        assert by == [solvers.FIXED, solvers.MATRIX], name


def test_a_long_step_of_many_is_not_taken_by_full_matrices(monkeypatch):
    monkeypatch.setattr(solvers, "FULL", 23)
    monkeypatch.setattr(solvers, "_timed", lambda runs, h: {"timed": tuple(runs)})
    assert solvers.row("toda", 24, "long")["timed"] == ("banded",)
    assert "by" not in solvers.row("toda", 24, "long")
    assert solvers.row("toda", 24, "short")["timed"] == ("usual", "banded")


# -- the sentences -----------------------------------------------------------------------------------------------------


def rows(power=1.0, long=0.1, short=3.0, apart=1e-15, memory=1.0, solved=True, wide=1.2):
    """A table of one lattice; ``wide`` is how far intervals of ratios reach."""
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


def said(verdict, table):
    return verdict({solvers.TABLE: table}.get)


def test_what_the_band_solves_and_for_how_much_less_is_told():
    found = said(solvers_page.solves, rows())
    assert found.holds
    assert "to d = 10000; it takes 0.1 (toda, d = 32) to 0.1" in found.text
    assert "to 1.0e-15 of the state" in found.text
    lost = said(solvers_page.solves, rows(solved=False))
    assert not lost.holds
    assert "does not solve the long steps of toda, d = 10000." in lost.text
    assert not said(solvers_page.solves, rows(apart=1e-9)).holds, "another solution"
    assert not said(solvers_page.solves, rows(long=1.5)).holds, "slower than full matrices"
    assert not said(solvers_page.solves, rows(long=0.9)).holds, "an interval that reaches beyond 1"
    alone = rows().assign(**{"banded / usual": np.nan})
    assert "nothing is beside it" in said(solvers_page.solves, alone).text
    assert said(solvers_page.solves, rows().query("step == 'short'")) is None


def test_a_cost_that_grows_as_the_lattice_and_a_steeper_one():
    found = said(solvers_page.scaling, rows())
    assert found.holds
    assert "toda 1.00 [1.00, 1.00], its memory d to 1.00 at most (full matrices: 2.00)" in found.text
    steep = said(solvers_page.scaling, rows(power=1.5))
    assert not steep.holds
    assert "steeper than the lattice is long: toda" in steep.text
    assert not said(solvers_page.scaling, rows(memory=2.0)).holds
    assert said(solvers_page.scaling, rows().head(4)) is None


def test_where_the_fixed_point_contracts_it_is_advised_unless_the_band_is_faster():
    usual = said(solvers_page.where_it_contracts, rows())
    assert usual.holds
    assert "3 (toda, d = 32) to 3" in usual.text
    assert "leave the solver out" in usual.text
    faster = said(solvers_page.where_it_contracts, rows(short=0.5))
    assert not faster.holds
    assert "the faster one at toda, d = 32; toda, d = 128" in faster.text
    assert said(solvers_page.where_it_contracts, rows(short=0.9)).holds, "a tie is no finding"
    assert said(solvers_page.where_it_contracts, rows().query("step == 'long'")) is None


def test_the_table_has_every_row_that_is_shown():
    shown = solvers_page.table({solvers.TABLE: rows()}.get).frame
    assert len(shown) == 8
    assert len(solvers.LATTICES) * 2 * len(solvers_page.SHOWN) <= 25
    assert set(solvers_page.SHOWN) <= set(solvers.SIZES)
