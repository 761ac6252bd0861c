"""Gradient evaluations and time of an integrator, relative to those of the cheapest stored one at the same error."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from phasebench.benchmarks.judge.evidence import Tables

from .times import REFERENCE, WIDE

#: What a cell says if no run was accurate enough, and if runs that should be equal took too different times.
NOT_MET, VARIES = "not met", "varies"


def cost_rows(tables: Tables, times: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return an integrator's costs over those of the cheapest stored one: a row per scene (problem and span) and error.

    ``times`` are rows of `times.times_row`.  A cost is None if the error is not met, or no time was measured;
    ``varies`` is True where the measured times do so by more than the factor `times.WIDE`.
    """
    timed = {t["on"]: t["errors"] for t in times if t["errors"]}
    rows = []
    for place in tables.of("place"):
        errors = timed.get(place["on"], [])
        factors = {e["error"]: e["factor"] for e in errors}
        varies = any(e["high"] > WIDE * e["low"] for e in errors[:1])
        for e in place["errors"]:
            time = None if varies else factors.get(e["error"])
            row = {"scene": place["on"], "error": e["error"], "evaluations": e["factor"], "time": time}
            rows.append(row | {"varies": varies and e["error"] in factors})
    return rows


def format_costs(tables: Tables, times: Iterable[Mapping[str, Any]]) -> list[str]:
    """Format `cost_rows` as lines of text; those of a scene end at the first error that is not met."""
    times = list(times)
    rows = _until_not_met(cost_rows(tables, times))
    if not rows:
        return []
    wide = max(len(r["scene"]) for r in rows)
    lines = ["gradient evaluations and time, relative to the cheapest stored integrator at the same error:"]
    lines.append(f"  {'scene':{wide}}  error  evaluations  time".rstrip())
    for r in rows:
        time = VARIES if r["varies"] else "" if r["time"] is None else f"{count(r['time'])} times"
        evaluations = NOT_MET if r["evaluations"] is None else f"{r['evaluations']:.2g} times"
        lines.append(f"  {r['scene']:{wide}}  {r['error']:.0e}  {evaluations:11}  {time}".rstrip())
    if any(r["time"] is not None for r in rows):
        lines.append(f"time is known to a factor of 2, by way of {REFERENCE}, timed here and when the others were")
    prices = {t["on"]: t["python"] for t in times if t["python"] is not None and t["errors"]}
    for on, price in prices.items():
        if price["high"] > WIDE * price["low"]:
            lines.append(f"time on {on} includes Python's calls")
        else:
            cost = f"{count(price['value'])} times as long as compiled"
            lines.append(f"on {on} a gradient called from Python takes {cost}")
    return lines


def _until_not_met(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    missed: set[str] = set()
    shown = []
    for row in rows:
        if row["scene"] not in missed:
            shown.append(row)
        if row["evaluations"] is None:
            missed.add(row["scene"])
    return shown


def count(x: float) -> str:
    """Format a factor with two significant digits and without an exponent."""
    rounded = float(f"{x:.2g}")
    return f"{rounded:.0f}" if rounded >= 100 else f"{x:.2g}"
