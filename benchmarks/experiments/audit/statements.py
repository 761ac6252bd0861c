"""Statements in packages' documentation other than the claims that `claims` judges, each tested by a script.

A script in `scripts/` runs without this suite and prints lines "name = value".  The verdict on a statement and the text
shown are functions of these values.  Statements are quoted; a test compares them with the installed package.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from phasebench.benchmarks.judge.verdict import CONTRADICTED, HOLDS, UNDERSTATED, UNJUDGED, worst
from phasebench.reference.installed import version_of

SCRIPTS = Path(__file__).parent / "scripts"
#: A script that takes longer is stopped.
SECONDS = 120.0
#: Severities of a statement that does not hold, the worst first.
WRONG, LOWER, STRUCTURE, LABEL = "wrong states", "lower accuracy", "structure lost", "wrong label"
SEVERITIES = (WRONG, LOWER, STRUCTURE, LABEL)
#: A stated order holds if the measured one is within this; it is contradicted from a difference of 0.5 on.
NEAR = 0.3
#: A difference below this is round-off, after a few hundred steps.
ROUND_OFF = 1e-12

Values = list[str]


@dataclass(frozen=True)
class Statement:
    """A statement of a package's documentation.

    Attributes
    ----------
    script : name of the script in `SCRIPTS` that tests it, without the ending
    package : the package
    said : the words, quoted
    where : source of the words: "module:name" (docstring or assigned value), "readme:package", "rebound:integrator",
        "source:module" (the module's source text), or "guide:section" of documentation that the package does not bring
    link : where they can be read
    verdict : function from the printed values, in their order, to a verdict
    shows : format string that makes a short text of the printed values
    covers : the claims (peer, property) that the same script tests
    severity, mend : how bad it is and what would mend it, if the statement does not hold
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
        """Path of the script that tests this statement."""
        return SCRIPTS / f"{self.script}.py"


def near(k: int, order: float) -> Callable[[Values], str]:
    """Make a judge of a measured order, a function of a script's printed values.

    The statement holds if the k-th value is within `NEAR` of ``order``, is understated if it is 0.5 or more above,
    contradicted if as much below, and not judged in between.
    """

    def verdict(values: Values) -> str:
        apart = float(values[k]) - order
        if abs(apart) < NEAR:
            return HOLDS
        if abs(apart) < 0.5:
            return UNJUDGED
        return UNDERSTATED if apart > 0 else CONTRADICTED

    return verdict


def below(bound: float, *which: int) -> Callable[[Values], str]:
    """Make a judge: a statement holds if |printed values| (all, or those at ``which``) are at most ``bound``.

    It is contradicted if the largest is above 10 times the bound, and not judged in between.
    """

    def verdict(values: Values) -> str:
        largest = max(abs(float(values[k])) for k in (which or range(len(values))))
        return HOLDS if largest <= bound else CONTRADICTED if largest > 10 * bound else UNJUDGED

    return verdict


def every(*verdicts: Callable[[Values], str]) -> Callable[[Values], str]:
    """Make a judge that returns the worst verdict of several judges; "understated" only if no other is worse."""
    return lambda values: worst(v(values) for v in verdicts)


def a_l_stable(values: Values) -> str:
    """Judge A- and L-stability from pairs of values of stability functions R(z): holds or contradicted.

    A pair is (max |R| - 1 on the imaginary axis, |R| far from 0), as printed by the script.
    """
    above, far = max(map(float, values[::2])), max(map(float, values[1::2]))
    return HOLDS if above <= ROUND_OFF and far < 1e-4 else CONTRADICTED


def constant_steps(values: Values) -> str:
    """Judge whether the steps are constant: the step sizes within each printed list are equal."""
    return HOLDS if all(len(set(v.split(", "))) == 1 for v in values) else CONTRADICTED


def same(i: int, j: int) -> Callable[[Values], str]:
    """Make a judge: holds if the i-th and the j-th printed value are the same text, else contradicted."""
    return lambda values: HOLDS if values[i] == values[j] else CONTRADICTED


def differs(k: int) -> Callable[[Values], str]:
    """Make a judge: holds if the k-th printed value, a difference of two runs that should differ, is above 0."""
    return lambda values: HOLDS if float(values[k]) > 0 else CONTRADICTED


def judge_denial(flag: int, difference: int) -> Callable[[Values], str]:
    """Make a judge of a package's flag that denies a structure, such as symplectic = False.

    Understated if the printed value at ``flag`` is False while the one at ``difference``, the distance from a method
    that has the structure, is round-off.
    """
    return lambda v: UNDERSTATED if v[flag] == "False" and float(v[difference]) < ROUND_OFF else HOLDS


def steps_near(asked: tuple[float, ...], apart: float) -> Callable[[Values], str]:
    """Make a judge: holds if the printed step sizes equal those in ``asked`` to a relative difference of ``apart``."""
    return lambda values: (
        HOLDS if all(abs(float(v) / a - 1) <= apart for v, a in zip(values, asked, strict=True)) else CONTRADICTED
    )


def parse_output(output: str) -> dict[str, str]:
    """Parse the lines "name = value" of a script's output; other lines are ignored, since packages print too."""
    return dict(line.rsplit(" = ", 1) for line in output.splitlines() if " = " in line)


def run(path: Path) -> tuple[list[str], str, str]:
    """Run a script: (the printed values, the printed lines as one text, the reason if there are none)."""
    try:
        done = subprocess.run([sys.executable, str(path)], capture_output=True, text=True, timeout=SECONDS, check=False)
    except subprocess.TimeoutExpired:
        return [], "", f"it took more than {SECONDS:g} s"
    values = parse_output(done.stdout)
    if done.returncode or not values:
        return [], "", (done.stderr.strip().splitlines() or ["it printed nothing"])[-1][:200]
    return list(values.values()), "; ".join(f"{k} = {v}" for k, v in values.items()), ""


def row(statement: Statement, values: Values, lines: str = "", reason: str = "") -> dict:
    """Judge a statement from the values that its script printed, and return its row of the table "audit_statements".

    ``lines`` is the printed text.  Without values the statement is not judged, for the given ``reason``.
    """
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
