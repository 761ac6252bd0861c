"""Tables of pages on fabricated rows: exceptions of the matrix."""

from __future__ import annotations

import pandas as pd

from phasebench.benchmarks.experiments.matrix import page as matrix

# -- the matrix --------------------------------------------------------------------------------------------------------

CELL = {
    "method": "rk4", "problem": "pendulum", "declared_order": 4, "order": 4.0, "symplectic": False, "symmetric": False,
    "energy_class": "drift", "quadratic_class": "drift", "symplecticity": 1.0, "reversibility": 1.0, "energy": 1.0,
    "quadratic": 1.0, "reason": None,
}  # fmt: skip


def cells(*changes: dict):
    return {"matrix": pd.DataFrame([CELL | c for c in changes])}.get


def test_exceptions_of_a_method_share_a_line():
    short = [
        {"method": "avf", "declared_order": 2, "order": x, "problem": p} for x, p in ((1.25, "fpu"), (1.5, "kepler"))
    ]
    higher = [{"order": x, "problem": p} for x, p in ((4.5, "fpu"), (6.0, "toda"))]
    shown = matrix.table(cells(*short, *higher, {"order": 4.1}))
    assert shown.frame.to_numpy().tolist() == [
        ["avf", "fpu and kepler", "order 1.25, declared 2", "NOT EXPLAINED"],
        ["rk4", "toda and fpu", "order 6.00, declared 4", "more than declared"],
    ]
    assert shown.caption.startswith("The 2 quantities that fall short, then the 2 orders above")
    assert matrix.table(cells({})) is None


def test_unexplained_cells_come_first():
    known = {"method": "gauss-equip-2", "energy_class": "round-off", "energy": 1e-9, "fallbacks": 2}
    open_ = {"method": "avf", "declared_order": 2, "order": 1.0}
    shown = matrix.table(cells(known, open_)).frame
    assert shown["method"].tolist() == ["avf", "gauss-equip-2"]


def test_full_table_has_every_pair_on_small_problems():
    pairs = [{"problem": "kepler"}, {"problem": "fpu"}, {"reason": "requires: separable"}, {"method": "avf"}]
    whole = matrix.PAGE.whole(cells(*pairs))
    assert whole[["method", "problem", "declared"]].to_numpy().tolist() == [
        ["rk4", "kepler", 4],
        ["avf", "pendulum", 4],
    ]
