"""What is advised was run and meets what was asked when run again; the prior is re-recorded from the trade's rows."""

from __future__ import annotations

from phasebench.benchmarks.experiments.advice.cells import TABLE, cells  # noqa: F401


def unmet(rows) -> list[str]:
    """The asks whose advice does not meet the accuracy when it is run again."""
    return [f"{r['ask']}: {r['command']}: {r['rerun error']}" for r in rows if r["command"] and not r["met"]]


def bench_advice(measured):
    """Every advised command meets its accuracy, run again by a process of its own."""
    rows = measured(TABLE)
    assert not unmet(rows), "\n".join(unmet(rows))


def bench_verified(measured):
    """What is advised was verified, and what is not advised says why."""
    wrong = [r["ask"] for r in measured(TABLE) if not (r["verified"] if r["command"] else r["why"])]
    assert not wrong, wrong
