"""Checks of stability limits, long runs that confirm them, round-off, and Kepler orbits of eccentricity to `HARD`."""

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
    """Return a message for each known stability limit of h omega that the measured one does not match.

    ``rows`` are those of the table of known limits, each with its measured value.
    """
    return [
        f"{r['method']} {r['parameters']}: {r['measured']}, known {r['known limit']}" for r in rows if not r["agrees"]
    ]


def unconfirmed_limits(rows: list[dict]) -> list[str]:
    """Return a message for each method with long runs that do not end (bounded or growing) as its step matrix predicts.

    ``rows`` are those of the table of stability, one for each method and its parameters.
    """
    return [
        f"{r['label']}: {r['confirmed']} of {r['runs']}" for r in rows if r.get("runs") and r["confirmed"] < r["runs"]
    ]


def bench_known_limits(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that every measured stability limit equals the published or derived one to all known digits of the latter.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    wrong = unlike(measured_rows("extremes_published"))
    assert not wrong, "\n".join(wrong)


def bench_closed_form(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that the measured stability limit h omega of Scheme I is 2 / |1 - 2 lambda| to ten digits.

    Scheme I is symplectic Euler for lambda = 0 or 1, the midpoint rule for 1/2.
    ``measured_rows`` is a fixture: table name -> rows.
    """
    rows = measured_rows("extremes_scheme_i")
    off = [
        r["lam"] for r in rows if r["limit"] != r["closed form"] and not abs(r["limit"] / r["closed form"] - 1) < SHARP
    ]
    assert not off, off


def bench_long_runs(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that long runs stay bounded or grow as their step matrix predicts, near the stability limits and beyond.

    Beyond a limit are further stable intervals of h omega, and the gaps between them.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    wrong = unconfirmed_limits(measured_rows("extremes_linear"))
    assert not wrong, "\n".join(wrong)


def bench_encounters(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that adaptive integrators of other packages keep the error of Kepler orbits small to eccentricity `HARD`.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    adaptive = [r for r in measured_rows("extremes_encounters") if r["kind"] == "adaptive" and r["e"] <= HARD]
    lost = [f"{r['method']}, e = {r['e']}: {r['error']:.1e}" for r in adaptive if not r["held"]]
    assert not lost, "\n".join(lost)


def bench_small_denominators(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that round-off does not make the energy of the oscillator drift in two kinds of runs.

    In runs of the first kind the step h, or the method's parameter lambda, is slightly off a simple fraction such as
    1/100 or 1/3.  The second kind is a leapfrog with compensated sums whose force also sees the sums' lost parts.
    ``measured_rows`` is a fixture: table name -> rows.
    """
    rows = measured_rows("extremes_growth")
    free = [r for r in rows if r["kind"] == brouwer.ASIDE_OF or r["label"] == controls.WHOLE]
    drifting = [f"{r['label']}, h = {r['h']!r}" for r in free if r["energy low"] > ENERGY + ABOVE]
    assert free or not rows
    assert not drifting, "\n".join(drifting)
