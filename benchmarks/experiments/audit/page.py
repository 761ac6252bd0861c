"""The audit of the established integrators: which claims hold, which are contradicted, and what was measured."""

from __future__ import annotations

import pandas as pd

from phasebench.benchmarks.page.markdown import listed, table
from phasebench.benchmarks.page.page import Page
from phasebench.reference.peers import BY_ID

from . import audit, cases, judge, measures
from . import figures as drawings
from .table import legend, letter, lines
from .worker import LOADING

OWN = "phasebench"


def records(frame) -> list[dict]:
    """The rows of a frame with None for what is missing and "" for a missing text."""
    rows = frame.astype(object).where(frame.notna(), None).to_dict("records")
    texts = ("reason", "problem", "measured", "problems", "source")
    return [r | {k: r[k] or "" for k in texts if k in r} for r in rows]


def _versions(rows) -> list[str]:
    return list(dict.fromkeys(f"{r['package']} {r['version']}" for r in rows))


def _more(claim, rows) -> str:
    """Said of an order that is contradicted because it is higher."""
    if claim["property"] != "order" or claim["verdict"] != judge.CONTRADICTED:
        return ""
    on = claim["problems"].split(", ")
    found = [r["value"] for r in rows if r["measure"] == "order" and r["peer"] == claim["peer"] and r["problem"] in on]
    return ": more than is claimed" if min(found) > float(claim["claim"].removeprefix("order ")) else ""


def _about(claim) -> str:
    """What is known of how the peer is made, which may say why."""
    peer = BY_ID.get(claim["peer"])
    return f"Its making: {peer.about}. " if peer else ""


def _claims(claims, rows, verdict: str) -> list[str]:
    return [
        f"- **{c['peer']}** ({c['package']} {c['version']}): claimed: {c['claim']} ({c['source']}). Measured: "
        f"{c['measured']}{_more(c, rows)}. {_about(c)}Reproduce: `{c['command']}`"
        for c in claims
        if c["verdict"] == verdict
    ] or ["None."]


def _controls(rows, claims) -> str:
    if not rows:
        return "No control was run."
    wrong = [f"{c['peer']} ({c['claim']})" for c in claims if c["verdict"] != judge.HOLDS]
    names = list(dict.fromkeys(r["peer"] for r in rows))
    return (
        f"The controls, {listed(names)} of this project, go through the same functions: of their {len(claims)} "
        f"declarations {len(claims) - len(wrong)} come out as declared"
        + (f"; not so {listed(wrong)}." if wrong else ".")
    )


def _write(data, figures):
    found, claimed = data("audit"), data("audit_claims")
    if found is None or claimed is None:
        return None
    rows, claims = records(found), records(claimed)
    own = [r for r in rows if r["package"] == OWN], [c for c in claims if c["package"] == OWN]
    rows, claims = [r for r in rows if r["package"] != OWN], [c for c in claims if c["package"] != OWN]
    first = [r for r in rows if r["measure"] == "package"]
    there, away = [r for r in first if r["status"] == "ok"], [r for r in first if r["status"] != "ok"]
    ids = {r["peer"] for r in there}
    claims_there = [c for c in claims if c["peer"] in ids]
    count = {
        v: [c for c in claims_there if c["verdict"] == v] for v in (judge.HOLDS, judge.CONTRADICTED, judge.IN_PART)
    }
    judged = sum(map(len, count.values()))
    verdict = [
        f"{len(there)} integrators of {len({r['package'] for r in there})} packages were audited "
        f"({listed(_versions(there), 20)}).",
        f"{judged} claims were tested: {len(count[judge.HOLDS])} hold, {len(count[judge.IN_PART])} hold on some problems "
        f"and not on others, {len(count[judge.CONTRADICTED])} are contradicted"
        + "".join(f"; {c['peer']}: {c['claim']}" for c in count[judge.CONTRADICTED])
        + f". {len(claims_there) - judged} more could not be judged.",
    ]
    if away:
        verdict.append(f"Not audited: {listed(_versions(away), 20)} ({len(away)} integrators, reasons below).")
    verdict.append(_controls(*own))
    body = ["## Claims that are contradicted\n", *_claims(claims_there, rows, judge.CONTRADICTED)]
    body += ["\n## Claims that hold on some problems and not on others\n", *_claims(claims_there, rows, judge.IN_PART)]
    picture = drawings.orders(rows, claims, figures)
    if picture:
        body += [
            "\n## Orders\n",
            f"![measured less claimed order](figures/{picture})\n",
            "The measured order less the claimed one with its interval, a mark for each problem; the band is the gate of "
            f"+-{judge.GATE}.\n",
        ]
    body.append(f"\n## What was measured\n\nThe letters name the problems: {legend(rows)}.\n")
    for package in dict.fromkeys(r["package"] for r in there):
        mine = [r for r in rows if r["package"] == package and r["peer"] in ids]
        body.append(f"\n### {package} {mine[0]['version']}\n")
        for adaptive in (False, True):
            if part := lines(mine, claims, adaptive):
                body += [f"{'Adaptive' if adaptive else 'Fixed'} steps.\n", table(pd.DataFrame(part))]
    remarks = judge.remarks(rows, claims)
    body += ["\n## More than is claimed\n", *([f"- {r}" for r in remarks] or ["Nothing."])]
    body += ["\n## Not audited\n"]
    reasons: dict[str, list[str]] = {}
    for r in away:
        reasons.setdefault(f"{r['status']}: {r['reason']}", []).append(r["peer"])
    body += [f"- {listed(ids, 40)}: {reason}." for reason, ids in reasons.items()] or ["Nothing."]
    body += ["\n## Claims that could not be judged\n"]
    unjudged: dict[str, list[str]] = {}
    for c in claims_there:
        if c["verdict"] == judge.UNJUDGED:
            unjudged.setdefault(c["reason"], []).append(f"{c['peer']} ({c['claim']})")
    body += [f"- {reason}: {listed(who, 60)}." for reason, who in unjudged.items()] or ["None."]
    body += ["\n## Measures that did not end or ended early\n"]
    ended: dict[str, dict[str, list[str]]] = {}
    for r in rows:
        if r["peer"] in ids and r["measure"] != "package" and (r["status"] != "ok" or "budget" in r["reason"]):
            why = r["reason"] if r["status"] == "ok" else f"{r['status']}: {r['reason']}"
            where = ended.setdefault(why, {}).setdefault(r["peer"], [])
            where.append(f"{r['measure']} {letter(r['problem'])}")
    for reason, who in ended.items():
        body.append(f"- {reason}: " + "; ".join(f"{peer} ({', '.join(on)})" for peer, on in who.items()))
    if not ended:
        body.append("None.")
    return verdict, "\n".join([*body, _how(rows)])


def _how(rows) -> str:
    floors = [r["floor"] for r in rows if r["measure"] == "symplecticity" and r.get("floor") is not None]
    seen = f" (here {min(floors):.0e} to {max(floors):.0e})" if floors else ""
    return f"""
## How it is measured

Every integrator is a black box (q0, p0, h, n) -> (q, p), called through its package's public interface, on orbits in
general position: {listed([c.problem for c in cases.CASES], 20)}, as far as it can do them. Reproduce one with
`phasebench audit --peer ID`; a measure gets {audit.BUDGET:g} s, the loading of a package and its compilation {LOADING:g} s.

- **Order** (fixed steps): the error against a certified Taylor series (long double, certified by quadruple precision) over
  a ladder of steps; window and 95 % interval of the fit, widened by half of what the slope changes inside. Errors below 100
  times round-off and the reference's uncertainty are left out. A claim is contradicted where on at least two problems, and
  against none, the whole interval is more than {judge.GATE} away from it, at another integer: a slope between integers is
  not asymptotic.
- **Symplecticity**: the largest entry of M^T J M - J, M the Jacobian of {" and ".join(map(str, measures.JACOBIAN_STEPS))}
  steps by extrapolated central differences (the worse of them is shown). The floor is what doubling the displacement
  changes, or what a method of this project that is symplectic shows{seen}. Above {judge.BROKEN:g} times the floor it is
  broken; below, it is kept if the classical Runge-Kutta method shows {judge.VISIBLE:g} times the floor there, and unclear else.
- **Reversibility**: {measures.OUT} steps, momenta reversed, as many steps back, reversed: the distance from the start,
  judged in the same way. Bitwise: it is 0.
- **Energy**: the largest error of H at {measures.SEEN} times of {measures.SHORT} or {measures.LONG} steps and the drift's
  slope a unit of time with its interval. It drifts where that leaves out 0 and the drift is more than {judge.DRIFTS:g} of
  the largest error, and is bounded where it leaves 0 in or the drift is less than {judge.STAYS:g} of it; large is an error
  of {judge.LARGE:g} of the energies' size that no longer drifts. Claims of round-off are held to {judge.BROUWER:g} round-offs times the root of the steps.
- **Stability**: the largest h on the harmonic oscillator of frequency 1 with which the energy grows by no more than
  {measures.GROWTH:g} in {measures.STABLE_STEPS} steps; probes are a factor of {measures.APART:g} apart, then bisected to 1 %.
- **Cost**: median of {measures.REPEATS} warm runs without output, microseconds a step; of an adaptive integrator a step of
  its own, at a tolerance of {measures.TOLERANCES[1]:g}, as the rest but the energy where round-off is claimed.

Not judged: the order of an adaptive integrator (the error at some tolerances is shown), its symplecticity (there is no map
of one step), accuracy beyond what it claims, and stability and cost, of which nothing is claimed.
"""


PAGE = Page(
    "audit",
    "Audit of the established integrators",
    "whether other packages' integrators are what they claim",
    ("audit", "audit_claims"),
    _write,
)
