"""Claims against what was measured: holds, contradicted, or not judged with the reason; and what could be claimed.

A function of tables alone.  Nothing passes that was not judged:

- of what every step is held to (it runs, is consistent, keeps nothing between calls, leaves its input alone) a failure
  contradicts; a step that is not consistent, or does not run, has no structure, so that nothing else of it is judged;
- an order is that of the worst system, claimed two-sided: more than is claimed contradicts as well;
- a structure or a conservation holds where every system shows it, is contradicted by one that does not, and is not
  judged where one is open.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from phasebench.integrators.record import BOUNDED, DRIFT, NONE, ROUND_OFF

from .basics import OVER, ROUNDED, WRONG, adapts, below, consistent, digits, pure, runs, stateless
from .evidence import agrees, has
from .kept import conserved, hint, structure
from .verdicts import CONSERVED, CONTRADICTED, FAIL, HOLDS, PASS, UNJUDGED, Judged, Tables, in_words

STRUCTURES = ("symplectic", "symmetric", "reversible")
#: How near a measured stability limit is to a claimed one.
NEAR = 5e-3
#: Claim -> the measures that have to be at their end before it holds, where that is not the one of its name alone.
NEEDS = {"symplectic": {"symplectic", "jumps", "long"}, "tolerance": set()}


def judged(claims: Mapping[str, Any], tables: Tables) -> list[Judged]:
    """The verdicts on what every integrator is held to, and on the claims."""
    found = [runs(tables), stateless(tables), pure(tables)]
    found.append(adapts(tables) if "tolerance" in tables.rows else consistent(tables))
    gross = gross_failure(found)
    for name, value in claims.items():
        if (name in CONSERVED and value == NONE) or value is None:
            continue
        words = in_words(name, value)
        found.append(Judged(name, words, UNJUDGED, why=gross) if gross else _claim(name, value, tables))
    return found


def verdict(found: list[Judged], claims: Mapping[str, Any]) -> str:
    """Pass only where something was claimed and every verdict is that it holds."""
    kinds = {j.verdict for j in found}
    if CONTRADICTED in kinds:
        return FAIL
    return PASS if kinds == {HOLDS} and len(found) > 4 else UNJUDGED


def gross_failure(found: list[Judged]) -> str:
    """Why nothing else can be judged, or ""."""
    for j in found:
        if j.verdict == HOLDS:
            continue
        if j.name == "runs" and j.measured != OVER:
            return "it does not run"
        if j.name == "consistent" and (
            j.verdict == UNJUDGED or not isinstance(j.measured, float) or j.measured > WRONG
        ):
            return "it was not seen to be a step of the systems"
    return ""


def _claim(name: str, value, tables: Tables) -> Judged:
    words = in_words(name, value)
    measure = "long" if name in CONSERVED else name
    found = _measured_claim(name, value, tables)
    if tables.failed.get("time") and found.verdict != CONTRADICTED and not NEEDS.get(name, {measure}) <= tables.done:
        return Judged(name, words, UNJUDGED, why="the time was over before all was measured that it needs")
    return found


def _measured_claim(name: str, value, tables: Tables) -> Judged:
    words = in_words(name, value)
    measure = "long" if name in CONSERVED else name
    if not tables.of(measure):
        why = tables.failed.get(measure) or tables.failed.get("all") or "it was not measured"
        return Judged(name, words, UNJUDGED, why=why)
    if name in CONSERVED:
        return conserved(name, value, tables)
    if name in STRUCTURES:
        return structure(name, value, tables)
    judge: dict[str, Callable] = {"order": order, "stability": stability, "tolerance": tolerance}
    return judge[name](value, tables)


def order(claimed: int, tables: Tables) -> Judged:
    """The order, of the worst system; where some are open, of at least half of each kind."""
    rows, words = tables.of("order"), f"order {claimed}"
    told = [r for r in rows if agrees(r, claimed) is not None]
    few = next((k for k in (True, False) if _open(rows, told, k)), None)
    if few is not None or not told:
        seen = ", ".join(f"{r['value']:.3g} on {r['on']}" if has(r, "value") else f"none on {r['on']}" for r in rows)
        return Judged("order", words, UNJUDGED, why=f"not asymptotic yet on too many systems: {seen}")
    worst = min(told, key=lambda r: r["value"])
    value, interval, on = worst["value"], (worst["low"], worst["high"]), tuple(r["on"] for r in told)
    differ = [r for r in told if not agrees(r, claimed) and r["value"] < claimed]
    if differ:
        why = f"it is {value:.3g} on {worst['on']}{hint(differ, told)}"
        return Judged("order", words, CONTRADICTED, value, interval, tuple(r["on"] for r in differ), why)
    slow = [r for r in tables.of("states") if below(r, claimed)]
    if slow:
        why = f"single steps are of order {slow[0]['order']:.2f} on {slow[0]['on']}"
        return Judged("order", words, CONTRADICTED, slow[0]["order"], None, tuple(r["on"] for r in slow), why)
    cut = [(max(r["terms"][1 : min(claimed, r["clean"])], default=0.0), r["on"]) for r in told if "terms" in r]
    if cut and max(cut)[0] > ROUNDED:
        size, where = max(cut)
        why = f"below h^{claimed} a term of {size:.1e} is left: coefficients of {digits(size)} digits"
        return Judged("order", words, CONTRADICTED, value, interval, (where,), why)
    if agrees(worst, claimed):
        return Judged("order", words, HOLDS, value, interval, on)
    return Judged("order", words, CONTRADICTED, value, interval, on, "it is more than is claimed, on every system")


def _open(rows: list[dict], told: list[dict], separable: bool) -> bool:
    """Whether more than half of the systems of a kind are open."""
    part = [r for r in rows if bool(r.get("separable")) is separable]
    return 2 * len([r for r in part if r in told]) < len(part)


def stability(claimed: float, tables: Tables) -> Judged:
    """The linear stability limit."""
    row, words = tables.of("stability")[0], in_words("stability", claimed)
    if row["reason"]:
        return Judged("stability", words, UNJUDGED, why=row["reason"])
    limit = row["limit"]
    if limit is None:
        why = f"stable as far as h omega = {row['scanned']:g}"
        verdict = CONTRADICTED if claimed < row["scanned"] * (1 - NEAR) else UNJUDGED
        return Judged("stability", words, verdict, None, None, (row["on"],), why)
    near = abs(limit - claimed) <= NEAR * claimed
    why = "" if near else f"the limit is {limit:.6g}"
    return Judged("stability", words, HOLDS if near else CONTRADICTED, limit, None, (row["on"],), why)


def tolerance(claimed: float, tables: Tables) -> Judged:
    """The error is at most so many times the tolerance."""
    ratios = [
        (max(e / t for e, t in zip(r["errors"], r["tolerances"], strict=True)), r["on"]) for r in tables.of("tolerance")
    ]
    worst, on = max(ratios)
    verdict = HOLDS if worst <= claimed else CONTRADICTED
    why = f"up to {worst:.3g} times the tolerance, on {on}"
    return Judged("tolerance", in_words("tolerance", claimed), verdict, worst, None, (on,), why)


def offers(claims: Mapping[str, Any], tables: Tables) -> list[str]:
    """What was measured and is not claimed, as ``--claim`` takes it."""
    out = []
    told = [r["value"] for r in tables.of("order") if has(r, "value")]
    if "order" not in claims and told and round(min(told)) > 0 and order(round(min(told)), tables).verdict == HOLDS:
        out.append(f"order={round(min(told))}")
    for name in STRUCTURES:
        if name not in claims and tables.of(name) and structure(name, True, tables).verdict == HOLDS:
            out.append(name)
    for name in CONSERVED:
        if name not in claims and tables.of("long"):
            how = (ROUND_OFF, BOUNDED, DRIFT) if name == "energy" else (ROUND_OFF,)
            held = next((x for x in how if conserved(name, x, tables).verdict == HOLDS), None)
            out += [f"{name}={'preserved' if held == ROUND_OFF else held}"] if held else []
    return out
