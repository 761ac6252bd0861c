"""The Fermi-Pasta-Ulam problem over h omega: where each integrator for a fast linear part resonates."""

from __future__ import annotations

import math

from phasebench.benchmarks.experiments.oscillatory.oscillatory import cells  # noqa: F401

#: Stormer-Verlet is stable on the linear part up to h omega = 2.
STABLE = 2.0


def off(rows) -> list[str]:
    """The rows below the limit of Stormer-Verlet that do not get through."""
    return [
        f"{r['method']} at h omega / pi = {r['h omega / pi']:.3g}: {r['status']}: {r['reason']}"
        for r in rows
        if r["h omega / pi"] * math.pi < 0.9 * STABLE and r["status"] != "ok"
    ]


def bench_oscillatory(measured):
    """Below the limit of Stormer-Verlet every method gets through."""
    wrong = off(measured("oscillatory"))
    assert not wrong, "\n".join(wrong)
