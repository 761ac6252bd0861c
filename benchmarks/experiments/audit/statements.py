"""What the packages' documentation states besides the four claims of `judge`, each with the script that tests it.

A script of `scripts/` runs without this suite: it prints lines "name = value".  The verdict on a statement, and what is
shown of it, are functions of these values; the words are quoted as the installed package has them (a test looks).
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from phasebench.benchmarks.rows.cells import POOL, Cell, Rows, content
from phasebench.reference.tables import version_of

from .judge import CONTRADICTED, HOLDS, UNDERSTATED, UNJUDGED

SCRIPTS = Path(__file__).parent / "scripts"
#: A script that takes longer is stopped.
SECONDS = 120.0
#: How bad it is where a statement does not hold, the worst first.
WRONG, LOWER, STRUCTURE, LABEL = "wrong states", "lower accuracy", "structure lost", "wrong label"
SEVERITIES = (WRONG, LOWER, STRUCTURE, LABEL)
#: An order is what is said where it is this near, and another one where it is farther than half.
NEAR = 0.3
#: Differences of a few units of round-off, after some hundred steps.
ROUND_OFF = 1e-12

Values = list[str]


@dataclass(frozen=True)
class Statement:
    """A statement of a package's documentation.

    Attributes
    ----------
    script : its name in `SCRIPTS`, without the ending
    package : the package
    said : the words, quoted
    where : "module:name" whose documentation (or value) has them, "readme:package" or "rebound:integrator"
    link : where they can be read
    verdict : the printed values, in their order -> one of the verdicts
    shows : the printed values in a few words, a format of them
    covers : the claims (peer, property) of which it is the script
    severity, mend : how bad it is and what would mend it, where it does not hold
    """

    script: str
    package: str
    said: str
    where: str
    link: str
    verdict: Callable[[Values], str]
    shows: str
    severity: str = ""
    mend: str = ""
    covers: tuple[tuple[str, str], ...] = ()

    @property
    def path(self) -> Path:
        """Its script."""
        return SCRIPTS / f"{self.script}.py"


def near(k: int, order: float) -> Callable[[Values], str]:
    """The k-th value is an order, said to be ``order``; a higher one is more than is said."""

    def verdict(values: Values) -> str:
        apart = float(values[k]) - order
        if abs(apart) < NEAR:
            return HOLDS
        if abs(apart) < 0.5:
            return UNJUDGED
        return UNDERSTATED if apart > 0 else CONTRADICTED

    return verdict


def below(bound: float, *which: int) -> Callable[[Values], str]:
    """The values (all, or those at ``which``) are at most ``bound`` in size; ten times as much contradicts it."""

    def verdict(values: Values) -> str:
        largest = max(abs(float(values[k])) for k in (which or range(len(values))))
        return HOLDS if largest <= bound else CONTRADICTED if largest > 10 * bound else UNJUDGED

    return verdict


def every(*verdicts: Callable[[Values], str]) -> Callable[[Values], str]:
    """The worst of several verdicts; more than is said nowhere but where nothing is less."""

    def verdict(values: Values) -> str:
        found = {v(values) for v in verdicts}
        return next((x for x in (CONTRADICTED, UNJUDGED, UNDERSTATED) if x in found), HOLDS)

    return verdict


def a_l_stable(values: Values) -> str:
    """Pairs of how far |R| is above 1 on the imaginary axis and of |R| far out."""
    above, far = max(map(float, values[::2])), max(map(float, values[1::2]))
    return HOLDS if above <= ROUND_OFF and far < 1e-4 else CONTRADICTED


def constant_steps(values: Values) -> str:
    """Every list of steps repeats its first one."""
    return HOLDS if all(len(set(v.split(", "))) == 1 for v in values) else CONTRADICTED


def same(i: int, j: int) -> Callable[[Values], str]:
    """Two printed values are the same text."""
    return lambda values: HOLDS if values[i] == values[j] else CONTRADICTED


def differs(k: int) -> Callable[[Values], str]:
    """The k-th value, a difference that there should be, is not 0."""
    return lambda values: HOLDS if float(values[k]) > 0 else CONTRADICTED


def denied(flag: int, difference: int) -> Callable[[Values], str]:
    """A structure that a flag denies is there where the difference from a method that has it is of round-off."""
    return lambda v: UNDERSTATED if v[flag] == "False" and float(v[difference]) < ROUND_OFF else HOLDS


def steps_near(asked: tuple[float, ...], apart: float) -> Callable[[Values], str]:
    """The steps taken are those asked for but for a part ``apart`` of them."""
    return lambda values: (
        HOLDS if all(abs(float(v) / a - 1) <= apart for v, a in zip(values, asked, strict=True)) else CONTRADICTED
    )


def printed(output: str) -> dict[str, str]:
    """The lines "name = value" of a script's output; other lines (packages print too) are left out."""
    return dict(line.rsplit(" = ", 1) for line in output.splitlines() if " = " in line)


def run(path: Path) -> tuple[list[str], str, str]:
    """(the printed values, the printed lines, why there are none) of a script."""
    try:
        done = subprocess.run([sys.executable, str(path)], capture_output=True, text=True, timeout=SECONDS, check=False)
    except subprocess.TimeoutExpired:
        return [], "", f"it took more than {SECONDS:g} s"
    values = printed(done.stdout)
    if done.returncode or not values:
        return [], "", (done.stderr.strip().splitlines() or ["it printed nothing"])[-1][:200]
    return list(values.values()), "; ".join(f"{k} = {v}" for k, v in values.items()), ""


def row(statement: Statement, values: Values, lines: str = "", reason: str = "") -> dict:
    """A statement judged from what its script printed; not judged where it printed nothing, for that reason."""
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
        "covers": " ".join(f"{peer}:{name}" for peer, name in statement.covers),
    }


def measured(script: str) -> Rows:
    """The rows of the statements that a script tests."""
    from .said import BY_SCRIPT

    found = run(SCRIPTS / f"{script}.py")
    return {"audit_statements": [row(s, *found) for s in BY_SCRIPT[script]]}


def cells() -> list[Cell]:
    """A cell for each script."""
    from .said import BY_SCRIPT

    return [_cell(script, members) for script, members in BY_SCRIPT.items()]


def _cell(script: str, members: list[Statement]) -> Cell:
    package = members[0].package
    texts = [(s.said, s.shows, s.severity, s.mend, s.link) for s in members]
    return Cell(
        "audit",
        ("audit_statements",),
        {"script": script},
        measured,
        (script,),
        content(
            "audit_statements",
            members[0].path.read_text(encoding="utf-8"),
            *texts,
            version_of(package) or "absent",
            code=[__name__, "phasebench.benchmarks.experiments.audit.said"],
        ),
        frozenset({package, *(peer for s in members for peer, _ in s.covers)}),
        POOL,
    )
