"""Checks of the printed numbers: this suite's own rows are sound, and the controls are told apart."""

from __future__ import annotations

from phasebench.benchmarks.experiments.printed_numbers import brouwer, minimum_norm, planets, timed

#: Largest distance of <exp(-Delta H)> from 1: the quadrature's error.
RULE = 1e-3
#: Smallest exponent of a run whose truncation error dominates.
LINEAR = 0.9


def cells(quick: bool = False):
    """List the measurements (`Cell`) of all printed numbers; none if ``quick``."""
    return [cell for part in (planets, minimum_norm, brouwer, timed) for cell in part.cells(quick)]


def rules_off(rows) -> list[str]:
    """Messages about averages whose rule is not accurate."""
    return [f"{r['potential']}, {r['method']}, h = {r['h']}: {r['off']:.1e}" for r in rows if not abs(r["off"]) < RULE]


def exponents_off(rows) -> list[str]:
    """Messages about the control, unless its error grows linearly, and about runs of round-off that grow as it does."""
    return [
        f"{r['integrator']}: {r['exponent']:.2f}"
        for r in rows
        if (r["tolerance"] == brouwer.CONTROL[1]) != (r["exponent"] > LINEAR)
    ]


def rates_off(rows) -> list[str]:
    """Messages about rates of perihelia whose uncertainty is not far below the error of plain WHFast."""
    plain = {r["planet"]: abs(r["rate error"]) for r in rows if r["method"] == planets.PLAIN}
    return [
        f"{r['planet']}: {r['uncertainty']:.1e}"
        for r in rows
        if not r["uncertainty"] < 1e-2 * plain.get(r["planet"], 0.0)
    ]


def bench_averages(measured_rows):
    """The rule for averages gives <exp(-Delta H)> = 1."""
    off = rules_off(measured_rows(minimum_norm.TABLE))
    assert not off, "\n".join(off)


def bench_brouwer(measured_rows):
    """Round-off grows slower than the control's truncation error, which grows linearly."""
    off = exponents_off(measured_rows(brouwer.TABLE))
    assert not off, "\n".join(off)


def bench_perihelia(measured_rows):
    """The rates of the perihelia are known far better than plain WHFast has them."""
    off = rates_off(measured_rows(planets.PERIHELIA))
    assert not off, "\n".join(off)


def bench_timed(measured_rows):
    """Every gain lies in its interval."""
    wrong = [r for r in measured_rows(timed.VECTORS) if not 0 < r["low"] <= r["gain"] <= r["high"]]
    assert not wrong, wrong
