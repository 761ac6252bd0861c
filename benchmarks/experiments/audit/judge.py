"""Claims against measurements: which hold, which are contradicted or understated, which are not judged and why.

More than is claimed contradicts nothing: the claim is understated, of whatever kind it is.

- Order: a claim is contradicted where at least two problems differ and none agrees (understated where all orders are
  higher), holds where at least one agrees and none differs, holds in part where problems disagree.
- Symplectic, reversible: one broken problem contradicts the claim; a structure that is denied and kept on all problems
  is understated.
- Energy: "bounded" is contradicted by a drift; "round-off" by an error of 10 times what round-off does; "drifts" is
  understated where an error that is not of round-off stays bounded on all problems.

What one row tells: `benchmarks.certificate.evidence`.
"""

from __future__ import annotations

from collections.abc import Iterable

from phasebench.benchmarks.certificate.evidence import agrees, bounded, has, kept, round_off
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.integrators.record import BOUNDED, DRIFT, EXACT, ROUND_OFF

HOLDS, CONTRADICTED, IN_PART, UNJUDGED = "holds", "contradicted", "holds in part", "not judged"
#: More than is claimed.
UNDERSTATED = "understated"
KEPT = {"symplecticity": "symplectic", "reversibility": "reversible"}


def number(x: float) -> str:
    """Three digits."""
    return f"{x:.3g}"


def order_text(row) -> str:
    """An order with its interval and problem, or why there is none."""
    if row["status"] != "ok":
        return f"{row['status']} ({row['problem']}: {row['reason']})"
    if not has(row, "value"):
        return f"{row['reason']} ({row['problem']})"
    return f"{row['value']:.2f} [{row['low']:.2f}, {row['high']:.2f}] ({row['problem']})"


def structure_text(row) -> str:
    """A defect with its floor, what the classical method shows, and how it falls with h."""
    if row["status"] != "ok":
        return f"{row['status']} ({row['problem']}: {row['reason']})"
    if not has(row, "floor"):
        return f"{number(row['value'])} at tol {number(row['tol'])} ({row['problem']})"
    text = f"{number(row['value'])}, floor {number(row['floor'])}, rk4 {number(row['classical'])}"
    text += f", own error {number(row['own'])}"
    if has(row, "falls_as"):
        text += f", falls as h^{row['falls_as']:.1f}"
    return f"{text} ({row['problem']}, h = {number(row['h'])}, {row['steps']:.0f} steps)"


def energy_text(row) -> str:
    """The greatest error, and the slope of the drift with its interval."""
    if row["status"] != "ok":
        return f"{row['status']} ({row['problem']}: {row['reason']})"
    slope = " ".join(f"{row[k]:.1e}" for k in ("slope", "low", "high")).split()
    return (
        f"max {row['value']:.1e}, slope {slope[0]} [{slope[1]}, {slope[2]}] to t = {row['time']:.0f} ({row['problem']})"
    )


def _order(claimed, rows) -> tuple[str, list, str]:
    found = {row["problem"]: agrees(row, claimed) for row in rows}
    differ, agree = ([r for r in rows if found[r["problem"]] is x] for x in (False, True))
    if differ and agree:
        return IN_PART, differ + agree, ""
    if len(differ) > 1:
        return UNDERSTATED if all(r["value"] > claimed for r in differ) else CONTRADICTED, differ, ""
    if agree:
        return HOLDS, agree, ""
    return UNJUDGED, rows, "it differs on one problem alone" if differ else "no window tells"


def _structure(claimed, rows) -> tuple[str, list, str]:
    broken = [r for r in rows if kept(r) is False]
    whole = [r for r in rows if kept(r)]
    if claimed and broken:
        return CONTRADICTED, broken, ""
    if claimed and whole:
        return HOLDS, whole, ""
    if not claimed and broken:
        return HOLDS, broken, ""
    if not claimed and whole and len(whole) == len([r for r in rows if r["status"] == "ok"]):
        return UNDERSTATED, whole, ""
    return UNJUDGED, rows, "nothing could be seen above the floor"


def _energy(claimed, rows) -> tuple[str, list, str]:
    wrong, right, better = [], [], []
    for row in rows:
        if row["status"] != "ok":
            continue
        small = row["value"] <= round_off(row)
        if claimed in (ROUND_OFF, EXACT):
            if small:
                right.append(row)
            elif row["value"] > 10 * round_off(row):
                wrong.append(row)
        elif claimed == BOUNDED:
            stays = small or bounded(row)
            if stays:
                right.append(row)
            elif stays is False:
                wrong.append(row)
        elif claimed == DRIFT and not small and bounded(row) is not None:
            (better if bounded(row) else right).append(row)
    if wrong:
        return CONTRADICTED, wrong, ""
    if right:
        return HOLDS, right, ""
    if better and len(better) == len([r for r in rows if r["status"] == "ok"]):
        return UNDERSTATED, better, f"as far as t = {max(r['time'] for r in better):.0f} tells"
    return UNJUDGED, rows, "the error is of round-off or the time too short to tell"


def _words(name: str, claimed) -> str:
    if name == "order":
        return f"order {claimed:.0f}"
    if name == "energy":
        return {BOUNDED: "bounded energy error", DRIFT: "energy drifts"}.get(claimed, f"energy error: {claimed}")
    return name if claimed else f"not {name}"


def claims(peer, version: str, rows: Iterable[dict]) -> list[dict]:
    """The verdict on every claim of a peer from its rows.

    Returns
    -------
    list of dict
        package, version, peer, name, property, claim (in words), source, verdict, measured, problems, reason, command
    """
    peer = integrator(peer)
    mine = [r for r in rows if r["peer"] == peer.id]
    about = {"package": peer.kind, "version": version, "peer": peer.id, "name": peer.name}
    tests = (
        ("order", peer.claims.order, "order", _order, order_text),
        ("symplectic", peer.claims.symplectic, "symplecticity", _structure, structure_text),
        ("reversible", peer.claims.reversible, "reversibility", _structure, structure_text),
        ("energy", peer.claims.energy, "energy", _energy, energy_text),
    )
    out = []
    for name, claimed, measure, judge, text in tests:
        if claimed is None:
            continue
        part = [r for r in mine if r["measure"] == measure]
        if mine and mine[0]["status"] != "ok":
            verdict, seen, reason = UNJUDGED, [], f"{mine[0]['status']}: {mine[0]['reason']}"
        elif peer.adaptive and name != "energy":
            verdict, seen, reason = UNJUDGED, [], "the step is adaptive: a step map of constant h is not there to test"
        elif not part:
            verdict, seen, reason = UNJUDGED, [], next((r["reason"] for r in mine if r["status"] != "ok"), "")
            reason = reason or "it was not measured"
        else:
            verdict, seen, reason = judge(claimed, part)
        out.append(
            about
            | {
                "property": name,
                "claim": _words(name, claimed),
                "source": peer.claims.source,
                "verdict": verdict,
                "measured": "; ".join(map(text, seen)),
                "problems": ", ".join(r["problem"] for r in seen),
                "reason": reason,
                "command": f"phasebench audit --peer {peer.id}",
            }
        )
    return out


def remarks(rows: Iterable[dict], claimed: Iterable[dict]) -> list[str]:
    """What was found and is not claimed."""
    rows, out = list(rows), []
    said = {(c["peer"], c["property"]) for c in claimed if not c["claim"].startswith("not ")}
    for measure, name in KEPT.items():
        more = []
        for id in dict.fromkeys(r["peer"] for r in rows if r["measure"] == measure):
            part = [r for r in rows if r["peer"] == id and r["measure"] == measure]
            if (id, name) not in said and all(kept(r) for r in part):
                more.append(id)
        if more:
            out.append(f"{name} on the problems here, which is not claimed: {', '.join(more)}")
    return out
