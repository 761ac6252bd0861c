"""Check of the runs on a highly oscillatory system: below the stability limit of Stormer-Verlet all are completed."""

from __future__ import annotations

import math
from collections.abc import Callable

from phasebench.benchmarks.experiments.oscillatory.oscillatory import cells  # noqa: F401

#: Stormer-Verlet is stable on the linear part up to h omega = 2.
STABLE = 2.0


def off(rows: list[dict]) -> list[str]:
    """Return messages about the failed runs with a step below 0.9 times the stability limit of Stormer-Verlet.

    ``rows`` are those of the table "oscillatory", one for each method and step size.
    """
    return [
        f"{r['method']} at h omega / pi = {r['h omega / pi']:.3g}: {r['status']}: {r['reason']}"
        for r in rows
        if r["h omega / pi"] * math.pi < 0.9 * STABLE and r["status"] != "ok"
    ]


def bench_oscillatory(measured_rows: Callable[[str], list[dict]]) -> None:
    """Test that below the stability limit of Stormer-Verlet every method completes its run.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    wrong = off(measured_rows("oscillatory"))
    assert not wrong, "\n".join(wrong)
