"""Requirements on every integrator: it runs, is consistent, keeps no state between calls, leaves its input alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import log10
from typing import Any

from .evidence import Tables
from .verdict import CONTRADICTED, HOLDS, UNJUDGED, Judgement, systems

#: Relative error of (step - state)/h against the vector field above which a function is not a step of the system.
WRONG = 0.01
#: Largest relative error of coefficients rounded to doubles, and smallest error that can be seen in double precision.
ROUNDED, SEEN = 1e-13, 1e-12
#: A constant error whose uncertainty is larger than this is inconclusive.
VAGUE = 1e-3
#: The measured value of a step that did not return in time.
OVER = "time over"
#: Largest difference between equal calls that an iterative solver with a stored start may cause.
NEARLY = 1e-13
#: Single steps are of a lower order if theirs is lower by more than `SLOWER`, in at least `PAIRS` pairs of steps.
SLOWER, PAIRS = 0.75, 2
#: Largest error that an adaptive integrator may have at its smallest tolerance.
CONVERGED = 1e-6


def runs(tables: Tables) -> Judgement:
    """Judge that the integrator runs: no step raised in any measurement, and the first steps stayed finite."""
    rows = tables.of("runs")
    bad = [r for r in rows if r["status"] != "ok"]
    if bad:
        return Judgement(CONTRADICTED, bad[0]["status"], None, systems(bad), bad[0]["reason"])
    if tables.failed.get("raised"):
        return Judgement(CONTRADICTED, "raised", None, (), tables.failed["raised"])
    if tables.failed.get("time"):
        return Judgement(UNJUDGED, OVER, why=tables.failed["time"])
    if not rows:
        return Judgement(UNJUDGED, why=tables.failed.get("runs", "it was not measured"))
    return Judgement(HOLDS, "ok", None, systems(rows))


def stateless(tables: Tables) -> Judgement:
    """Judge that equal calls give equal results, so that no state is kept between calls."""
    rows = tables.of("state")
    if not rows:
        return Judgement(UNJUDGED, why=tables.failed.get("state", "it was not measured"))
    worst = max(rows, key=lambda r: r["value"])
    if worst["value"] > NEARLY:
        why = f"{worst['what']}: results differ by {worst['value']:.1e} on {worst['on']}"
        why += "; a multistep method does so, and a step here is a function of (system, q, p, h)"
        return Judgement(CONTRADICTED, worst["value"], None, (worst["on"],), why)
    differ = f"to round-off: {worst['what']}, results differ by {worst['value']:.1e}"
    return Judgement(HOLDS, worst["value"], why=differ if worst["value"] else "equal in every bit")


def pure(tables: Tables) -> Judgement:
    """Judge that a call changes neither its input arrays nor the arrays that the last call returned."""
    rows = tables.of("input")
    if not rows:
        return Judgement(UNJUDGED, why=tables.failed.get("input", "it was not measured"))
    changes = {"value": "it changes the q or p that it is handed", "later": "a call changes what the last returned"}
    for key, why in changes.items():
        if bad := [r for r in rows if r[key] != 0]:
            return Judgement(CONTRADICTED, max(r[key] for r in bad), None, systems(bad), why)
    return Judgement(HOLDS, 0.0, None, systems(rows))


def consistent(tables: Tables) -> Judgement:
    """Judge consistency: (step - state)/h tends to the vector field as h -> 0, up to rounding of the coefficients."""
    found = _elsewhere(tables)
    if found is not None:
        return found
    rows = tables.of("order")
    known = [r for r in rows if "terms" in r or "constant" in r]
    if not rows or len(known) < len(rows) or (tables.failed.get("time") and "consistent" not in tables.done):
        return Judgement(UNJUDGED, why=tables.failed.get("order", "too few steps could be taken"))
    worst = max(known, key=_first)
    value, on = _first(worst), (worst["on"],)
    told = "terms" in worst or worst["doubt"] < VAGUE
    threshold = value - unexplained(worst)[0] if "terms" in worst else max(SEEN, worst["doubt"])
    if value > WRONG and (told or value > 10 * worst["doubt"]):
        why = f"as h falls, (step - state)/h misses the field by {value:.2g} of it: this is no step of the system"
        return Judgement(CONTRADICTED, value, None, on, why)
    if value > threshold and told:
        why = f"a clock that is wrong by {value:.1e}: coefficients of {digits(value)} digits, not of a double's 16"
        return Judgement(CONTRADICTED, value, None, on, why)
    if not told:
        return Judgement(UNJUDGED, value, None, on, f"known to no better than {worst['doubt']:.0e}")
    why = "" if "terms" in worst else f"in doubles, to {max(worst['doubt'], SEEN):.0e}; smaller could not be seen"
    return Judgement(HOLDS, value, None, systems(rows), why)


def _elsewhere(tables: Tables) -> Judgement | None:
    """The judgement that the step is inconsistent at random states of other sizes, or None."""
    for row in tables.of("states"):
        if below(row, 1):
            why = f"its error in a step falls as h^{row['order'] + 1:.2f} on {row['on']}: this is no step of the system"
            return Judgement(CONTRADICTED, row["order"], None, (row["on"],), why)
    return None


def below(row: Mapping[str, Any], order: int) -> bool:
    """True if single steps show a lower order than ``order``, from `PAIRS` pairs of neighbouring step sizes or more."""
    return row["pairs"] >= PAIRS and row["order"] < order - SLOWER


def _first(row: Mapping[str, Any]) -> float:
    return row["terms"][0] if "terms" in row else row["constant"]


def unexplained(row: Mapping[str, Any]) -> list[float]:
    """The terms of an order's row that neither a double's rounding nor a change of the last digits explains; else 0."""
    explained = row.get("explained", [0.0] * len(row["terms"]))
    return [x if x > max(ROUNDED, e) else 0.0 for x, e in zip(row["terms"], explained, strict=True)]


def digits(value: float) -> int:
    """Number of correct digits at a relative error: -log10(value), at least 0."""
    return max(0, round(-log10(value)))


def adapts(tables: Tables) -> Judgement:
    """Judge that an adaptive integrator converges: its error falls with its tolerance."""
    rows = tables.of("tolerance")
    if not rows:
        return Judgement(UNJUDGED, why=tables.failed.get("tolerance", "it was not measured"))
    bad = [r for r in rows if not (r["errors"][-1] < CONVERGED and r["errors"][-1] <= r["errors"][0])]
    worst = max(rows, key=lambda r: r["errors"][-1])
    why = f"error {worst['errors'][-1]:.1e} at tolerance {worst['tolerances'][-1]:g} on {worst['on']}"
    return Judgement(CONTRADICTED if bad else HOLDS, worst["errors"][-1], None, systems(bad or rows), why)


#: Name -> (the requirement in words, the function that judges it).
REQUIRED = {
    "runs": ("runs", runs),
    "stateless": ("keeps nothing between calls", stateless),
    "pure": ("leaves its input alone", pure),
    "consistent": ("consistent", consistent),
}
#: Replacements of requirements for an adaptive integrator.
ADAPTIVE = {"consistent": ("converges as its tolerance falls", adapts)}


def judge_requirements(tables: Tables) -> list[Judgement]:
    """Judge what is required of every integrator: it runs, is consistent, keeps no state, leaves its input alone."""
    kinds = REQUIRED | (ADAPTIVE if "tolerance" in tables.rows else {})
    return [replace(judge(tables), name=name, claim=words) for name, (words, judge) in kinds.items()]
