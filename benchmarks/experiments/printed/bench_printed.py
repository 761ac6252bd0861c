"""The talk's printed tables, entry by entry, and the column that does not reproduce."""

from __future__ import annotations

from itertools import groupby

from phasebench.benchmarks.experiments.printed import printed, riddle
from phasebench.benchmarks.measure import metrics

#: How far the root of Scheme IV may be from 1/2.
NEAR = 0.1


def cells(quick: bool = False):
    """The printed columns and the scans."""
    return [*printed.cells(quick), *riddle.cells(quick)]


def off(rows) -> list[str]:
    """Entries that differ by more than 0.6 of the last printed digit; Scheme IV where it is not of second order."""
    out = []
    for column, members in groupby(rows, lambda r: (r["scheme"], r["lambda"] or None)):
        members = list(members)
        if column == printed.RIDDLE:
            slope = metrics.power(*([r[c] for r in members] for c in ("h", "refinement_difference"))).value
            out += [f"Scheme IV on the root nearest 1/2 has order {slope:.3f}"] if abs(slope - 2) >= 0.15 else []
            continue
        out += [
            f"{column}, h = {r['h']}: printed {r['printed']}, measured {r['refinement_difference']:.5E}"
            for r in members
            if not r["units"] <= printed.AGREEMENT
        ]
    return out


def lost(rows) -> list[str]:
    """Steps of Scheme IV that lost their root near 1/2, by the summary of a scan."""
    ends = ("nearest root, least", "nearest root, greatest")
    return [
        f"h = {r['h']}: a step lost its root near 1/2"
        for r in rows
        if r["without a root"] or any(not abs(r[c] - 0.5) < NEAR for c in ends)
    ]


def bench_printed(measured):
    """Every entry agrees to 0.6 of the last printed digit; Scheme IV is second order, as its theorem says."""
    wrong = off(measured("printed"))
    assert not wrong, "\n".join(wrong)


def bench_riddle(measured):
    """No branch of roots gives the printed Scheme IV column: every root of every step, by exhaustive scan."""
    wrong = lost(measured("riddle"))
    assert not wrong, "\n".join(wrong)
