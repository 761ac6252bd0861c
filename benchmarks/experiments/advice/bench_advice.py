"""Checks of the advice: every advised command meets the requested accuracy when rerun, and refusals give a reason."""

from __future__ import annotations

from collections.abc import Callable

from phasebench.benchmarks.experiments.advice.cells import TABLE, cells  # noqa: F401


def unmet(rows: list[dict]) -> list[str]:
    """List a line for each request whose advised command misses the accuracy when rerun; ``rows``: table "advice"."""
    return [f"{r['ask']}: {r['command']}: {r['rerun error']}" for r in rows if r["command"] and not r["met"]]


def bench_advice(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that every advised command meets its accuracy when a separate process runs it.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    rows = measured_rows(TABLE)
    assert not unmet(rows), "\n".join(unmet(rows))


def bench_verified(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that advice is marked as verified, and that a request without advice has a reason.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    wrong = [r["ask"] for r in measured_rows(TABLE) if not (r["verified"] if r["command"] else r["why"])]
    assert not wrong, wrong
