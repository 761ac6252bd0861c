"""Wisdom-Holman splittings beside REBOUND's: the same splitting gives the same states, as far as round-off lets it."""

from __future__ import annotations

from phasebench.benchmarks.experiments.wisdom_holman.pairs import cells  # noqa: F401

#: Early positions further apart than this are of another splitting.
APART = 1e-8


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
