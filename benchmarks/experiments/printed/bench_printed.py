"""Checks of the error tables printed in a talk, entry by entry, and of the one column that is not reproduced."""

from __future__ import annotations

from collections.abc import Callable
from itertools import groupby
from typing import TYPE_CHECKING

from phasebench.benchmarks.experiments.printed import printed, recipes
from phasebench.benchmarks.measure import metrics

if TYPE_CHECKING:
    from phasebench.benchmarks.store.cells import Cell

#: Largest distance of Scheme IV's root from 1/2.
NEAR = 0.1


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`), one for each printed column of the talk's tables.

    Unless ``quick``, also those on Scheme IV, whose column is not reproduced: scans for the roots of its energy
    equation, and other computations that might explain the column.
    """
    return [*printed.cells(quick), *recipes.cells(quick)]


def off(rows: list[dict]) -> list[str]:
    """Return messages about printed entries from which the measured ones differ by more than 0.6 of the last digit.

    The printed column of Scheme IV (which chooses a parameter in each step to keep H) is known not to be reproduced:
    there is a message if its measured order is not 2.  ``rows`` are dicts of the table "printed".
    """
    out = []
    for column, members in groupby(rows, lambda r: (r["scheme"], r["lambda"] or None)):
        members = list(members)
        if column == printed.SCHEME_IV:
            slope = metrics.power(*([r[c] for r in members] for c in ("h", "refinement_difference"))).value
            out += [f"Scheme IV on the root nearest 1/2 has order {slope:.3f}"] if abs(slope - 2) >= 0.15 else []
            continue
        out += [
            f"{column}, h = {r['h']}: printed {r['printed']}, measured {r['refinement_difference']:.5E}"
            for r in members
            if not r["units"] <= printed.AGREEMENT
        ]
    return out


def scans_without_root(rows: list[dict]) -> list[str]:
    """Return messages about the scans in which some step of Scheme IV has no root lambda within `NEAR` of 1/2.

    Scheme IV chooses a parameter lambda in each step so that H is kept.  ``rows`` are those of the table of scans for
    such roots, one for each step size h.
    """
    ends = ("nearest root, least", "nearest root, greatest")
    return [
        f"h = {r['h']}: a step lost its root near 1/2"
        for r in rows
        if r["without a root"] or any(not abs(r[c] - 0.5) < NEAR for c in ends)
    ]


def bench_printed(measured_rows: Callable[[str], list[dict]]) -> None:
    """Test that every printed entry agrees with the measured one to 0.6 of the last digit, except for Scheme IV.

    Scheme IV chooses a parameter lambda in each step so that H is kept.  Its measured order must be 2, as its theorem
    says.  ``measured_rows`` is a fixture: table name -> rows.
    """
    wrong = off(measured_rows("printed"))
    assert not wrong, "\n".join(wrong)


def bench_root_scan(measured_rows: Callable[[str], list[dict]]) -> None:
    """Test that an exhaustive scan of lambda finds a root near 1/2 in every step of Scheme IV.

    Scheme IV chooses a parameter lambda in each step so that H is kept.  ``measured_rows`` is a fixture: table name ->
    rows.
    """
    wrong = scans_without_root(measured_rows("riddle"))
    assert not wrong, "\n".join(wrong)
