"""The first result, cold and warm: it comes."""

from __future__ import annotations

from phasebench.benchmarks.experiments.start import start
from phasebench.benchmarks.experiments.start.start import cells  # noqa: F401


def bench_cold(measured):
    """Every first integration arrives, and took time; whether it is short is the page's verdict."""
    wrong = [
        f"{r['method']} on {r['problem']}: {r['status']}, {r['seconds']} s"
        for r in measured(start.COLD)
        if r["status"] != "ok" or not r["seconds"] > 0
    ]
    assert not wrong, "\n".join(wrong)


def bench_warm(measured):
    """No command takes less than the import of Numba, which it needs."""
    seconds = {r["what"]: r["seconds"] for r in measured(start.WARM)}
    wrong = [f"{what}: {s} s" for what, s in seconds.items() if what != start.FLOOR and not s > seconds[start.FLOOR]]
    assert not wrong, "\n".join(wrong)
