"""The page of wave equations, both ways: who keeps what, what the others lose, steps without a root, the table."""

from __future__ import annotations

import pandas as pd

from phasebench.benchmarks.experiments.waves import page


def run(method: str, **values) -> dict:
    row = {"problem": "nls", "method": method, "h": 0.1, "status": "ok", "seconds": 1.0, "fallbacks": 0}
    row |= {"energy class": "round-off", "energy is kept": 1, "energy error": 1e-15}
    row |= {"quadratic class": "none", "invariant": "mass", "invariant is kept": 0, "invariant error": 1e-5}
    return row | {"evaluations per step": 3.0} | values


def judged(verdict, *rows):
    return verdict({"pde": pd.DataFrame(rows)}.get)


LOOSE = {"energy class": "bounded", "energy is kept": 0}


def test_who_declares_the_energy_keeps_it():
    rows = (
        run("avf", **{"energy error": 3e-15}),
        run("dg"),
        run("rk4", **LOOSE, **{"energy error": 2e-3}),
        run("leapfrog", **LOOSE, **{"energy error": 4e-6}),
    )
    good = judged(page.energy, *rows, run("died", status="diverged", **{"energy is kept": 0}))
    assert good.holds
    assert "is kept to round-off in 2 of 2 runs whose method declares it (at most 3.00e-15)" in good.text
    assert good.text.endswith("; the other methods' error is at least 4.00e-06.")
    assert good.short.endswith("kept in 2 of 2 runs that declare it.")
    bad = judged(page.energy, *rows, run("broken", **{"energy is kept": 0, "energy error": 1e-4}))
    assert not bad.holds
    assert "in 2 of 3 runs whose method declares it (at most 3.00e-15), not by broken;" in bad.text
    assert judged(page.energy, run("died", status="diverged")) is None
    alone = judged(page.energy, run("broken", **{"energy is kept": 0}), run("lucky", **{"energy class": "bounded"}))
    assert alone.text.endswith("in 0 of 1 runs whose method declares it, not by broken."), "luck is none of the others"


def test_the_charge_is_judged_and_the_mass_is_not():
    charge = {"invariant": "charge", "quadratic class": "round-off"}
    good = judged(
        page.charge, run("midpoint", **charge, **{"invariant is kept": 1, "invariant error": 1e-14}), run("x")
    )
    assert good.holds
    assert "charge, of the form q·Dp, is kept to round-off in 1 of 1 runs" in good.text
    bad = judged(page.charge, run("midpoint", **charge), run("y", **{"quadratic class": "round-off"}))
    assert not bad.holds
    assert bad.text.endswith("not by midpoint.")
    assert judged(page.charge, run("x", **{"quadratic class": "round-off"})) is None


def test_steps_without_a_root_are_counted():
    good = judged(page.roots, run("a"), run("b"))
    assert good.holds
    assert good.text == "No step of any run is without a root."
    bad = judged(page.roots, run("a"), run("b", fallbacks=1), run("c", fallbacks=3), run("d", status="x", fallbacks=9))
    assert not bad.holds
    assert "b on nls at h = 0.1: 1" in bad.text
    assert "c on nls at h = 0.1: 3" in bad.text
    assert "a on" not in bad.text
    assert bad.short.startswith("4 steps have no root")
    assert judged(page.roots, run("a", status="diverged")) is None


def test_the_table_has_the_smaller_step_of_each_in_the_order_of_the_rows():
    rows = [run("b", h=0.1), run("b", h=0.05), run("a", h=0.05), run("a", h=0.1), run("b", h=0.1, problem="kg")]
    shown = page.table({"pde": pd.DataFrame(rows)}.get).frame
    assert list(zip(shown["problem"], shown["method"], shown["h"], strict=True)) == [
        ("nls", "b", 0.05),
        ("nls", "a", 0.05),
        ("kg", "b", 0.1),
    ]
    assert list(shown.columns) == list(page.COLUMNS.values())
    whole = page._whole({"pde": pd.DataFrame(rows)}.get)
    assert (len(whole), list(whole.columns)) == (5, list(page.COLUMNS.values()))
    many = pd.DataFrame([run(f"m{k}") for k in range(page.ROWS + 5)])
    assert page.table({"pde": many}.get).frame["method"].iloc[0] == "m0"
    assert len(page.table({"pde": many}.get).frame) == page.ROWS
