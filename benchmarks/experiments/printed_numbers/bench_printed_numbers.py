"""Checks that the measurements of numbers printed in papers are sound.

Checked are the quadrature rule of averages, the growth of energy errors with time (linear in a control run), the
uncertainty of perihelion rates, and the interval of a speed-up.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from phasebench.benchmarks.experiments.printed_numbers import brouwer, minimum_norm, planets, timed

if TYPE_CHECKING:
    from phasebench.benchmarks.store.cells import Cell

#: Largest distance of <exp(-Delta H)> from 1: the quadrature's error.
RULE = 1e-3
#: Smallest exponent of a run whose truncation error dominates.
LINEAR = 0.9


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`) for all printed numbers; none if ``quick``."""
    return [cell for part in (planets, minimum_norm, brouwer, timed) for cell in part.cells(quick)]


def rules_off(rows: list[dict]) -> list[str]:
    """Return messages about averages over exp(-H) whose quadrature rule is not accurate.

    ``rows`` are those of `minimum_norm`, with ``off``, the distance of <exp(-Delta H)> from 1.
    """
    return [f"{r['potential']}, {r['method']}, h = {r['h']}: {r['off']:.1e}" for r in rows if not abs(r["off"]) < RULE]


def exponents_off(rows: list[dict]) -> list[str]:
    """Return messages about rows of `brouwer` whose energy error grows with an unexpected power of time.

    The power must be above `LINEAR` for the control, a run whose truncation error dominates, and must not be above it
    for the other runs, in which round-off dominates.
    """
    return [
        f"{r['integrator']}: {r['exponent']:.2f}"
        for r in rows
        if (r["tolerance"] == brouwer.CONTROL[1]) != (r["exponent"] > LINEAR)
    ]


def rates_off(rows: list[dict]) -> list[str]:
    """Return messages about rates of perihelia whose uncertainty is not far below the error of plain WHFast.

    ``rows`` are those of the table of perihelia, one for each integrator and planet.
    """
    plain = {r["planet"]: abs(r["rate error"]) for r in rows if r["method"] == planets.PLAIN}
    return [
        f"{r['planet']}: {r['uncertainty']:.1e}"
        for r in rows
        if not r["uncertainty"] < 1e-2 * plain.get(r["planet"], 0.0)
    ]


def bench_averages(measured_rows: Callable[[str], list[dict]]) -> None:
    """Test that the quadrature rule for averages gives <exp(-Delta H)> = 1.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    off = rules_off(measured_rows(minimum_norm.TABLE))
    assert not off, "\n".join(off)


def bench_brouwer(measured_rows: Callable[[str], list[dict]]) -> None:
    """Test that round-off grows slower than the truncation error of the control, which grows linearly.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    off = exponents_off(measured_rows(brouwer.TABLE))
    assert not off, "\n".join(off)


def bench_perihelia(measured_rows: Callable[[str], list[dict]]) -> None:
    """Test that the rates of the perihelia are known far better than plain WHFast computes them.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    off = rates_off(measured_rows(planets.PERIHELIA))
    assert not off, "\n".join(off)


def bench_timed(measured_rows: Callable[[str], list[dict]]) -> None:
    """Test that the speed-up of WHFast512 over WHFast lies in its interval, in every row.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    wrong = [r for r in measured_rows(timed.VECTORS) if not 0 < r["low"] <= r["gain"] <= r["high"]]
    assert not wrong, wrong
