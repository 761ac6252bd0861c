"""Judges claims from tables of measurements, and lists the properties that could be claimed.

The judgements depend on the tables alone.  A claim that could not be judged never passes.  Whatever is claimed, an
integrator has to run, be consistent, keep no state between calls and leave its input unchanged; otherwise that
requirement is contradicted.  If the integrator does not run or is not consistent, no claim is judged.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from phasebench.integrators.record import NONE

from .checks import CHECKS, Check
from .evidence import Tables
from .requirements import OVER, REQUIRED, WRONG, judge_requirements
from .verdict import CONTRADICTED, FAIL, HOLDS, OPEN, PASS, UNJUDGED, Judgement


def judgements(claims: Mapping[str, Any], tables: Tables) -> list[Judgement]:
    """Judge the requirements on every integrator, such as consistency, and then its claims (name -> value)."""
    found = judge_requirements(tables)
    gross = gross_failure(found)
    for name, value in claims.items():
        if value not in (None, NONE):
            check = CHECKS[name]
            on_it = Judgement(UNJUDGED, why=gross) if gross else judgement(check, value, tables)
            found.append(replace(on_it, name=name, claim=check.claim(value)))
    rounded = judgement(CHECKS["precision"], "double", tables)
    if "precision" not in claims and rounded.verdict == CONTRADICTED:
        single = judgement(CHECKS["precision"], "single", tables).verdict == HOLDS
        why = rounded.why + ("; if it is meant to, say precision = 'single'" if single else ", more than floats do")
        found.append(replace(rounded, verdict=UNJUDGED, why=why, name="precision", claim="precision: double"))
    return found


def judgement(check: Check, value: Any, tables: Tables) -> Judgement:
    """Judge one claim by its check.

    If time ran out, the claim can only hold if all measurements that the check needs were completed.
    """
    why = tables.failed.get(check.measure) or tables.failed.get("all") or "it was not measured"
    found = check.judge(value, tables) if tables.of(check.measure) else Judgement(UNJUDGED, why=why)
    if tables.failed.get("time") and found.verdict != CONTRADICTED and not check.needs <= tables.done:
        return Judgement(UNJUDGED, why="the time was over before all was measured that it needs")
    return found


def verdict(found: list[Judgement]) -> str:
    """ "fail" if a claim or requirement is contradicted, "pass" if claims were made and all hold, else "not-judged"."""
    kinds = {j.verdict for j in found}
    if CONTRADICTED in kinds:
        return FAIL
    return PASS if kinds == {HOLDS} and len(found) > len(REQUIRED) else OPEN


def gross_failure(found: list[Judgement]) -> str:
    """Why no claim can be judged: the integrator does not run, or is not consistent; "" if neither is so."""
    for j in found:
        if j.verdict == HOLDS:
            continue
        if j.name == "runs" and j.measured != OVER:
            return j.why if j.verdict == UNJUDGED else "it does not run"
        if j.name == "consistent" and (
            j.verdict == UNJUDGED or not isinstance(j.measured, float) or j.measured > WRONG
        ):
            return "it was not seen to be a step of the systems"
    return ""


def offers(claims: Mapping[str, Any], tables: Tables) -> list[str]:
    """Properties that hold in the measurements but were not claimed, written as arguments of ``--claim``."""
    out = []
    for name, check in CHECKS.items():
        if name not in claims and tables.of(check.measure):
            held = next((x for x in check.candidates(tables) if judgement(check, x, tables).verdict == HOLDS), None)
            out += [] if held is None else [name if held is True else f"{name}={held}"]
    return out
