"""Judge the packages' claims from the audit's rows: they hold, are contradicted or understated, or cannot be judged.

A package that does better than it claims understates, which is no contradiction.  The decisions are made by
`judge.decide` with the thresholds `AUDIT`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from phasebench.benchmarks.judge import decide
from phasebench.benchmarks.judge.evidence import agrees, has, keeps_structure
from phasebench.benchmarks.judge.verdict import UNDERSTATED, UNJUDGED
from phasebench.benchmarks.measure.integrator import Integrator, integrator
from phasebench.integrators.record import BOUNDED, DRIFT, Method
from phasebench.reference.peers import Peer

KEPT = {"symplecticity": "symplectic", "reversibility": "reversible"}


def _order(row: dict) -> str:
    if not has(row, "value"):
        return f"{row['reason']} ({row['problem']})"
    return f"{row['value']:.2f} [{row['low']:.2f}, {row['high']:.2f}] ({row['problem']})"


def _structure(row: dict) -> str:
    """The defect, its floor, RK4's defect, the integrator's own error, the power of h with which the defect falls."""
    if not has(row, "floor"):
        return f"{row['value']:.3g} at tol {row['tol']:.3g} ({row['problem']})"
    text = f"{row['value']:.3g}, floor {row['floor']:.3g}, rk4 {row['classical']:.3g}, own error {row['own']:.3g}"
    if has(row, "falls_as"):
        text += f", falls as h^{row['falls_as']:.1f}"
    return f"{text} ({row['problem']}, h = {row['h']:.3g}, {row['steps']:.0f} steps)"


def _energy(row: dict) -> str:
    slope = f"{row['slope']:.1e} [{row['low']:.1e}, {row['high']:.1e}]"
    return f"max {row['value']:.1e}, slope {slope} to t = {row['time']:.0f} ({row['problem']})"


UNSEEN = "nothing could be seen above the floor"
#: Property -> (measure whose rows decide, decision function, formatter of a row, reason where it cannot be judged).
PROPERTIES: dict[str, tuple[str, Callable[..., decide.Decision], Callable[[dict], str], str]] = {
    "order": ("order", decide.order, _order, "no window tells"),
    "symplectic": ("symplecticity", decide.structure, _structure, UNSEEN),
    "reversible": ("reversibility", decide.structure, _structure, UNSEEN),
    "energy": ("energy", decide.conservation, _energy, "the error is of round-off or the time too short to tell"),
}


def text(name: str, row: dict) -> str:
    """What a row measured of a property, or how it failed."""
    if row["status"] != "ok":
        return f"{row['status']} ({row['problem']}: {row['reason']})"
    return PROPERTIES[name][2](row)


def decision(name: str, claimed: int | bool | str, rows: list[dict]) -> tuple[str, list[dict], str]:
    """(The verdict on the claim of a property, the rows that decide, reason)."""
    _, decide_by, _, unjudged = PROPERTIES[name]
    verdict, seen = decide_by(claimed, rows, decide.AUDIT)
    if verdict == UNJUDGED:
        alone = name == "order" and any(agrees(r, claimed) is False for r in rows)
        return verdict, rows, "it differs on one problem alone" if alone else unjudged
    far = verdict == UNDERSTATED and name == "energy"
    return verdict, seen, f"as far as t = {max(r['time'] for r in seen):.0f} tells" if far else ""


def _words(name: str, claimed: int | bool | str) -> str:
    if name == "order":
        return f"order {claimed:.0f}"
    if name == "energy":
        return {BOUNDED: "bounded energy error", DRIFT: "energy drifts"}.get(claimed, f"energy error: {claimed}")
    return name if claimed else f"not {name}"


def judgements(peer: str | Method | Peer | Integrator, version: str, rows: Iterable[dict]) -> list[dict]:
    """Judge every claim of a peer from its rows of the audit; ``version`` is that of its package."""
    peer = integrator(peer)
    mine = [r for r in rows if r["peer"] == peer.id]
    about = {"package": peer.kind, "version": version, "peer": peer.id, "name": peer.name}
    out = []
    for name, (measure, *_) in PROPERTIES.items():
        claimed = getattr(peer.claims, name)
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
            verdict, seen, reason = decision(name, claimed, part)
        found = {
            "property": name,
            "claim": _words(name, claimed),
            "source": peer.claims.source,
            "verdict": verdict,
            "measured": "; ".join(text(name, r) for r in seen),
            "problems": ", ".join(r["problem"] for r in seen),
            "reason": reason,
            "command": f"phasebench audit --peer {peer.id}",
        }
        out.append(about | found)
    return out


def remarks(rows: Iterable[dict], claimed: Iterable[dict]) -> list[str]:
    """Sentences on structures that integrators keep on all problems though their packages do not claim them."""
    rows, out = list(rows), []
    said = {(c["peer"], c["property"]) for c in claimed if not c["claim"].startswith("not ")}
    for measure, name in KEPT.items():
        more = []
        for id in dict.fromkeys(r["peer"] for r in rows if r["measure"] == measure):
            part = [r for r in rows if r["peer"] == id and r["measure"] == measure]
            if (id, name) not in said and all(keeps_structure(r) for r in part):
                more.append(id)
        if more:
            out.append(f"{name} on the problems here, which is not claimed: {', '.join(more)}")
    return out
