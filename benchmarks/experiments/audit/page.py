"""The audit of the established integrators: which claims hold, which are contradicted, and what was measured."""

from __future__ import annotations

import pandas as pd

from phasebench.benchmarks.certificate import evidence
from phasebench.benchmarks.page import markdown
from phasebench.benchmarks.page.markdown import listed
from phasebench.benchmarks.page.page import ROWS, Data, Page, Picture, Table, Verdict, of

from . import audit, figures, judge, measures, modes
from .statements import NEAR, SEVERITIES

OWN = "phasebench"
#: Characters of a statement that the table quotes; all of it is in the CSV.
QUOTED = 48


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
    kinds = (judge.HOLDS, judge.IN_PART, judge.CONTRADICTED, judge.UNDERSTATED)
    holds, part, wrong, more = (int(count.get(v, 0)) for v in kinds)
    judged = holds + part + wrong + more
    if not judged:
        return None
    bad = mine[mine["verdict"] == judge.CONTRADICTED]
    names, whose = [f"{r.peer} ({r.claim})" for r in bad.itertuples()], _packages(bad)
    text = f"Of {judged} claims of order, symplecticity, reversibility and energy that could be judged {holds} hold, "
    text += f"{part} hold on some problems only, {more} are understated, {wrong} contradicted"
    return Verdict(
        f"{text}{f', {whose}: {listed(names, 3)}' if names else ''}; {len(mine) - judged} could not be judged.",
        wrong + part == 0,
        f"{wrong} of {judged} claims are contradicted{f', {whose}' if names else ''}{f'; {part} hold in part' if part else ''}.",
    )


def _packages(bad: pd.DataFrame) -> str:
    """Of which packages the rows are, those of most rows first: `all of p`, or `3 of p and 1 of q`."""
    counts = bad.groupby("package").size().sort_values(ascending=False, kind="stable")
    if len(counts) == 1:
        return f"{'all ' if len(bad) > 1 else ''}of {counts.index[0]}"
    return listed([f"{n} of {package}" for package, n in counts.items()])


@of("audit_statements")
def statements(stated: pd.DataFrame) -> Verdict | None:
    """How many statements of the documentation hold, and the worst that do not."""
    count = stated["verdict"].value_counts()
    kinds = (judge.HOLDS, judge.CONTRADICTED, judge.UNDERSTATED, judge.UNJUDGED)
    holds, wrong, more, open_ = (int(count.get(v, 0)) for v in kinds)
    if not holds + wrong + more:
        return None
    bad = _by_severity(stated[stated["verdict"] == judge.CONTRADICTED])
    worst = (
        f"; the worst: {bad.iloc[0]['package']}, {bad.iloc[0]['severity']} ({bad.iloc[0]['script']})" if wrong else ""
    )
    text = f"Of {len(stated)} statements of documentation, each with a script, {holds} hold, {wrong} are contradicted"
    text += f" ({_packages(bad)}), " if wrong else ", "
    whose = f" ({_packages(bad)})" if wrong else ""
    text += f"{more} understated, {open_} not judged{worst}."
    return Verdict(text, wrong == 0, f"{wrong} of {len(stated)} statements of documentation are contradicted{whose}.")


@of(modes.TABLE)
def left_as_found(found: pd.DataFrame) -> Verdict | None:
    """Who leaves the process in another floating-point mode."""
    seen = found[(found["status"] == "ok") & (found["package"] != OWN)]
    if seen.empty:
        return None
    wrong = _other_mode(seen)
    text = (
        f"{len(seen) - len(wrong)} of {len(seen)} integrators leave the process's floating-point mode as they found it"
    )
    if wrong.empty:
        return Verdict(f"{text}.", True, f"{text}.")
    text += f"; after {listed(list(wrong['peer']), 3)} numbers below 2⁻¹⁰²² are flushed to zero in whatever follows"
    return Verdict(
        f"{text}.", False, f"{len(wrong)} of {len(seen)} integrators change the process's floating-point mode."
    )


def _other_mode(found: pd.DataFrame) -> pd.DataFrame:
    """Who was seen to leave another mode."""
    return found[(found["status"] == "ok") & (found["mode"] != modes.KEPT)]


def beside_claims(data: Data) -> Verdict | None:
    """What documentation states and what runs leave behind: a finding where either is."""
    parts = [v for v in (statements(data), left_as_found(data)) if v is not None]
    if not parts:
        return None
    worst = next((v for v in parts if not v.holds), parts[0])
    return Verdict(" ".join(v.text for v in parts), worst.holds, worst.short)


def _by_severity(frame: pd.DataFrame) -> pd.DataFrame:
    """The worst first."""
    place = {s: i for i, s in enumerate(SEVERITIES)}
    return frame.sort_values("severity", key=lambda s: s.map(place).fillna(len(place)), kind="stable")


def covered(data: Data) -> Verdict | None:
    """What was audited, what was not, and whether the controls come out as declared."""
    found, claimed, left = (data(name) for name in ("audit", "audit_claims", "audit_unregistered"))
    if found is None or claimed is None or _present(found).empty:
        return None
    first = _present(found)
    there, away = first[first["status"] == "ok"], first[first["status"] != "ok"]
    text = f"{len(there)} integrators of {there['package'].nunique()} packages were audited ({listed(_versions(there), 8)})"
    absent = [f"{p} ({len(part)} integrators)" for p, part in away.groupby("package", sort=False)]
    text += f"; not audited: {_left(left, absent)}."
    own = claimed[claimed["package"] == OWN]
    if own.empty:
        return Verdict(text, True, text)
    wrong = own[own["verdict"] != judge.HOLDS]
    text += (
        f" Of the {len(own)} declarations of the controls ({listed(list(dict.fromkeys(own['peer'])))}, this project's) "
    )
    text += f"{len(own) - len(wrong)} come out as declared"
    text += f", not {listed([f'{r.peer} ({r.claim})' for r in wrong.itertuples()], 3)}" if len(wrong) else ""
    return Verdict(f"{text}.", wrong.empty, f"{len(wrong)} declarations of controls do not come out.")


def _left(left: pd.DataFrame | None, absent: list[str]) -> str:
    """What a package has and the audit has not, in a few words."""
    if left is None:
        return listed([*absent, "what the packages have besides was not looked up"])
    named = left[left["name"].notna() & (left["name"] != "")]
    parts = [f"of {package} {listed(_brief(part['name']), 12)}" for package, part in named.groupby("package")]
    return "; ".join([*absent, *parts] or ["nothing"]) + (" (data/audit_unregistered.csv)" if parts else "")


def _brief(names: pd.Series) -> list[str]:
    """The names without their remarks, options without their values."""
    return list(dict.fromkeys(" ".join(n.partition(" (")[0].split()[:2]) for n in names))


@of("audit", "audit_claims")
def draw(found: pd.DataFrame, claimed: pd.DataFrame, folder) -> list[Picture] | None:
    """The orders."""
    rows = [r for r in records(found) if r["package"] != OWN]
    file = figures.orders(rows, records(claimed), folder)
    if file is None:
        return None
    caption = (
        "Measured less claimed order, a mark for each integrator and problem; grey: the gate of "
        f"±{evidence.GATE}; what is beyond ±{figures.SHOWN} stands at the edge."
    )
    return [Picture(file, "measured less claimed orders", caption)]


def table(data: Data) -> Table | None:
    """The findings: statements of the documentation, then claims that no statement speaks of, then what failed."""
    stated, found, claimed = (data(name) for name in ("audit_statements", "audit", "audit_claims"))
    lines, spoken = [], set()
    if stated is not None and len(stated):
        stated = stated.astype(object).fillna("")
        spoken = {pair for text in stated["covers"] for pair in str(text).split()}
        bad = stated[stated["verdict"].isin([judge.CONTRADICTED, judge.UNDERSTATED])]
        bad = pd.concat([_by_severity(bad[bad["verdict"] == v]) for v in (judge.CONTRADICTED, judge.UNDERSTATED)])
        lines += [_stated(r) for r in bad.itertuples()]
    if (left := data(modes.TABLE)) is not None:
        wrong = _other_mode(left).groupby(["package", "version", "mode"], sort=False)
        lines += [_changes(*key, part) for key, part in wrong]
    if found is not None and claimed is not None:
        mine = _claims(found, claimed)
        shown = mine[mine["verdict"].isin([judge.CONTRADICTED, judge.IN_PART, judge.UNDERSTATED])]
        lines += [_claim(r) for r in shown.itertuples() if f"{r.peer}:{r.property}" not in spoken]
        first = _present(found)
        away = first[first["status"] != "ok"].astype(object).fillna("")
        for (package, status, reason), part in away.groupby(["package", "status", "reason"], sort=False):
            names = listed(list(part["peer"]), 3)
            lines.append({"package": package, "said": names, "measured": str(reason)[:120], "verdict": status})
    if not lines:
        return None
    caption = (
        "What is contradicted, the worst first, then what is understated, then what could not be run. Scripts: "
        "benchmarks/experiments/audit/scripts/; numbers are those that they printed."
    )
    if len(lines) > ROWS:
        caption += f" {len(lines) - ROWS} more are in data/audit_statements.csv and data/audit_claims.csv."
    return Table(pd.DataFrame(lines[:ROWS]).fillna(""), caption)


def _stated(r) -> dict:
    return {
        "package": f"{r.package} {r.version}",
        "said": f"[“{markdown.plain(_quoted(r.said, r.where))}”]({r.link})",
        "measured": r.shows,
        "verdict": f"{r.verdict}: {r.severity}" if r.severity else r.verdict,
        "what would mend it": r.mend,
        "script": r.script,
    }


def _claim(r) -> dict:
    return {
        "package": f"{r.package} {r.version}",
        "said": f"{r.peer}: {r.claim}",
        "measured": str(r.measured).split(";")[0],
        "verdict": r.verdict,
        "what would mend it": f"(`{r.command}`)",
    }


def _changes(package: str, version: str, mode: str, part: pd.DataFrame) -> dict:
    return {
        "package": f"{package} {version}",
        "said": f"(nothing) {listed(list(part['peer']), 3)}",
        "measured": "2⁻¹⁰⁷⁴ + 0 is 0 afterwards in its process",
        "verdict": f"floating-point mode {mode}",
        "what would mend it": "restore the mode (fesetenv) at the end of a call",
    }


def _quoted(text: str, where: str) -> str:
    """The first words of a text; the value of an attribute with its class."""
    if (attribute := where.rpartition(".")[2]) and text.startswith(f"{attribute} = "):
        return where.partition(":")[2].rpartition(".")[0] + f".{text}"
    return text if len(text) <= QUOTED else text[:QUOTED].rsplit(" ", 1)[0] + " …"


@of("audit_statements")
def mended(stated: pd.DataFrame) -> pd.DataFrame:
    """Every statement with its words, what was printed and what would mend it."""
    return stated[["package", "said", "where", "verdict", "printed", "mend", "script"]].astype(object).fillna("")


PAGE = Page(
    id="audit",
    question="Are the established integrators what their packages claim?",
    tables=("audit", "audit_claims", "audit_statements", "audit_unregistered", modes.TABLE),
    setting=(
        "Every integrator is a black box (q₀, p₀, h, n) → (q, p), called through its package; desolver's choice of the step "
        "is replaced by a constant one (adaptation_fn), since its own loop keeps no step of an implicit method.",
        "Claims are a package's own words or attributes. What else its documentation says is tested by a short script "
        "that needs the package alone: benchmarks/experiments/audit/scripts/.",
        "Order: the error over a ladder of steps against a certified reference, with a 95 % interval of the slope.",
        "Symplecticity: MᵀJM − J by extrapolated differences; reversibility: out and back; energy: its drift with an "
        f"interval over {measures.SHORTEST} to {measures.LONG} steps; stability: where the matrix of a step on the oscillator "
        "has bounded powers. Orbits in general position.",
        f"Floating-point mode: whether 2⁻¹⁰⁷⁴ survives an addition after {modes.STEPS} steps, in a process where it did before; "
        "elsewhere in this suite the mode is taken back after each run.",
    ),
    verdicts=(claims, beside_claims, covered),
    figures=draw,
    table=table,
    whole=mended,
    limits=(
        f"An order is contradicted where on two problems, and against none, its whole interval is more than {evidence.GATE} "
        "away, at another integer.",
        f"A defect above {evidence.BROKEN:g} times the floor is broken; below it counts only where classical Runge–Kutta's "
        f"defect and the integrator's own error are {evidence.VISIBLE:g} times the floor.",
        "More than is claimed is understated, of whatever kind the claim is. A statement is of the version that is named: "
        f"its order holds within {NEAR:g}, and is another from 0.5 away; a bound is contradicted from ten times of it.",
        "Not judged: order and symplecticity of an adaptive integrator (but for those with a script), and what a package "
        "does not claim.",
        f"A measure gets {audit.BUDGET:g} s; what took longer is in data/audit.csv with its reason.",
    ),
    command="pytest benchmarks/experiments/audit",
)
