"""Wisdom-Holman splittings beside REBOUND's: the same splitting gives the same states, as far as round-off lets it."""

from __future__ import annotations

from phasebench.benchmarks.experiments.wisdom_holman import pairs, rivals

#: Early positions further apart than this are of another splitting.
APART = 1e-8


def cells(quick: bool = False):
    """The pairs, and all together."""
    return [*pairs.cells(quick), *rivals.cells(quick)]


def off(rows) -> list[str]:
    """The pairs that part early."""
    return [
        f"{r['method']} on {r['problem']}, h = {r['h']}: {r['distance of early positions']:.1e} from REBOUND's"
        for r in rows
        if not r["distance of early positions"] < APART
    ]


def bench_wisdom_holman(measured):
    """The same splitting gives the same states, and so the same energy error."""
    wrong = off(measured("wisdom_holman"))
    assert not wrong, "\n".join(wrong)


def bench_rivals(measured):
    """Whoever ran has a cost."""
    ran = [r for r in measured(rivals.TABLE) if r["status"] == "ok"]
    wrong = [r for r in ran if not 0 < r["ns, low"] <= r["ns a unit of time"] <= r["ns, high"]]
    assert not wrong, wrong
