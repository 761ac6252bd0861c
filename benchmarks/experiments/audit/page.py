"""The report page on established integrators: which of their packages' claims hold, and what was measured."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pandas as pd

from phasebench.benchmarks.judge import evidence
from phasebench.benchmarks.judge import verdict as judge
from phasebench.benchmarks.page import markdown
from phasebench.benchmarks.page.markdown import join_list
from phasebench.benchmarks.page.page import ROWS, Data, Page, Picture, Table, of
from phasebench.benchmarks.page.verdict import EVERY, FAIL, Count, Verdict

from . import audit, figures, measures, modes
from .statements import NEAR, SEVERITIES

if TYPE_CHECKING:
    from pathlib import Path

OWN = "phasebench"
#: Characters of a statement that the table quotes; the CSV has the whole statement.
QUOTED = 32


def records(frame: pd.DataFrame) -> list[dict]:
    """Convert a frame to a list of dicts, one a row, with None for a missing number and "" for a missing text."""
    rows = frame.astype(object).where(frame.notna(), None).to_dict("records")
    texts = ("reason", "problem", "measured", "problems", "source")
    return [r | {k: r[k] or "" for k in texts if k in r} for r in rows]


def _present(found: pd.DataFrame) -> pd.DataFrame:
    """Select from the audit's rows those that record whether an integrator's package could be loaded."""
    return found[(found["measure"] == "package") & (found["package"] != OWN)]


def _claims(found: pd.DataFrame, claimed: pd.DataFrame) -> pd.DataFrame:
    """Select from the judged claims those of integrators that, by the audit's rows ``found``, could be audited."""
    there = _present(found)
    return claimed[claimed["peer"].isin(there[there["status"] == "ok"]["peer"])]


#: The verdicts on a claim or statement that could be judged: at least as good as stated, and worse.
GOOD, BAD = (judge.HOLDS, judge.UNDERSTATED), (judge.IN_PART, judge.CONTRADICTED)


def _split(frame: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Select from claims or statements: (all that could be judged, only those that were judged not to hold)."""
    return frame[frame["verdict"].isin([*GOOD, *BAD])], frame[frame["verdict"].isin(BAD)]


@of("audit", "audit_claims")
def claims(found: pd.DataFrame, claimed: pd.DataFrame) -> Verdict | None:
    """Judge whether the claims of the packages hold; None if no claim could be judged.

    ``found`` has the rows of the audit, ``claimed`` the judged claims.
    """
    judged, bad = _split(_claims(found, claimed))
    if judged.empty:
        return None
    names = [f"{r.peer} ({r.claim})" for r in bad.itertuples()]
    return Verdict(
        "Packages' claims of order, symplecticity, reversibility and energy hold",
        Count(len(judged) - len(bad), len(judged)),
        EVERY,
        "claims",
        where=f"{_packages(bad)}: {join_list(names, 2)}" if names else "",
    )


def _packages(bad: pd.DataFrame) -> str:
    """Write how many rows each package has, the most first, as "3 of p and 1 of q"; "all of p" if there is only p."""
    counts = bad.groupby("package").size().sort_values(ascending=False, kind="stable")
    if len(counts) == 1:
        return f"{'all ' if len(bad) > 1 else ''}of {counts.index[0]}"
    return join_list([f"{n} of {package}" for package, n in counts.items()])


@of("audit_statements")
def statements(stated: pd.DataFrame) -> Verdict | None:
    """Judge whether the tested statements in the packages' documentation hold; None if none could be judged."""
    judged, bad = _split(stated)
    if judged.empty:
        return None
    worst = _by_severity(bad).head(1)
    return Verdict(
        "Statements in the packages' documentation hold when they are tested",
        Count(len(judged) - len(bad), len(judged)),
        EVERY,
        "statements",
        where="".join(f"{_packages(bad)}; worst: {r.package}, {r.severity} ({r.script})" for r in worst.itertuples()),
    )


@of(modes.TABLE)
def left_as_found(found: pd.DataFrame) -> Verdict | None:
    """Judge whether runs leave the process's floating-point mode as they found it; None if none ran."""
    seen = found[(found["status"] == "ok") & (found["package"] != OWN)]
    if seen.empty:
        return None
    wrong = _other_mode(seen)
    return Verdict(
        "A run leaves the process's floating-point mode as it found it",
        Count(len(seen) - len(wrong), len(seen)),
        EVERY,
        "integrators",
        where=join_list(list(wrong["peer"]), 3) if len(wrong) else "",
    )


def _other_mode(found: pd.DataFrame) -> pd.DataFrame:
    """Select the integrators that left the process in another floating-point mode than they found."""
    return found[(found["status"] == "ok") & (found["mode"] != modes.KEPT)]


def _by_severity(frame: pd.DataFrame) -> pd.DataFrame:
    """Sort statements by severity, the worst first."""
    place = {s: i for i, s in enumerate(SEVERITIES)}
    return frame.sort_values("severity", key=lambda s: s.map(place).fillna(len(place)), kind="stable")


@of("audit", "audit_claims")
def controls(found: pd.DataFrame, claimed: pd.DataFrame) -> Verdict | None:
    """Judge whether this project's methods, audited as controls, come out as declared; None without them.

    ``claimed`` has the judged claims, also those of the controls; ``found`` is not used.
    """
    own = claimed[claimed["package"] == OWN]
    if own.empty:
        return None
    wrong = own[own["verdict"] != judge.HOLDS]
    return Verdict(
        "Methods of this suite, audited as controls, come out as declared",
        Count(len(own) - len(wrong), len(own)),
        EVERY,
        "claims",
        where=join_list([f"{r.peer} ({r.claim})" for r in wrong.itertuples()], 3) if len(wrong) else "",
        otherwise=FAIL,
    )


def answer(data: Data) -> str | None:
    """Write the page's answer: how many claims and statements do not hold, and of which packages."""
    claimed, stated = claims(data), statements(data)
    parts = []
    if claimed is not None:
        mine = _claims(data("audit"), data("audit_claims"))
        judged, bad = _split(mine)
        whose = f" ({_packages(bad)})" if len(bad) else ""
        parts.append(f"{len(bad)} of {len(judged)} claims by {judged['package'].nunique()} packages do not hold{whose}")
    if stated is not None:
        bad, of = stated.measured.of - stated.measured.n, stated.measured.of
        parts.append(f"{bad} of {of} other statements of packages' documentation do not hold")
    if not parts and (left_as_found(data) or controls(data)):
        parts = ["No claim of a package could be judged"]
    return f"{'; '.join(parts)}." if parts else None


def _count_unaudited(left: pd.DataFrame | None) -> str:
    """Write a sentence that counts the integrators and options not audited; empty where there are none."""
    count = 0 if left is None else int((left["name"].notna() & (left["name"] != "")).sum())
    return f" Not audited: {count} integrators and options, listed in data/audit_unregistered.csv." if count else ""


@of("audit", "audit_claims")
def draw(found: pd.DataFrame, claimed: pd.DataFrame, folder: Path) -> list[Picture] | None:
    """Draw the measured minus the claimed orders of the packages' integrators; None if there are no orders.

    ``found`` has the rows of the audit, ``claimed`` the judged claims.
    """
    rows = [r for r in records(found) if r["package"] != OWN]
    file = figures.orders(rows, records(claimed), folder)
    if file is None:
        return None
    caption = (
        "Measured minus claimed order, one mark for each integrator and problem; grey: within "
        f"±{evidence.GATE}, as claimed; values beyond ±{figures.SHOWN} are drawn at the edge."
    )
    return [Picture(file, "measured minus claimed orders", caption)]


def table(data: Data) -> Table | None:
    """Make the page's table of findings; None if there are none.

    First come sentences of packages' documentation that measurements contradict, or that promise less than was
    measured; then integrators that change the process's floating-point mode; then claims that do not hold or promise
    less than was measured, unless a listed sentence covers them; and last integrators that could not be run.
    """
    stated, found, claimed = (data(name) for name in ("audit_statements", "audit", "audit_claims"))
    lines, spoken = [], set()
    if stated is not None and len(stated):
        stated = stated.astype(object).fillna("")
        spoken = {pair for text in stated["covers"] for pair in str(text).split()}
        bad = stated[stated["verdict"].isin([judge.CONTRADICTED, judge.UNDERSTATED])]
        bad = pd.concat([_by_severity(bad[bad["verdict"] == v]) for v in (judge.CONTRADICTED, judge.UNDERSTATED)])
        lines += [_statement_line(r) for r in bad.itertuples()]
    if (left := data(modes.TABLE)) is not None:
        wrong = _other_mode(left).groupby(["package", "version", "mode"], sort=False)
        lines += [_changes(*key, part) for key, part in wrong]
    if found is not None and claimed is not None:
        mine = _claims(found, claimed)
        shown = pd.concat([mine[mine["verdict"] == v] for v in (judge.CONTRADICTED, judge.IN_PART, judge.UNDERSTATED)])
        lines += [_claim(r) for r in shown.itertuples() if f"{r.peer}:{r.property}" not in spoken]
        first = _present(found)
        away = first[first["status"] != "ok"].astype(object).fillna("")
        for (package, status, reason), part in away.groupby(["package", "status", "reason"], sort=False):
            names = join_list(list(part["peer"]), 3)
            lines.append({"package": package, "said": names, "measured": str(reason)[:120], "verdict": status})
    if not lines:
        return None
    caption = (
        "Contradicted statements, the worst first, then understated ones; integrators that change the processor's mode; "
        "claims, contradicted ones first; integrators that could not be run. Each script is in benchmarks/experiments/audit/scripts/ and printed the numbers beside it."
    )
    caption += _count_unaudited(data("audit_unregistered"))
    if len(lines) > ROWS:
        caption += f" {len(lines) - ROWS} more are in data/audit_statements.csv, data/audit_modes.csv and data/audit_claims.csv."
    return Table(pd.DataFrame(lines[:ROWS]).fillna(""), caption)


def _statement_line(r: Any) -> dict:
    """Make a line of the findings' table from a judged statement: its words, what was measured, and the verdict."""
    return {
        "package": f"{r.package} {r.version}",
        "said": f"[“{markdown.plain(_quote(r.said, r.where))}”]({r.link})",
        "measured": r.shows,
        "verdict": f"{r.verdict}: {r.severity}" if r.severity else r.verdict,
        "what would mend it": r.mend,
        "script": r.script,
    }


def _claim(r: Any) -> dict:
    """Make a line of the findings' table from a judged claim: the claim, what was measured, and the verdict."""
    return {
        "package": f"{r.package} {r.version}",
        "said": f"{r.peer}: {r.claim}",
        "measured": str(r.measured).split(";")[0],
        "verdict": r.verdict,
        "what would mend it": f"(`{r.command}`)",
    }


def _changes(package: str, version: str, mode: str, part: pd.DataFrame) -> dict:
    """Make a line of the findings' table: integrators that change the process's floating-point mode.

    ``part`` has their rows; ``mode`` says when they change it, such as "changed by a run".
    """
    return {
        "package": f"{package} {version}",
        "said": f"(nothing) {join_list(list(part['peer']), 3)}",
        "measured": "2⁻¹⁰⁷⁴ + 0 is 0 afterwards in its process",
        "verdict": f"floating-point mode {mode}",
        "what would mend it": "restore the mode (fesetenv) at the end of a call",
    }


def _quote(text: str, where: str) -> str:
    """Shorten a quoted statement to its first words; put the class in front of a quoted attribute, as in "A.order = 3".

    ``where`` is the statement's source, "module:name".
    """
    if (attribute := where.rpartition(".")[2]) and text.startswith(f"{attribute} = "):
        return where.partition(":")[2].rpartition(".")[0] + f".{text}"
    return text if len(text) <= QUOTED else text[:QUOTED].rsplit(" ", 1)[0] + " …"


@of("audit_statements")
def statements_table(stated: pd.DataFrame) -> pd.DataFrame:
    """Select the columns of the page's long table: a statement, what its script printed, what would mend it."""
    return stated[["package", "said", "where", "verdict", "printed", "mend", "script"]].astype(object).fillna("")


PAGE = Page(
    id="audit",
    question="Are the established integrators what their packages claim?",
    tables=("audit", "audit_claims", "audit_statements", "audit_unregistered", modes.TABLE),
    setting=(
        "Every integrator is a black box (q₀, p₀, h, n) → (q, p), called through its package at constant steps (desolver "
        "through adaptation_fn, since its own loop changes the step of implicit methods).",
        "Claims are a package's own words or attributes. Other statements of its documentation are tested by short "
        "scripts that need that package alone.",
        "Order: the slope of the error over a ladder of steps, with a 95 % interval, against a certified reference. "
        "Reversibility: out and back. Symplecticity: MᵀJM − J of a step's Jacobian M.",
        f"Energy: its drift with an interval over {measures.SHORTEST} to {measures.LONG} steps. Stability: where the matrix "
        "of a step on the oscillator has bounded powers. Orbits are in general position.",
        f"Floating-point mode: whether the smallest double, 2⁻¹⁰⁷⁴, survives an addition after {modes.STEPS} steps; where it "
        "does not, later code in that process loses numbers below 2⁻¹⁰²².",
    ),
    verdicts=(claims, statements, left_as_found, controls),
    answer=answer,
    figures=draw,
    table=table,
    whole=statements_table,
    limits=(
        f"An order is contradicted where on two problems, and against none, its whole interval is more than {evidence.GATE} "
        "from the claim, at another integer. A package that does better than it claims understates.",
        f"A defect above {evidence.BROKEN:g} times the floor breaks a property; a smaller one counts only where classical "
        f"Runge–Kutta's defect and the integrator's own error are {evidence.VISIBLE:g} times the floor.",
        f"A statement is of the version that is named. A stated order holds within {NEAR:g} and is contradicted from 0.5 on, "
        "a bound from ten times its value.",
        "Not judged: order and symplecticity of adaptive integrators (except by a script), and what is not claimed.",
        f"A measure gets {audit.BUDGET:g} s; one that took longer is in data/audit.csv with its reason.",
    ),
    command="pytest benchmarks/experiments/audit",
)
