"""Combine the rows of all systems into a verdict on a claim, and the rows that decide it.

A certificate, asked for by the author of a step, needs a conclusive row of every system, and a stronger property than
is claimed (such as a higher order) contradicts the claim.  An audit tests claims published by others on few problems:
one conclusive row is enough, but two must differ from the claim before an order is contradicted, and a stronger
property gives "understated".
"""

from __future__ import annotations

from typing import NamedTuple

from phasebench.integrators.record import BOUNDED, DRIFT, EXACT, ROUND_OFF

from .evidence import agrees, keeps_structure, kind, round_off, shows_structure
from .verdict import CONTRADICTED, HOLDS, IN_PART, UNDERSTATED, UNJUDGED

Decision = tuple[str, list[dict]]
#: Claimed conservation -> the measured kinds of error that agree with it.
FITS = dict.fromkeys(("preserved", EXACT, ROUND_OFF), (ROUND_OFF,)) | {BOUNDED: (ROUND_OFF, BOUNDED), DRIFT: (DRIFT,)}
#: An error this many times the round-off bound is not round-off.
BEYOND = 10


class Standard(NamedTuple):
    """How much evidence a verdict needs: whether of ``everywhere``; and the verdict where ``more`` is measured."""

    everywhere: bool
    more: str


CERTIFICATE = Standard(True, CONTRADICTED)
AUDIT = Standard(False, UNDERSTATED)


def order(claimed: int, rows: list[dict], standard: Standard) -> Decision:
    """The verdict on a claimed order from the rows of all systems, with the rows that decide.

    By `CERTIFICATE` one system with a lower order contradicts the claim, and conclusive rows are needed of half of the
    systems with H = T(p) + V(q), and of half of the others.  By `AUDIT` one row that agrees is enough, two that differ
    contradict the claim, and if some agree and some differ it holds in part.
    """
    agree, differ = ([r for r in rows if agrees(r, claimed) is x] for x in (True, False))
    lower = [r for r in differ if r["value"] < claimed]
    if standard.everywhere:
        told = [r for r in rows if agrees(r, claimed) is not None]
        if not told or _open(rows, told, True) or _open(rows, told, False):
            return UNJUDGED, []
        return (CONTRADICTED, lower) if lower else (HOLDS if agree else standard.more, told)
    if differ and agree:
        return IN_PART, differ + agree
    if len(differ) > 1:
        return CONTRADICTED if lower else standard.more, differ
    return (HOLDS, agree) if agree else (UNJUDGED, [])


def _open(rows: list[dict], told: list[dict], separable: bool) -> bool:
    """True if less than half of the rows of separable systems, or of the others, are conclusive."""
    part = [r for r in rows if bool(r.get("separable")) is separable]
    return 2 * len([r for r in part if r in told]) < len(part)


def structure(claimed: bool, rows: list[dict], standard: Standard) -> Decision:
    """The verdict on a structure claimed (True) or denied, with the rows that decide: one broken system does."""
    tells = shows_structure if standard.everywhere else keeps_structure
    broken, whole = ([r for r in rows if tells(r) is x] for x in (False, True))
    if broken:
        return CONTRADICTED if claimed else HOLDS, broken
    ran = rows if standard.everywhere else [r for r in rows if r["status"] == "ok"]
    enough = len(whole) == len(ran) or (claimed and not standard.everywhere)
    if whole and enough:
        return HOLDS if claimed else standard.more, whole
    return UNJUDGED, []


def conservation(claimed: str, rows: list[dict], standard: Standard) -> Decision:
    """The verdict on how an invariant is conserved, with the rows that decide: one drift contradicts "bounded"."""
    if claimed not in FITS:
        return UNJUDGED, []
    fits = FITS[claimed]
    ran = [r for r in rows if r["status"] == "ok"]
    right = [r for r in ran if kind(r) in fits]
    if claimed == DRIFT:
        less = (ROUND_OFF, BOUNDED) if standard.everywhere else (BOUNDED,)
        if ran and all(kind(r) in less for r in ran):
            return standard.more, ran
    else:
        wrong = [r for r in ran if kind(r) not in (None, *fits)]
        if fits == (ROUND_OFF,):
            wrong = [r for r in ran if r["value"] > BEYOND * round_off(r)]
        if wrong:
            return CONTRADICTED, wrong
        if standard.everywhere and len(right) < len(ran):
            return UNJUDGED, []
    if not right or (standard.everywhere and len(ran) < len(rows)):
        return UNJUDGED, []
    return HOLDS, ran if standard.everywhere else right
