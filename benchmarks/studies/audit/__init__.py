"""Are the established integrators of other packages what their packages claim?"""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.audit import cases, measures
from phasebench.benchmarks.audit.audit import BUDGET, audit
from phasebench.benchmarks.judge import evidence
from phasebench.benchmarks.judge.verdict import CONTRADICTED, HOLDS, IN_PART, UNDERSTATED, UNJUDGED
from phasebench.benchmarks.page import markdown
from phasebench.benchmarks.page.markdown import join_list
from phasebench.benchmarks.page.page import ROWS, Table, of
from phasebench.benchmarks.page.shared import picture
from phasebench.benchmarks.page.study import Claim, Number, Runs, Study
from phasebench.benchmarks.page.verdict import NONE
from phasebench.benchmarks.store.cells import ALONE, Package, Rows
from phasebench.integrators.registry import method
from phasebench.reference.peers import BY_ID

from . import modes, statements, unregistered

#: Rows of the packages; of them, claims and statements that could be judged, and those that do not hold.
OWN = "package == 'phasebench'"
THEIRS = f"not ({OWN})"
GOOD, BAD = f"verdict in {[HOLDS, UNDERSTATED]}", f"verdict in {[IN_PART, CONTRADICTED]}"
JUDGED = f"({GOOD} or {BAD})"
#: Characters of a statement that the table quotes; the CSV has the whole statement.
QUOTED = 32
#: Differences of orders beyond this are drawn at the edge.
SHOWN = 3.2
#: What a claim is called in the figure, by its verdict.
LABELS = {HOLDS: "claim holds", CONTRADICTED: "claim contradicted", UNJUDGED: "claim not judged"}


def measure(peer: str) -> Rows:
    """Audit one integrator: a row for each measure on each problem, and one for each judged claim."""
    found = audit([peer])
    return {"audit": found.rows, "audit_claims": found.claims}


def script_needs(script: str) -> list[object]:
    """What the rows of a script depend on."""
    members = statements.BY_SCRIPT[script]
    path = statements.file_of(script)
    texts = [p.read_text(encoding="utf-8") for p in (path, path.with_name("shared.py"), path.with_name("__main__.py"))]
    return [*texts, *map(repr, members), Package(members[0].package)]


def packages(bad: pd.DataFrame) -> str:
    """How many rows each package has, the most first, as "3 of p and 1 of q"; "all of p" if there is only p."""
    counts = bad.groupby("package").size().sort_values(ascending=False, kind="stable")
    if len(counts) == 1:
        return f"{'all ' if len(bad) > 1 else ''}of {counts.index[0]}"
    return join_list([f"{n} of {package}" for package, n in counts.items()])


def false_claims(rows: pd.DataFrame) -> str:
    """The packages of claims that do not hold, and two of them."""
    bad = rows.query(BAD)
    names = [f"{r.peer} ({r.claim})" for r in bad.itertuples()]
    return f"{packages(bad)}: {join_list(names, 2)}" if names else ""


def untrue(rows: pd.DataFrame) -> str:
    """The packages of statements that do not hold, and the worst."""
    bad = by_severity(rows.query(BAD))
    return "".join(f"{packages(bad)}; worst: {r.package}, {r.severity} ({r.script})" for r in bad.head(1).itertuples())


def by_severity(frame: pd.DataFrame) -> pd.DataFrame:
    """Statements, the worst first."""
    place = {s: i for i, s in enumerate(statements.SEVERITIES)}
    return frame.sort_values("severity", key=lambda s: s.map(place).fillna(len(place)), kind="stable")


@picture(
    ("audit", "audit_claims"), "audit", "measured minus claimed orders",
    "Measured minus claimed order, one mark for each integrator and problem; grey: within "
    f"±{evidence.GATE}, as claimed; values beyond ±{SHOWN} are drawn at the edge.",
)  # fmt: skip
def draw(found: pd.DataFrame, claimed: pd.DataFrame) -> style.Figure | None:
    """Draw measured minus claimed orders, one line for each package."""
    orders = claimed.query("property == 'order'")[["peer", "claim", "verdict"]]
    found = found.query(f"{THEIRS} and measure == 'order' and status == 'ok' and value == value")
    seen = found.merge(orders, on="peer")
    if seen.empty:
        return None
    apart = (seen["value"] - seen["claim"].str.split().str[-1].astype(float)).clip(-SHOWN, SHOWN)
    place, names = pd.factorize(seen["package"])
    peers = seen.groupby("package")["peer"]
    y = place + 0.6 * (peers.transform(lambda x: pd.factorize(x)[0]) / (peers.transform("nunique") - 1).clip(1) - 0.5)
    labels = seen["verdict"].map(LABELS).fillna(LABELS[HOLDS])
    figure, ((axes,),) = style.panels(1, 1, 1.1 + 0.32 * len(names))
    axes.axvspan(-evidence.GATE, evidence.GATE, color="0.9")
    for k, label in enumerate(LABELS.values()):
        look = {"color": style.CURVES[k][0], "marker": style.CURVES[k][2], "linestyle": "none"}
        axes.plot(apart[labels == label], y[labels == label], label=label, markersize=4, **look)
    axes.set_yticks(np.arange(len(names)), names)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_xlabel("measured − claimed order")
    axes.grid(axis="x", color="0.93", linewidth=0.5)
    style.legend_above(figure, axes, 3)
    return figure


@of("audit", "audit_claims", "audit_statements", "audit_modes", "audit_unregistered")
def table(
    found: pd.DataFrame, claimed: pd.DataFrame, stated: pd.DataFrame, changed: pd.DataFrame, left: pd.DataFrame
) -> Table:
    """Statements, changed floating-point modes, claims that no statement covers, integrators that could not be run."""
    stated = by_severity(stated.astype(object).fillna(""))
    spoken = set(" ".join(stated["covers"]).split())
    claimed = claimed[~(claimed["peer"] + ":" + claimed["property"]).isin(spoken)].query(THEIRS)
    changed = changed.query(f"status == 'ok' and mode != '{modes.KEPT}'").groupby(
        ["package", "version", "mode"], sort=False
    )
    away = found.query(f"{THEIRS} and measure == 'package' and status != 'ok'").fillna({"reason": ""})
    lines = [
        *(statement_line(r) for v in (CONTRADICTED, UNDERSTATED) for r in stated[stated["verdict"] == v].itertuples()),
        *((f"{package} {version}", f"(nothing) {join_list(list(part['peer']), 3)}",
           "2⁻¹⁰⁷⁴ + 0 is 0 afterwards in its process", f"floating-point mode {mode}",
           "restore the mode (fesetenv) at the end of a call", "") for (package, version, mode), part in changed),
        *((f"{r.package} {r.version}", f"{r.peer}: {r.claim}", str(r.measured).split(";")[0], r.verdict,
           f"(`{r.command}`)", "")
          for v in (CONTRADICTED, IN_PART, UNDERSTATED) for r in claimed[claimed["verdict"] == v].itertuples()),
        *((package, join_list(list(part["peer"]), 3), reason[:120], status, "", "")
          for (package, status, reason), part in away.groupby(["package", "status", "reason"], sort=False)),
    ]  # fmt: skip
    caption = (
        "Contradicted statements, the worst first, then understated ones; integrators that change the processor's "
        "mode; claims, contradicted ones first; integrators that could not be run. Each script (`python "
        f"benchmarks/studies/audit/scripts NAME`) printed the numbers beside it. Not audited: {left['name'].count()} "
        "integrators and options, listed in data/audit_unregistered.csv."
    )
    if len(lines) > ROWS:
        files = "data/audit_statements.csv, data/audit_modes.csv and data/audit_claims.csv"
        caption += f" {len(lines) - ROWS} more are in {files}."
    columns = ["package", "said", "measured", "verdict", "what would mend it", "script"]
    return Table(pd.DataFrame(lines[:ROWS], columns=columns), caption)


def statement_line(r: Any) -> tuple:
    """The line of a statement."""
    said = f"[“{markdown.plain(quote(r.said, r.where))}”]({r.link})"
    verdict = f"{r.verdict}: {r.severity}" if r.severity else r.verdict
    return f"{r.package} {r.version}", said, r.shows, verdict, r.mend, r.script


def quote(text: str, where: str) -> str:
    """The first words of a statement; of an attribute, the class in front of it, as in "A.order = 3"."""
    if (attribute := where.rpartition(".")[2]) and text.startswith(f"{attribute} = "):
        return where.partition(":")[2].rpartition(".")[0] + f".{text}"
    return text if len(text) <= QUOTED else text[:QUOTED].rsplit(" ", 1)[0] + " …"


@of("audit_statements")
def whole(stated: pd.DataFrame) -> pd.DataFrame:
    """All statements, what their scripts printed, and what would mend them."""
    return stated[["package", "said", "where", "verdict", "printed", "mend", "script"]].astype(object).fillna("")


STUDY = Study(
    id="audit",
    place=350,
    question="Are the established integrators what their packages claim?",
    answer="{false.n} of {false.of} claims by {packages} packages do not hold{false.where}; {untrue.n} of {untrue.of} "
    "other statements of packages' documentation do not hold.",
    setting=(
        "Every integrator is a black box (q₀, p₀, h, n) → (q, p), called through its package at constant steps "
        "(desolver through adaptation_fn, since its own loop changes the step of implicit methods).",
        "Claims are a package's own words or attributes. Other statements of its documentation are tested by short "
        "scripts that need that package alone.",
        "Order: the slope of the error over a ladder of steps, with a 95 % interval, against a certified reference. "
        "Reversibility: out and back. Symplecticity: MᵀJM − J of a step's Jacobian M.",
        f"Energy: its drift with an interval over {measures.SHORTEST} to {measures.LONG} steps. Stability: where the "
        "matrix of a step on the oscillator has bounded powers. Orbits are in general position.",
        f"Floating-point mode: whether the smallest double, 2⁻¹⁰⁷⁴, survives an addition after {modes.STEPS} steps; "
        "where it does not, later code in that process loses numbers below 2⁻¹⁰²².",
    ),
    runs=(
        Runs("audit", measure, [{"peer": id} for id in (*BY_ID, *cases.CONTROLS)], where=ALONE, more=("audit_claims",),
             needs=lambda peer: [BY_ID[peer] if peer in BY_ID else method(peer), *map(repr, cases.BY_NAME.values())]),
        Runs("audit_statements", statements.measure, [{"script": s} for s in statements.BY_SCRIPT], needs=script_needs),
        Runs("audit_unregistered", unregistered.measure, [{"package": p} for p in unregistered.LOOKS],
             needs=lambda package: [Package(package), *modes.IDS[package]]),
        Runs("audit_modes", modes.measure, [{"package": p} for p in modes.IDS],
             needs=lambda package: [BY_ID[id] if id in BY_ID else method(id) for id in modes.IDS[package]]),
    ),
    claims={
        "claims": Claim(
            "Packages' claims of order, symplecticity, reversibility and energy hold",
            "audit_claims", GOOD, rows=f"{THEIRS} and {JUDGED}", unit="claims", where=false_claims,
        ),
        "statements": Claim(
            "Statements in the packages' documentation hold when they are tested",
            "audit_statements", GOOD, rows=JUDGED, unit="statements", where=untrue,
        ),
        "modes": Claim(
            "A run leaves the process's floating-point mode as it found it",
            "audit_modes", f"mode == '{modes.KEPT}'", rows=f"{THEIRS} and status == 'ok'", unit="integrators",
            where="{peer}", names=3,
        ),
        "controls": Claim(
            "Methods of this suite, audited as controls, come out as declared",
            "audit_claims", f"verdict == '{HOLDS}'", rows=OWN, unit="claims", fault=True,
            where="{peer} ({claim})", names=3,
        ),
    },
    checks={
        "own modes": Claim(
            "Methods of this suite leave the process's floating-point mode as they found it",
            "audit_modes", f"mode == '{modes.KEPT}'", rows=f"{OWN} and status == 'ok'", where="{peer}", fault=True,
        ),
    },
    numbers={
        "false": Claim(
            "Claims do not hold", "audit_claims", BAD, NONE, f"{THEIRS} and {JUDGED}",
            where=lambda rows: "".join(f" ({packages(bad)})" for bad in [rows.query(BAD)] if len(bad)),
        ),
        "packages": Number("audit_claims", lambda rows: rows["package"].nunique(), f"{THEIRS} and {JUDGED}"),
        "untrue": Claim("Statements do not hold", "audit_statements", BAD, NONE, JUDGED),
    },
    limits=(
        "An order is contradicted where on two problems, and against none, its whole interval is more than "
        f"{evidence.GATE} from the claim, at another integer. A package that does better than it claims understates.",
        f"A defect above {evidence.BROKEN:g} times the floor breaks a property; a smaller one counts only where "
        f"classical Runge–Kutta's defect and the integrator's own error are {evidence.VISIBLE:g} times the floor.",
        f"A statement is of the version that is named. A stated order holds within {statements.NEAR:g} and is "
        f"contradicted from {statements.APART:g} on, a bound from ten times its value.",
        "Not judged: order and symplecticity of adaptive integrators (except by a script), and what is not claimed.",
        f"A measure gets {BUDGET:g} s; one that took longer is in data/audit.csv with its reason.",
    ),
    figure=draw,
    shown=table,
    whole=whole,
)  # fmt: skip
