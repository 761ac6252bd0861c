"""Check of the resonances: below the stability limit of Stormer-Verlet every method completes its runs."""

from __future__ import annotations

import math

from phasebench.benchmarks.experiments.oscillatory.oscillatory import cells  # noqa: F401

#: Stormer-Verlet is stable on the linear part up to h omega = 2.
STABLE = 2.0


def off(rows) -> list[str]:
    """Messages about the runs with a step below 0.9 times the limit of Stormer-Verlet that fail."""
    return [
        f"{r['method']} at h omega / pi = {r['h omega / pi']:.3g}: {r['status']}: {r['reason']}"
        for r in rows
        if r["h omega / pi"] * math.pi < 0.9 * STABLE and r["status"] != "ok"
    ]


def bench_oscillatory(measured_rows):
    """Below the stability limit of Stormer-Verlet every method completes its run."""
    wrong = off(measured_rows("oscillatory"))
    assert not wrong, "\n".join(wrong)
