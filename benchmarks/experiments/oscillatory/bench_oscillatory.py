"""The Fermi-Pasta-Ulam problem over h omega: where each integrator for a fast linear part resonates."""

from __future__ import annotations

import math

import pytest

from phasebench.benchmarks.experiments.oscillatory import oscillatory

PARTS, QUICK_PARTS = 40, 4
#: Stormer-Verlet is stable on the linear part up to h omega = 2.
STABLE = 2.0


@pytest.mark.parametrize("chosen", oscillatory.compared(), ids=lambda m: m.id)
def bench_oscillatory(chosen, results, quick):
    """The errors of H and I; below the limit of Stormer-Verlet every method gets through."""
    ratios = oscillatory.multiples(QUICK_PARTS if quick else PARTS)
    frame = oscillatory.errors([chosen], ratios)
    results.add("oscillatory", frame.to_dict("records"))
    small = frame[frame["h omega / pi"] * math.pi < 0.9 * STABLE]
    assert (small["status"] == "ok").all(), small[["h omega / pi", "status", "reason"]]
