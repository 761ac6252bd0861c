"""What every integrator is held to: it runs, is consistent, keeps nothing between calls, leaves its input alone."""

from __future__ import annotations

from math import log10

from .verdicts import CONTRADICTED, HOLDS, UNJUDGED, Judged, Tables

#: A step that misses the field by this part of it is no step of the system.
WRONG = 0.01
#: The largest error of coefficients that are rounded to doubles, and of a constant error in doubles that is seen.
ROUNDED, SEEN = 1e-13, 1e-12
#: An uncertainty of the constant error with which nothing is said.
VAGUE = 1e-3
#: What was seen of a step that did not return in time.
OVER = "time over"
#: Differences between equal calls that are a solver's that starts where it last ended.
NEARLY = 1e-13
#: An order of single steps that is lower by more, in so many pairs of steps, is lower.
SLOWER, PAIRS = 0.75, 2
#: The largest error of an adaptive integrator at its smallest tolerance.
CONVERGED = 1e-6


def runs(tables: Tables) -> Judged:
    """It runs: no step of any measure raised, and the first ones stayed finite."""
    rows = tables.of("runs")
    bad = [r for r in rows if r["status"] != "ok"]
    if bad:
        return Judged(
            "runs", "runs", CONTRADICTED, bad[0]["status"], None, tuple(r["on"] for r in bad), bad[0]["reason"]
        )
    if tables.failed.get("raised"):
        return Judged("runs", "runs", CONTRADICTED, "raised", None, (), tables.failed["raised"])
    if tables.failed.get("time"):
        return Judged("runs", "runs", UNJUDGED, OVER, why=tables.failed["time"])
    if not rows:
        return Judged("runs", "runs", UNJUDGED, why=tables.failed.get("runs", "it was not measured"))
    return Judged("runs", "runs", HOLDS, "ok", None, tuple(r["on"] for r in rows))


def stateless(tables: Tables) -> Judged:
    """It keeps nothing between calls."""
    rows, words = tables.of("state"), "keeps nothing between calls"
    if not rows:
        return Judged("stateless", words, UNJUDGED, why=tables.failed.get("state", "it was not measured"))
    worst = max(rows, key=lambda r: r["value"])
    if worst["value"] > NEARLY:
        why = f"{worst['what']}: results differ by {worst['value']:.1e} on {worst['on']}"
        return Judged("stateless", words, CONTRADICTED, worst["value"], None, (worst["on"],), why)
    why = (
        "equal in every bit"
        if worst["value"] == 0
        else f"to round-off: {worst['what']}, results differ by {worst['value']:.1e}"
    )
    return Judged("stateless", words, HOLDS, worst["value"], None, (), why)


def pure(tables: Tables) -> Judged:
    """It leaves its input alone, and what it returned too."""
    rows, words = tables.of("input"), "leaves its input alone"
    if not rows:
        return Judged("pure", words, UNJUDGED, why=tables.failed.get("input", "it was not measured"))
    for key, why in (
        ("value", "it changes the q or p that it is handed"),
        ("later", "a call changes what the last returned"),
    ):
        bad = [r for r in rows if r[key] != 0]
        if bad:
            size = max(r[key] for r in bad)
            return Judged("pure", words, CONTRADICTED, size, None, tuple(r["on"] for r in bad), why)
    return Judged("pure", words, HOLDS, 0.0, None, tuple(r["on"] for r in rows))


def consistent(tables: Tables) -> Judged:
    """The first term of its error in h vanishes: to the rounding of its coefficients, or as far as doubles tell."""
    found = _elsewhere(tables)
    if found is not None:
        return found
    rows = tables.of("order")
    known = [r for r in rows if "terms" in r or "constant" in r]
    if not rows or len(known) < len(rows) or (tables.failed.get("time") and "consistent" not in tables.done):
        return Judged(
            "consistent", "consistent", UNJUDGED, why=tables.failed.get("order", "too few steps could be taken")
        )
    worst = max(known, key=_first)
    value, on = _first(worst), (worst["on"],)
    told = "terms" in worst or worst["doubt"] < VAGUE
    threshold = ROUNDED if "terms" in worst else max(SEEN, worst["doubt"])
    if value > WRONG and (told or value > 10 * worst["doubt"]):
        why = f"as h falls, (step - state)/h misses the field by {value:.2g} of it: this is no step of the system"
        return Judged("consistent", "consistent", CONTRADICTED, value, None, on, why)
    if value > threshold and told:
        why = f"a clock that is wrong by {value:.1e}: coefficients of {digits(value)} digits, not of a double's 16"
        return Judged("consistent", "consistent", CONTRADICTED, value, None, on, why)
    if not told:
        return Judged(
            "consistent", "consistent", UNJUDGED, value, None, on, f"known to no better than {worst['doubt']:.0e}"
        )
    why = "" if "terms" in worst else f"in doubles, to {max(worst['doubt'], SEEN):.0e}; smaller could not be seen"
    return Judged("consistent", "consistent", HOLDS, value, None, tuple(r["on"] for r in rows), why)


def _elsewhere(tables: Tables) -> Judged | None:
    """What contradicts consistency at small and large states; None where nothing does."""
    for row in tables.of("states"):
        if below(row, 1):
            why = f"its error in a step falls as h^{row['order'] + 1:.2f} on {row['on']}: this is no step of the system"
            return Judged("consistent", "consistent", CONTRADICTED, row["order"], None, (row["on"],), why)
    return None


def below(row, order: int) -> bool:
    """Whether the errors of single steps from a state fall more slowly than those of a step of that order."""
    return row["pairs"] >= PAIRS and row["order"] < order - SLOWER


def _first(row) -> float:
    return row["terms"][0] if "terms" in row else row["constant"]


def digits(value: float) -> int:
    """So many digits does a number have whose relative error is this."""
    return max(0, round(-log10(value)))


def adapts(tables: Tables) -> Judged:
    """An adaptive integrator converges: its error falls with its tolerance."""
    rows = tables.of("tolerance")
    words = "converges as its tolerance falls"
    bad = [r for r in rows if not (r["errors"][-1] < CONVERGED and r["errors"][-1] <= r["errors"][0])]
    worst = max(rows, key=lambda r: r["errors"][-1])
    why = f"error {worst['errors'][-1]:.1e} at tolerance {worst['tolerances'][-1]:g} on {worst['on']}"
    on = tuple(r["on"] for r in (bad or rows))
    return Judged("consistent", words, CONTRADICTED if bad else HOLDS, worst["errors"][-1], None, on, why)
