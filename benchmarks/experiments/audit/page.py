"""The audit of the established integrators: which claims hold, which are contradicted, and what was measured."""

from __future__ import annotations

import pandas as pd

from phasebench.benchmarks.page.markdown import listed
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, Verdict, of

from . import audit, figures, judge, measures

OWN = "phasebench"


def records(frame) -> list[dict]:
    """The rows of a frame with None for what is missing and "" for a missing text."""
    rows = frame.astype(object).where(frame.notna(), None).to_dict("records")
    texts = ("reason", "problem", "measured", "problems", "source")
    return [r | {k: r[k] or "" for k in texts if k in r} for r in rows]


def _present(found: pd.DataFrame) -> pd.DataFrame:
    """The rows that say of each integrator whether its package could be loaded."""
    return found[(found["measure"] == "package") & (found["package"] != OWN)]


def _versions(frame: pd.DataFrame) -> list[str]:
    return list(dict.fromkeys(f"{r.package} {r.version}" for r in frame.itertuples()))


def _claims(found: pd.DataFrame, claimed: pd.DataFrame) -> pd.DataFrame:
    """The claims of the integrators that were audited."""
    there = _present(found)
    return claimed[claimed["peer"].isin(there[there["status"] == "ok"]["peer"])]


@of("audit", "audit_claims")
def claims(found: pd.DataFrame, claimed: pd.DataFrame) -> Verdict | None:
    """How many claims hold."""
    mine = _claims(found, claimed)
    count = mine["verdict"].value_counts()
    holds, part, wrong = (int(count.get(v, 0)) for v in (judge.HOLDS, judge.IN_PART, judge.CONTRADICTED))
    judged = holds + part + wrong
    if not judged:
        return None
    names = [f"{r.peer} ({r.claim})" for r in mine[mine["verdict"] == judge.CONTRADICTED].itertuples()]
    text = f"Of {judged} claims that could be judged {holds} hold, {part} hold on some problems only, {wrong} are contradicted"
    return Verdict(
        f"{text}{f': {listed(names, 3)}' if names else ''}; {len(mine) - judged} could not be judged.",
        wrong + part == 0,
        f"{wrong} of {judged} claims are contradicted{f', {part} hold in part' if part else ''}.",
    )


@of("audit")
def covered(found: pd.DataFrame) -> Verdict | None:
    """What was audited."""
    first = _present(found)
    if first.empty:
        return None
    there, away = first[first["status"] == "ok"], first[first["status"] != "ok"]
    text = f"{len(there)} integrators of {there['package'].nunique()} packages were audited ({listed(_versions(there), 8)})"
    text += f"; not audited: {listed(_versions(away), 4)}, {len(away)} integrators" if len(away) else ""
    return Verdict(f"{text}.", True, text)


@of("audit_claims")
def controls(claimed: pd.DataFrame) -> Verdict | None:
    """Whether the controls come out as declared."""
    own = claimed[claimed["package"] == OWN]
    if own.empty:
        return None
    wrong = own[own["verdict"] != judge.HOLDS]
    names = listed(list(dict.fromkeys(own["peer"])))
    text = f"The controls, {names} of this project, go through the same functions: {len(own) - len(wrong)} of their "
    text += f"{len(own)} declarations come out as declared"
    text += f", not {listed([f'{r.peer} ({r.claim})' for r in wrong.itertuples()], 3)}" if len(wrong) else ""
    return Verdict(f"{text}.", wrong.empty, f"{len(wrong)} controls do not come out as declared.")


@of("audit", "audit_claims")
def draw(found: pd.DataFrame, claimed: pd.DataFrame, folder) -> list[Picture] | None:
    """The orders."""
    rows = [r for r in records(found) if r["package"] != OWN]
    file = figures.orders(rows, records(claimed), folder)
    if file is None:
        return None
    caption = (
        "Measured less claimed order, a mark for each integrator and problem; grey: the gate of "
        f"±{judge.GATE}; what is beyond ±{figures.SHOWN} stands at the edge."
    )
    return [Picture(file, "measured less claimed orders", caption)]


@of("audit", "audit_claims")
def table(found: pd.DataFrame, claimed: pd.DataFrame) -> Table | None:
    """The findings, then what could not be audited."""
    mine = _claims(found, claimed)
    wrong = mine[mine["verdict"].isin([judge.CONTRADICTED, judge.IN_PART])].sort_values("verdict", kind="stable")
    lines = [
        {
            "integrator": r.peer,
            "version": r.version,
            "claimed": r.claim,
            "measured": str(r.measured).split(";")[0],
            "verdict": r.verdict,
            "reproduce": f"`{r.command}`",
        }
        for r in wrong.itertuples()
    ]
    first = _present(found)
    for (package, status, reason), part in (
        first[first["status"] != "ok"].astype(object).fillna("").groupby(["package", "status", "reason"], sort=False)
    ):
        names = listed(list(part["peer"]), 3)
        lines.append({"integrator": names, "version": package, "measured": str(reason)[:120], "verdict": status})
    if not lines:
        return None
    shown = pd.DataFrame(lines[:ROWS]).fillna("")
    return Table(shown, "Claims that are contradicted or hold in part, then what could not be audited.")


@of("audit", "audit_claims")
def _whole(found: pd.DataFrame, claimed: pd.DataFrame) -> pd.DataFrame:
    return claimed[["peer", "version", "claim", "verdict", "measured", "reason"]]


PAGE = Page(
    id="audit",
    question="Are the established integrators what their packages claim?",
    tables=("audit", "audit_claims"),
    setting=(
        "Every integrator is a black box (q₀, p₀, h, n) → (q, p), called through its package's public interface.",
        "Claims are what a package's own attributes or documentation say: order, symplectic, reversible, energy.",
        "Order: the error over a ladder of steps against a certified reference, with a 95 % interval of the slope.",
        "Symplecticity: MᵀJM − J by extrapolated differences; reversibility: out and back with reversed momenta.",
        f"Energy: its drift with an interval over {measures.SHORT} or {measures.LONG} steps. Orbits in general position.",
    ),
    verdicts=(claims, covered, controls),
    figures=draw,
    table=table,
    whole=_whole,
    limits=(
        f"An order is contradicted where on two problems, and against none, its whole interval is more than {judge.GATE} "
        "away, at another integer.",
        f"A defect above {judge.BROKEN:g} times the floor is broken; below it counts only where classical Runge–Kutta "
        f"shows {judge.VISIBLE:g} times the floor.",
        "Not judged: order and symplecticity of an adaptive integrator, and what a package does not claim.",
        f"A measure gets {audit.BUDGET:g} s; what took longer is in data/audit.csv with its reason.",
    ),
    command="pytest benchmarks/experiments/audit",
)
