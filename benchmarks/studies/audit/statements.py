"""Statements of packages' documentation (statements.toml) and the verdicts on them, from what scripts print."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path

from phasebench.benchmarks.judge.verdict import CONTRADICTED, HOLDS, UNDERSTATED, UNJUDGED, worst
from phasebench.reference.installed import version_of

from .scripts.shared import MARK, file_of

#: A script that takes longer is stopped.
SECONDS = 120.0
#: Severities of a statement that does not hold, the worst first.
SEVERITIES = ("wrong states", "lower accuracy", "structure lost", "wrong label")
#: A stated order holds if the measured one is within this; it is contradicted from a difference of `APART` on.
NEAR, APART = 0.3, 0.5
#: A bound is contradicted from this multiple on.
BEYOND = 10
#: A condition of statements.toml; the numbers beside "<" may be products.
CONDITION = re.compile(r"(.*) (<|<=|~|==|in) (.*)")


@dataclass(frozen=True)
class Statement:
    """A statement of a package's documentation; statements.toml describes the attributes."""

    script: str
    package: str
    said: str
    where: str
    link: str
    expected: tuple[str, ...]
    shows: str
    otherwise: str = CONTRADICTED
    severity: str = ""
    mend: str = ""
    covers: tuple[str, ...] = ()

    def verdict(self, values: list[str]) -> str:
        """The worst verdict of the conditions on the printed values."""
        each = [c.replace("{}", f"{{{k}}}") for c in self.expected for k in range(len(values) if "{}" in c else 1)]
        found = worst(judge(c, values) for c in each) if each else UNJUDGED
        return self.otherwise if found == CONTRADICTED else found


def judge(condition: str, values: list[str]) -> str:
    """The verdict on a condition, such as "{0} ~ 4"."""
    left, relation, right = CONDITION.fullmatch(condition).groups()
    left, right = left.format(*values), right.format(*values)
    if relation == "==":
        return HOLDS if left == right else CONTRADICTED
    if relation == "in":
        return HOLDS if left in right.split("; ") else CONTRADICTED
    small, large = map(_product, (left, right))
    if relation == "<":
        return HOLDS if small < large else CONTRADICTED
    if relation == "<=":
        return HOLDS if abs(small) <= large else UNJUDGED if abs(small) <= BEYOND * large else CONTRADICTED
    if abs(small - large) < NEAR:
        return HOLDS
    return UNJUDGED if abs(small - large) < APART else UNDERSTATED if small > large else CONTRADICTED


def _product(text: str) -> float:
    first, _, second = text.partition(" * ")
    return float(first) * float(second or 1)


def _read() -> dict[str, list[Statement]]:
    told = tomllib.loads(Path(__file__).with_name("statements.toml").read_text(encoding="utf-8"))
    links = told.pop("links")
    out = {}
    for script, members in told.items():
        package = next(p for p in links if p.startswith(script.partition("_")[0]))
        given = [{k: tuple(v) if isinstance(v, list) else v for k, v in of.items()} for of in members]
        out[script] = [Statement(**{"script": script, "package": package, "link": links[package]} | of) for of in given]
    return out


#: Script -> the statements that it tests.
BY_SCRIPT = _read()


def run(script: str) -> tuple[list[str], str, str]:
    """Run a script: (the printed values, the printed lines as one text, the reason if there are none)."""
    command = [sys.executable, str(file_of(script).parent), script]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS, check=False)
    except subprocess.TimeoutExpired:
        return [], "", f"it took more than {SECONDS:g} s"
    lines = [line.removeprefix(MARK) for line in done.stdout.splitlines() if line.startswith(MARK)]
    if done.returncode or not lines:
        return [], "", (done.stderr.strip().splitlines() or ["it printed nothing"])[-1][:200]
    return [line.rsplit(" = ", 1)[1] for line in lines], "; ".join(lines), ""


def row(statement: Statement, values: list[str], lines: str = "", reason: str = "") -> dict:
    """The row of a statement; without values it is not judged, for the given reason."""
    return {
        "package": statement.package,
        "version": version_of(statement.package) or "absent",
        "script": statement.script,
        "said": statement.said,
        "where": statement.where,
        "link": statement.link,
        "verdict": statement.verdict(values) if values else UNJUDGED,
        "shows": statement.shows.format(*values) if values else "",
        "printed": lines,
        "reason": reason,
        "severity": statement.severity,
        "mend": statement.mend,
        "covers": " ".join(statement.covers),
    }


def measure(script: str) -> list[dict]:
    """Run a script: a row for each statement that it tests."""
    found = run(script)
    return [row(s, *found) for s in BY_SCRIPT[script]]
