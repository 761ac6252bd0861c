"""Checks: known stability limits are met, long runs confirm them, adaptive peers follow Kepler to e = `HARD`."""

from __future__ import annotations

from collections.abc import Callable

from phasebench.benchmarks.experiments.extremes import brouwer
from phasebench.benchmarks.experiments.extremes import brouwer_controls as controls
from phasebench.benchmarks.experiments.extremes.cells import cells  # noqa: F401
from phasebench.benchmarks.experiments.extremes.round_off_verdicts import ABOVE, ENERGY

#: Largest relative difference of Scheme I's stability limit from its closed form.
SHARP = 1e-10
#: Adaptive peers must keep the error small up to this eccentricity.
HARD = 0.999


def unlike(rows: list[dict]) -> list[str]:
    """List a line for each known stability limit that the measured one does not match."""
    return [
        f"{r['method']} {r['parameters']}: {r['measured']}, known {r['known limit']}" for r in rows if not r["agrees"]
    ]


def unconfirmed_limits(rows: list[dict]) -> list[str]:
    """List a line for each method with long runs that do not end (bounded or growing) as its step matrix predicts."""
    return [
        f"{r['label']}: {r['confirmed']} of {r['runs']}" for r in rows if r.get("runs") and r["confirmed"] < r["runs"]
    ]


def bench_known_limits(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that every published or derived stability limit is measured again to its digits."""
    wrong = unlike(measured_rows("extremes_published"))
    assert not wrong, "\n".join(wrong)


def bench_closed_form(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that Scheme I's measured stability limit is 2 / |1 - 2 lambda| to ten digits."""
    rows = measured_rows("extremes_scheme_i")
    off = [
        r["lam"] for r in rows if r["limit"] != r["closed form"] and not abs(r["limit"] / r["closed form"] - 1) < SHARP
    ]
    assert not off, off


def bench_long_runs(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that long runs near the limits, in later stable intervals and in gaps end as the step map predicts."""
    wrong = unconfirmed_limits(measured_rows("extremes_linear"))
    assert not wrong, "\n".join(wrong)


def bench_encounters(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that adaptive peers (of other packages) keep the error of Kepler orbits small to eccentricity `HARD`."""
    adaptive = [r for r in measured_rows("extremes_encounters") if r["kind"] == "adaptive" and r["e"] <= HARD]
    lost = [f"{r['method']}, e = {r['e']}: {r['error']:.1e}" for r in adaptive if not r["held"]]
    assert not lost, "\n".join(lost)


def bench_small_denominators(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that round-off does not make the energy drift in two kinds of runs.

    These are runs whose step or lambda is slightly off a simple fraction, and the control whose force sees the whole
    compensated state.
    """
    rows = measured_rows("extremes_growth")
    free = [r for r in rows if r["kind"] == brouwer.ASIDE_OF or r["label"] == controls.WHOLE]
    drifting = [f"{r['label']}, h = {r['h']!r}" for r in free if r["energy low"] > ENERGY + ABOVE]
    assert free or not rows
    assert not drifting, "\n".join(drifting)
