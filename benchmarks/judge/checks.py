"""CHECKS: how each claim is judged from rows of measurements; the checks are pure functions of the rows.

- An order is judged by the lowest one measured on any system; a higher order than claimed contradicts the claim, too.
- A structure or a conservation law holds if every system shows it, is contradicted if one system breaks it, and is not
  judged if one system is inconclusive.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from math import log2
from numbers import Real
from typing import Any

from phasebench.integrators.errors import InvalidInput, unknown_name
from phasebench.integrators.record import BOUNDED, DRIFT, EXACT, NONE, ROUND_OFF

from . import decide
from .decide import CERTIFICATE
from .evidence import BROKEN, Tables, agrees, between, has, kind, shows_structure
from .requirements import below, digits, unexplained
from .verdict import CONTRADICTED, HOLDS, UNJUDGED, Judgement, systems

#: Relative distance within which a measured stability limit agrees with the claimed one.
NEAR = 5e-3
#: Powers of h by which a defect falls faster than the error where iterations end too early.
FASTER = 0.7
#: Precision -> the largest rounding of a step, relative to the state.
PRECISIONS = {"double": 1e-11, "single": 2e-6}
#: Values that a claim of conservation may have.
KEPT_AS = ("preserved", EXACT, ROUND_OFF, BOUNDED, DRIFT, NONE)


@dataclass(frozen=True)
class Check:
    """How one claim is judged.

    Attributes
    ----------
    name : of the claim
    values, accepts : the permitted values in words, and the test whether a value is permitted
    measure : the name of the measurement whose rows the check reads
    judge : (claimed value, tables) -> the judgement; called only if that measurement has rows
    words : format string that puts the claim into words; empty if the name says it
    needs : names of the measurements that must be complete before the claim can hold
    candidates : tables -> values to suggest if nothing is claimed, the strongest first
    """

    name: str
    values: str
    accepts: Callable[[Any], bool]
    measure: str
    judge: Callable[[Any, Tables], Judgement]
    words: str = ""
    needs: frozenset[str] = frozenset()
    candidates: Callable[[Tables], Iterable] = lambda tables: ()

    def claim(self, value: Any) -> str:
        """The claim of ``value`` in words."""
        return self.words.format(value) if self.words else self.name if value else f"not {self.name}"


def order(claimed: int, tables: Tables) -> Judgement:
    """Judge a claimed order against the lowest one measured on any system."""
    rows = tables.of("order")
    verdict, seen = decide.order(claimed, rows, CERTIFICATE)
    told = [r for r in rows if agrees(r, claimed) is not None]
    if verdict == UNJUDGED:
        orders = ", ".join(f"{r['value']:.3g} on {r['on']}" if has(r, "value") else f"none on {r['on']}" for r in rows)
        return Judgement(UNJUDGED, why=f"not asymptotic yet on too many systems: {orders}")
    lowest = min(told, key=lambda r: r["value"])
    found = partial(Judgement, verdict, lowest["value"], (lowest["low"], lowest["high"]), systems(seen))
    if verdict == CONTRADICTED and lowest["value"] < claimed:
        return found(f"it is {lowest['value']:.3g} on {lowest['on']}{lowest.get('hint') or hint(seen, told)}")
    if slow := [r for r in tables.of("states") if below(r, claimed)]:
        why = f"single steps are of order {slow[0]['order']:.2f} on {slow[0]['on']}"
        return Judgement(CONTRADICTED, slow[0]["order"], None, systems(slow), why)
    cut = [(size, r["on"]) for r in told if "terms" in r for size in unexplained(r)[1 : min(claimed, r["clean"])]]
    if cut and max(cut)[0] > 0:
        size, where = max(cut)
        why = f"below h^{claimed} a term of {size:.1e} is left: coefficients of {digits(size)} digits"
        return Judgement(CONTRADICTED, lowest["value"], (lowest["low"], lowest["high"]), (where,), why)
    return found("" if verdict == HOLDS else "it is more than is claimed, on every system")


def structure(name: str, claimed: bool, tables: Tables) -> Judgement:
    """Judge the claim that the step map has (True) or lacks (False) the structure ``name``, such as symmetry."""
    rows = tables.of(name)
    verdict, seen = decide.structure(claimed, rows, CERTIFICATE)
    if verdict == UNJUDGED:
        return _unseen([r for r in rows if shows_structure(r) is None])
    worst = max(seen, key=lambda r: r["value"])
    if shows_structure(worst) is False:
        why = f"a defect of {worst['value']:.1e} at h = {worst['h']:g} on {worst['on']}, floor {worst['floor']:.0e}"
        why += (_unsolved(seen) or hint(seen, rows)) if claimed else ""
    elif claimed:
        why = f"defects of at most {worst['value']:.1e}, floor {worst['floor']:.0e}"
    else:
        why = "it is, on every system here"
    return Judgement(verdict, worst["value"], None, systems(seen), why)


def _unsolved(rows: list[dict]) -> str:
    """A hint where the defect falls faster with h than the error, as with equations left half solved; or ""."""
    row = next((r for r in rows if "finer" in r), None)
    if row is None or not min(row["finer"]["value"], row["finer"]["own"], row["own"]) > 0:
        return ""
    defect, own = (log2(row[key] / row["finer"][key]) for key in ("value", "own"))
    if (defect - own) / log2(row["h"] / row["finer"]["h"]) <= FASTER:
        return ""
    return "; it falls faster than the error: if its equations are implicit, solve them with more iterations"


def _unseen(rows: list[dict]) -> Judgement:
    why = next((r["reason"] for r in rows if r.get("reason")), "nothing could be seen above the floor")
    above = [r for r in rows if between(r)]
    if above:
        worst = max(above, key=lambda r: r["value"] / r["floor"])
        why = f"a defect of {worst['value']:.1e} at h = {worst['h']:g} on {worst['on']} is between its floor "
        why += f"{worst['floor']:.0e} and {BROKEN:g} times that"
    return Judgement(UNJUDGED, why=why, on=systems(rows))


def symplectic(claimed: bool, tables: Tables) -> Judgement:
    """Judge symplecticity; even with no measured defect, a discontinuous map or a drifting energy speaks against it."""
    rows = tables.of("symplectic")
    unbroken = rows and all(shows_structure(r) for r in rows)
    found = (_pieces(claimed, tables) or _drifting(tables)) if unbroken else None
    return found or structure("symplectic", claimed, tables)


def _pieces(claimed: bool, tables: Tables) -> Judgement | None:
    """The judgement on symplecticity from jumps of the step map, which is then discontinuous, or None."""
    rows = [r for r in tables.of("jumps") if r["value"] > r["floor"]]
    if not rows:
        return None
    worst = max(rows, key=lambda r: r["value"] / r["floor"])
    why = f"the map is made of pieces: it jumps by {worst['value']:.1e} at h = {worst['h']:g} on {worst['on']}"
    verdict = CONTRADICTED if claimed else HOLDS
    if worst["value"] <= BROKEN * worst["floor"]:
        verdict = UNJUDGED
        why += f", which is {worst['value'] / worst['floor']:.0f} times the floor"
    return Judgement(verdict, worst["value"], None, systems(rows), why)


def _drifting(tables: Tables) -> Judgement | None:
    """The judgement on symplecticity if no defect was measured but the energy drifts; None if it does not drift."""
    rows = [r for r in tables.of("long") if r["status"] == "ok" and kind(r["energy"]) == DRIFT]
    if not rows:
        return None
    part, on = rows[0]["energy"], systems(rows)
    why = f"its defects are those of a symplectic map, but its energy drifts: by {part['value']:.1e} to "
    why += f"t = {part['time']:g} on {on[0]}; that of a symplectic step stays bounded"
    return Judgement(UNJUDGED, part["value"], None, on, why)


def conservation(name: str, claimed: str, tables: Tables) -> Judgement:
    """Judge how the invariant ``name`` is conserved along long runs; ``claimed`` is a value of `KEPT_AS`."""
    rows = [{"on": r["on"], "status": "ok"} | r[name] if name in r else r
            for r in tables.of("long") if r["status"] != "ok" or name in r]  # fmt: skip
    lost, ran = ([r for r in rows if (r["status"] == "ok") is x] for x in (False, True))
    if not ran:
        why = lost[0]["reason"] if lost else "no system of the battery with such an invariant can be done"
        return Judgement(UNJUDGED, why=why)
    verdict, seen = decide.conservation(claimed, rows, CERTIFICATE)
    if verdict == UNJUDGED and lost:
        return Judgement(UNJUDGED, why=lost[0]["reason"], on=systems(lost))
    if verdict == UNJUDGED:
        seen = [next(r for r in ran if kind(r) not in decide.FITS[claimed])]
    worst = max(seen, key=lambda r: r["value"] / r["scale"])
    if verdict == HOLDS and claimed == DRIFT:
        worst = next(r for r in seen if kind(r) == DRIFT)
    how = {ROUND_OFF: "of round-off", BOUNDED: "bounded", DRIFT: "drifts", None: "open"}[kind(worst)]
    why = f"{how}: at most {worst['value']:.1e} to t = {worst['time']:g} on {worst['on']}, slope {worst['slope']:.1e}"
    why += f" in [{worst['low']:.1e}, {worst['high']:.1e}]"  # the interval of the slope, not of the error
    return Judgement(verdict, worst["value"], None, systems(seen), why)


def stability(claimed: float, tables: Tables) -> Judgement:
    """Judge the claimed linear stability limit, in units of h omega."""
    row = tables.of("stability")[0]
    if row["reason"]:
        return Judgement(UNJUDGED, why=row["reason"])
    limit, on = row["limit"], (row["on"],)
    if limit is None:
        verdict = CONTRADICTED if claimed < row["scanned"] * (1 - NEAR) else UNJUDGED
        return Judgement(verdict, None, None, on, f"stable as far as h omega = {row['scanned']:g}")
    if abs(limit - claimed) <= NEAR * claimed:
        return Judgement(HOLDS, limit, None, on)
    return Judgement(CONTRADICTED, limit, None, on, f"the limit is {limit:.6g}")


def tolerance(claimed: float, tables: Tables) -> Judgement:
    """Judge the claim that the error is at most ``claimed`` times the tolerance."""
    worst, on = max(
        (max(e / t for e, t in zip(r["errors"], r["tolerances"], strict=True)), r["on"]) for r in tables.of("tolerance")
    )
    why = f"up to {worst:.3g} times the tolerance, on {on}"
    return Judgement(HOLDS if worst <= claimed else CONTRADICTED, worst, None, (on,), why)


def precision(claimed: str, tables: Tables) -> Judgement:
    """Judge the claim that a step rounds as "double" or "single" precision does, or less."""
    worst = max(tables.of("rounding"), key=lambda r: r["value"])
    verdict = HOLDS if worst["value"] <= PRECISIONS[claimed] else CONTRADICTED
    return Judgement(verdict, worst["value"], None, (worst["on"],), f"it rounds at {worst['value']:.0e} of the state")


def hint(bad: list[dict], rows: list[dict]) -> str:
    """Advice to restrict a claim to separable H if it fails (``bad``) only on others; else ""."""
    wrong, right = set(systems(bad)), set(systems(rows)) - set(systems(bad))
    split = any(r.get("separable") for r in bad)
    return "; on H = T(p) + V(q) it is so: say REQUIRES = ('separable',)" if wrong and right and not split else ""


def _orders(tables: Tables) -> tuple[int, ...]:
    told = [r["value"] for r in tables.of("order") if has(r, "value")]
    return (round(min(told)),) if told and round(min(told)) > 0 else ()


def _number(x: object) -> bool:
    return isinstance(x, Real) and not isinstance(x, bool)


def _structure(name: str, judge: Callable[[Any, Tables], Judgement], *besides: str) -> Check:
    flag = ("True or False", lambda x: isinstance(x, bool))
    return Check(name, *flag, name, judge, needs=frozenset({name, *besides}), candidates=lambda tables: (True,))


def _conservation(name: str, words: str, *offered: str) -> Check:
    one_of = (f"one of {', '.join(KEPT_AS)}", lambda x: isinstance(x, str) and x in KEPT_AS)
    judge = partial(conservation, name)
    return Check(name, *one_of, "long", judge, words, frozenset({"long"}), lambda tables: offered)


def _positive(name: str, what: str, measure: str, judge: Callable[[Any, Tables], Judgement], *needs: str) -> Check:
    positive = (f"a positive number, {what}", lambda x: _number(x) and 0 < x <= sys.float_info.max)
    return Check(name, *positive, measure, judge, f"{name} {{:g}}", frozenset(needs))


CHECKS: dict[str, Check] = {
    check.name: check
    for check in (
        Check("order", "a positive integer", lambda x: _number(x) and isinstance(x, int) and x > 0, "order", order,
              "order {:g}", frozenset({"order"}), _orders),
        _structure("symplectic", symplectic, "jumps", "long"),
        _structure("symmetric", partial(structure, "symmetric")),
        _structure("reversible", partial(structure, "reversible")),
        _structure("volume", partial(structure, "volume")),
        _conservation("energy", "energy: {}", "preserved", BOUNDED, DRIFT),
        _conservation("bilinear", "bilinear invariants: {}", "preserved"),
        _conservation("quadratic", "quadratic invariants: {}", "preserved"),
        _conservation("constraints", "constraints: {}", "preserved"),
        _positive("stability", "the limit of h omega", "stability", stability, "stability"),
        Check("precision", "one of double, single", lambda x: isinstance(x, str) and x in PRECISIONS, "rounding",
              precision, "precision: {}"),
        _positive("tolerance", "the most that an error is of the tolerance", "tolerance", tolerance),
    )
}  # fmt: skip


def checked_claims(claims: object, where: str) -> dict[str, Any]:
    """The claims as a dict, name -> value; raises InvalidInput for an unknown claim or a value that it cannot have."""
    if not isinstance(claims, Mapping):
        raise InvalidInput(f"{where} is {claims!r}; write {{'order': 2, 'symplectic': True}}")
    for name, value in claims.items():
        if name not in CHECKS:
            raise InvalidInput(f"{where}: {unknown_name('claim', str(name), CHECKS)}")
        if not CHECKS[name].accepts(value):
            raise InvalidInput(f"{where} has {name} = {value!r}; it must be {CHECKS[name].values}")
    return {name: x if isinstance(x, (int, str)) else float(x) for name, x in claims.items()}
