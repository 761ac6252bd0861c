"""The page on wave equations: its verdicts on fabricated rows, passing and failing, and its table."""

from __future__ import annotations

import pandas as pd

from phasebench.benchmarks.experiments.waves import page
from phasebench.benchmarks.page.verdict import FAIL, FINDING, MISSING, PASS, Count
from support.pages import judge


def run(method: str, **values) -> dict:
    row = {"problem": "nls", "method": method, "h": 0.1, "status": "ok", "seconds": 1.0, "fallbacks": 0}
    row |= {"energy class": "round-off", "energy is kept": 1, "energy error": 1e-15}
    row |= {"quadratic class": "none", "invariant": "mass", "invariant is kept": 0, "invariant error": 1e-5}
    return row | {"evaluations per step": 3.0} | values


LOOSE = {"energy class": "bounded", "energy is kept": 0}


def test_methods_declared_energy_preserving_are_judged():
    rows = (run("avf"), run("dg"), run("rk4", **LOOSE), run("leapfrog", **LOOSE))
    good = judge(page.energy, "pde", *rows, run("died", status="diverged", **{"energy is kept": 0}))
    assert (good.measured, good.outcome, good.where) == (Count(2, 2), PASS, "")
    bad = judge(page.energy, "pde", *rows, run("broken", **{"energy is kept": 0, "energy error": 1e-4}))
    assert (bad.measured, bad.outcome, bad.where) == (Count(2, 3), FAIL, "broken")
    assert judge(page.energy, "pde", run("died", status="diverged")).outcome == MISSING
    lucky = run("lucky", **{"energy class": "bounded"})
    assert judge(page.energy, "pde", run("broken", **{"energy is kept": 0}), lucky).measured == Count(0, 1)


def test_charge_is_judged_and_mass_is_not():
    charge = {"invariant": "charge", "quadratic class": "round-off"}
    mass = run("y", **{"quadratic class": "round-off"})
    good = judge(page.charge, "pde", run("midpoint", **charge, **{"invariant is kept": 1}), run("x"))
    assert (good.measured, good.outcome) == (Count(1, 1), PASS)
    bad = judge(page.charge, "pde", run("midpoint", **charge), mass)
    assert (bad.measured, bad.outcome, bad.where) == (Count(0, 1), FAIL, "midpoint")
    assert judge(page.charge, "pde", mass).outcome == MISSING


def test_steps_without_a_root_are_counted():
    good = judge(page.roots, "pde", run("a"), run("b"))
    assert (good.measured, good.outcome, good.where) == (0, PASS, "")
    bad = judge(
        page.roots, "pde", run("a"), run("b", fallbacks=1), run("c", fallbacks=3), run("d", status="x", fallbacks=9)
    )
    assert (bad.measured, bad.outcome) == (4, FINDING)
    assert bad.where == "c on nls, h = 0.1"
    assert judge(page.roots, "pde", run("a", status="diverged")) is None


def test_table_has_the_smaller_step_of_each_method():
    rows = [run("b", h=0.1), run("b", h=0.05), run("a", h=0.05), run("a", h=0.1), run("b", h=0.1, problem="kg")]
    shown = page.table({"pde": pd.DataFrame(rows)}.get).frame
    assert list(zip(shown["problem"], shown["method"], shown["h"], strict=True)) == [
        ("nls", "b", 0.05),
        ("nls", "a", 0.05),
        ("kg", "b", 0.1),
    ]
    assert list(shown.columns) == list(page.COLUMNS.values())
    whole = page._full_table({"pde": pd.DataFrame(rows)}.get)
    assert (len(whole), list(whole.columns)) == (5, list(page.COLUMNS.values()))
    many = pd.DataFrame([run(f"m{k}") for k in range(page.ROWS + 5)])
    assert page.table({"pde": many}.get).frame["method"].iloc[0] == "m0"
    assert len(page.table({"pde": many}.get).frame) == page.ROWS
