"""`Verdict`: a claim, the measured value, the expected one, and the case in which it is worst.

The claim is a plain sentence of at most 15 words without a measured number; whether it holds is computed here.
`markdown.verdicts_table` prints it.

>>> Verdict("every method has its declared order", Count(17, 18), EVERY, "methods", where="scheme-iv").outcome
'finding'
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

#: The outcomes; `MEANING` explains them on the entry page.
PASS, FAIL, FINDING, MISSING, LIST = "pass", "fail", "finding", "not measured", "list"
MEANING = {
    PASS: "what was measured is as expected",
    FINDING: "it is not, and that is a fact about methods, packages or the talks worth knowing",
    FAIL: "it is not, and this suite is wrong there",
    MISSING: "no row tells",
    LIST: "a catalogue, in which nothing can fail",
}
#: Outcomes, the worst first.
_ORDER = (FAIL, FINDING, PASS, MISSING)


@dataclass(frozen=True)
class Count:
    """A measured count: ``n`` of ``of`` items have the property."""

    n: int
    of: int


@dataclass(frozen=True)
class Range:
    """A measured range: the smallest and the largest value."""

    low: float
    high: float


Measured = Count | Range | float | int | None


class Condition(Protocol):
    """A condition on a measured value."""

    def met(self, measured: Measured) -> bool:
        """True if the condition holds."""

    def text(self, measured: Measured) -> str:
        """The condition in a few words."""


def _ends(measured: Measured) -> tuple[float, float]:
    """The smallest and the largest measured value; for a count both are the fraction ``n / of``."""
    if isinstance(measured, Range):
        return measured.low, measured.high
    value = measured.n / measured.of if isinstance(measured, Count) else float(measured)
    return value, value


def _format_bound(value: float, measured: Measured) -> str:
    return f"{100 * value:.4g} %" if isinstance(measured, Count) else number(value)


@dataclass(frozen=True)
class Between:
    """Condition: every value (for a count: its fraction) is between two bounds, inclusive."""

    low: float
    high: float

    def met(self, measured: Measured) -> bool:
        """True if the condition holds."""
        low, high = _ends(measured)
        return self.low <= low and high <= self.high

    def text(self, measured: Measured) -> str:
        """The condition in a few words."""
        if self.high == math.inf:
            return f"at least {_format_bound(self.low, measured)}"
        if self.low == -math.inf:
            return f"at most {_format_bound(self.high, measured)}"
        return f"{_format_bound(self.low, measured)} to {_format_bound(self.high, measured)}"


def at_most(bound: float) -> Between:
    """Condition: every value (for a count: its fraction) is at most the bound."""
    return Between(-math.inf, bound)


def at_least(bound: float) -> Between:
    """Condition: every value (for a count: its fraction) is at least the bound."""
    return Between(bound, math.inf)


@dataclass(frozen=True)
class Exactly:
    """Condition on a count: all items have the property (if ``all`` is True), or none has."""

    all: bool

    def met(self, measured: Measured) -> bool:
        """True if the condition holds."""
        return measured.n == (measured.of if self.all else 0)

    def text(self, measured: Measured) -> str:
        """The condition in a few words."""
        return f"all {measured.of}" if self.all else "none"


EVERY, NONE = Exactly(True), Exactly(False)


@dataclass(frozen=True)
class Verdict:
    """A claim and the measured value that decides it.

    Attributes
    ----------
    claim : a plain sentence of at most 15 words without a measured number, written by hand
    measured : a number, a `Range` or a `Count`; None or nan if no row decides
    expected : `at_most`, `at_least`, `Between`, `EVERY` or `NONE`
    unit : of the measured number, or the name of the counted items
    where : the case in which the measured value is worst, such as a method, a problem or a number of particles
    otherwise : the outcome if the value is not as expected: `FINDING`, or `FAIL` if that shows a fault of this suite
    """

    claim: str
    measured: Measured
    expected: Condition
    unit: str = ""
    where: str = ""
    otherwise: str = FINDING

    @property
    def outcome(self) -> str:
        """The outcome of the claim: `PASS`, `FINDING`, `FAIL` or `MISSING`."""
        empty = self.measured is None or getattr(self.measured, "of", 1) == 0
        if empty or math.isnan(sum(_ends(self.measured))):
            return MISSING
        return PASS if self.expected.met(self.measured) else self.otherwise

    def row(self) -> dict[str, str]:
        """Return the claim's row in a page's table: claim, measured, expected, outcome, where it is worst -> text."""
        missing = self.outcome == MISSING
        return {
            "claim": self.claim,
            "measured": "" if missing else f"{measured_text(self.measured)} {self.unit}".rstrip(),
            "expected": "" if missing else self.expected.text(self.measured),
            "outcome": self.outcome,
            "where it is worst": self.where,
        }


def number(value: float) -> str:
    """A measured number as text, with three significant digits."""
    if abs(value) < 1e6 and value == int(value):
        return str(int(value))
    return f"{value:.3g}" if 1e-3 <= abs(value) < 1e6 else f"{value:.2e}"


def measured_text(measured: Measured) -> str:
    """The measured value as text, without its unit: '8 of 18', '0.954 to 0.957'."""
    if isinstance(measured, Count):
        return f"{measured.n} of {measured.of}"
    if isinstance(measured, Range) and measured.low != measured.high:
        return f"{number(measured.low)} to {number(measured.high)}"
    return number(_ends(measured)[0])


def overall(verdicts: Sequence[Verdict]) -> str:
    """The outcome of a page: the worst of its verdicts; `LIST` if there are none."""
    if not verdicts:
        return LIST
    return min((v.outcome for v in verdicts), key=_ORDER.index)
