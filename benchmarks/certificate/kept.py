"""Claims of what is kept: structures of the step, the energy and invariants along a run."""

from __future__ import annotations

from phasebench.integrators.record import BOUNDED, DRIFT, EXACT, ROUND_OFF

from .evidence import BROKEN, between, bounded, round_off, shown
from .verdicts import CONTRADICTED, HOLDS, UNJUDGED, Judged, Tables, in_words

#: How a claim says that something is kept to round-off.
KEPT_AS = ("preserved", EXACT, ROUND_OFF)


def structure(name: str, claimed: bool, tables: Tables) -> Judged:
    """A structure, claimed or denied."""
    rows, words = tables.of(name), in_words(name, claimed)
    broken = [r for r in rows if shown(r) is False]
    open_ = [r for r in rows if shown(r) is None]
    if broken:
        worst = max(broken, key=lambda r: r["value"])
        why = f"a defect of {worst['value']:.1e} at h = {worst['h']:g} on {worst['on']}, floor {worst['floor']:.0e}"
        if claimed:
            why += hint(broken, rows)
        verdict = CONTRADICTED if claimed else HOLDS
        return Judged(name, words, verdict, worst["value"], None, tuple(r["on"] for r in broken), why)
    if open_ or not rows:
        why = next((r["reason"] for r in open_ if r.get("reason")), "nothing could be seen above the floor")
        above = [r for r in open_ if between(r)]
        if above:
            worst = max(above, key=lambda r: r["value"] / r["floor"])
            why = f"a defect of {worst['value']:.1e} at h = {worst['h']:g} on {worst['on']} is between its floor "
            why += f"{worst['floor']:.0e} and {BROKEN:g} times that"
        return Judged(name, words, UNJUDGED, why=why, on=tuple(r["on"] for r in open_))
    worst = max(rows, key=lambda r: r["value"])
    on = tuple(r["on"] for r in rows)
    if name == "symplectic" and (found := _pieces(words, claimed, tables) or _drifting(words, claimed, tables)):
        return found
    if not claimed:
        return Judged(name, words, CONTRADICTED, worst["value"], None, on, "it is, on every system here")
    why = f"defects of at most {worst['value']:.1e}, floor {worst['floor']:.0e}"
    return Judged(name, words, HOLDS, worst["value"], None, on, why)


def _pieces(words: str, claimed: bool, tables: Tables) -> Judged | None:
    """What a map that jumps has as its verdict on being symplectic; None of one that does not."""
    rows = [r for r in tables.of("jumps") if r["value"] > r["floor"]]
    if not rows:
        return None
    worst, on = max(rows, key=lambda r: r["value"] / r["floor"]), tuple(r["on"] for r in rows)
    why = f"the map is made of pieces: it jumps by {worst['value']:.1e} at h = {worst['h']:g} on {worst['on']}"
    if worst["value"] > BROKEN * worst["floor"]:
        return Judged("symplectic", words, CONTRADICTED if claimed else HOLDS, worst["value"], None, on, why)
    why += f", which is {worst['value'] / worst['floor']:.0f} times the floor"
    return Judged("symplectic", words, UNJUDGED, worst["value"], None, on, why)


def _drifting(words: str, claimed: bool, tables: Tables) -> Judged | None:
    """What an energy that drifts leaves of a step whose defects are those of a symplectic map; None without one."""
    rows = [r for r in tables.of("long") if r["status"] == "ok" and kind(r["energy"]) == DRIFT]
    if not rows:
        return None
    part, on = rows[0]["energy"], tuple(r["on"] for r in rows)
    why = f"its defects are those of a symplectic map, but its energy drifts: by {part['value']:.1e} to "
    why += f"t = {part['time']:g} on {on[0]}; that of a symplectic step stays bounded"
    return Judged("symplectic", words, UNJUDGED, part["value"], None, on, why)


def kind(part: dict) -> str | None:
    """How an invariant is kept along a run: `ROUND_OFF`, `BOUNDED`, `DRIFT`, or None where it is open."""
    if part["value"] <= round_off(part):
        return ROUND_OFF
    stays = bounded(part)
    return None if stays is None else BOUNDED if stays else DRIFT


def conserved(name: str, claimed: str, tables: Tables) -> Judged:
    """How the energy or an invariant is kept."""
    words = in_words(name, claimed)
    rows = [r for r in tables.of("long") if r["status"] != "ok" or name in r]
    lost = [r for r in rows if r["status"] != "ok"]
    parts = [(r, r[name], kind(r[name])) for r in rows if r["status"] == "ok"]
    if not parts:
        why = lost[0]["reason"] if lost else "no system of the battery with such an invariant can be done"
        return Judged(name, words, UNJUDGED, why=why)
    wanted = ROUND_OFF if claimed in KEPT_AS else claimed
    fits = {ROUND_OFF: (ROUND_OFF,), BOUNDED: (ROUND_OFF, BOUNDED), DRIFT: (DRIFT,)}[wanted]
    worst = max(parts, key=lambda x: x[1]["value"] / x[1]["scale"])
    wrong = [x for x in parts if x[2] is not None and x[2] not in fits]
    if wanted == ROUND_OFF:
        wrong = [x for x in parts if x[1]["value"] > 10 * round_off(x[1])]
    if wanted == DRIFT:  # one system on which it drifts is enough, and all without must be none
        wrong = wrong if len(wrong) == len(parts) else []
        worst = next((x for x in parts if x[2] == DRIFT), worst)
    if wrong:
        row, part, how = max(wrong, key=lambda x: x[1]["value"] / x[1]["scale"])
        return _conserved(name, words, CONTRADICTED, row, part, how, tuple(x[0]["on"] for x in wrong))
    if lost:
        return Judged(name, words, UNJUDGED, why=lost[0]["reason"], on=tuple(r["on"] for r in lost))
    unclear = [x for x in parts if x[2] not in fits]
    if unclear and not (wanted == DRIFT and any(x[2] == DRIFT for x in parts)):
        row, part, how = unclear[0]
        return _conserved(name, words, UNJUDGED, row, part, how, (row["on"],))
    return _conserved(name, words, HOLDS, *worst, tuple(x[0]["on"] for x in parts))


def _conserved(name, words, verdict, row, part, how, on) -> Judged:
    seen = {ROUND_OFF: "of round-off", BOUNDED: "bounded", DRIFT: "drifts", None: "open"}[how]
    why = f"{seen}: at most {part['value']:.1e} to t = {part['time']:g} on {row['on']}, slope {part['slope']:.1e}"
    why += f" in [{part['low']:.1e}, {part['high']:.1e}]"  # the slope's interval: that of the size would be another
    return Judged(name, words, verdict, part["value"], None, on, why)


def hint(bad: list[dict], rows: list[dict]) -> str:
    """What to say where a claim fails on what is not H = T + V alone."""
    wrong, right = {r["on"] for r in bad}, {r["on"] for r in rows} - {r["on"] for r in bad}
    split = any(r.get("separable") for r in bad)
    return "; on H = T(p) + V(q) it is so: say REQUIRES = ('separable',)" if wrong and right and not split else ""
