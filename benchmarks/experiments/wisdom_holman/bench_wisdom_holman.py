"""Checks of the Wisdom-Holman splittings: the same splitting as REBOUND's gives the same states up to round-off."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from phasebench.benchmarks.experiments.wisdom_holman import pairs, rivals

if TYPE_CHECKING:
    from phasebench.benchmarks.store.cells import Cell

#: Largest distance of early positions that counts as the same splitting.
APART = 1e-8


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`); none if ``quick``.

    First those of pairs, a method of ours and REBOUND's integrator with the same splitting; then those that compare all
    splittings of both sides.
    """
    return [*pairs.cells(quick), *rivals.cells(quick)]


def off(rows: list[dict]) -> list[str]:
    """Return a message for each splitting whose early positions differ from REBOUND's by `APART` or more.

    ``rows`` are those of the table "wisdom_holman", one for each splitting and step, run by this project and by
    REBOUND.
    """
    return [
        f"{r['method']} on {r['problem']}, h = {r['h']}: {r['distance of early positions']:.1e} from REBOUND's"
        for r in rows
        if not r["distance of early positions"] < APART
    ]


def bench_wisdom_holman(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that every splitting gives the same early positions, up to round-off, as the same one in REBOUND.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    wrong = off(measured_rows("wisdom_holman"))
    assert not wrong, "\n".join(wrong)


def bench_rivals(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that every Wisdom-Holman splitting that ran has a positive cost, within its own confidence interval.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    ran = [r for r in measured_rows(rivals.TABLE) if r["status"] == "ok"]
    wrong = [r for r in ran if not 0 < r["ns, low"] <= r["ns a unit of time"] <= r["ns, high"]]
    assert not wrong, wrong
