"""Coefficient tables as they stand in the sources of other packages, checked by order conditions and integrations.

The numbers are in ``transcribed.toml`` with repository, path, line and date: facts, transcribed by a script from the
sources and compared with them again.  They are compared with this project's tables too.  The order that the conditions
show is confirmed by integrations in many digits, in the sequence of substeps in which the package composes the numbers.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from itertools import chain, pairwise
from pathlib import Path
from typing import Any

import mpmath
import numpy as np

from phasebench.benchmarks.measure import multiprecision
from phasebench.benchmarks.measure.coefficients import DIGITS_EXPLAIN, DOUBLES, EXACT, PRINTED, is_rounded, shift
from phasebench.benchmarks.measure.metrics import Order
from phasebench.benchmarks.measure.metrics import order as fit_order
from phasebench.integrators.coefficients import trees
from phasebench.integrators.coefficients.fractions import DIGITS, mirror
from phasebench.integrators.coefficients.order_conditions import conditions, residuals
from phasebench.integrators.coefficients.table import Table
from phasebench.integrators.compile.codegen import precision
from phasebench.integrators.compile.lazy import sympy as sp
from phasebench.integrators.record import BOUNDED, NONE, Method
from phasebench.integrators.systems.formula import parse

from .acta import find_table, numbers_of
from .coefficients import order_from

FILE = Path(__file__).with_name("transcribed.toml")
RUNGE_KUTTA, COMPOSITION, NEAR_INTEGRABLE = "runge-kutta", "composition", "near-integrable"
#: Residuals below this are rounding, for numbers that are computed, not printed.
COMPUTED = mpmath.mpf("1e-40")
#: Orders are measured on this system, over the first of these times on which the errors are above the numbers' rounding:
#: (time, numbers of steps).
SYSTEM = "henon-heiles"
SPANS = ((Fraction(1, 256), (1, 2, 3, 4)), (Fraction(1, 2), (3, 4, 6, 8, 12, 16, 24)))
#: Parts of the time in each of which the reference is extrapolated.
PIECES = 32
#: An order of at most this many powers of h is looked for beyond the one that is stated.
BEYOND = 1
_DECIMAL = re.compile(r"\d+\.\d+")
_NUMBER = re.compile(r"\d+\.\d*|\d{7,}")


@dataclass(frozen=True)
class Transcribed:
    """A coefficient table transcribed from the source of another package.

    Attributes
    ----------
    package, repository, path, line, commit, date : where the table stands, and when it was read
    name : what the package calls it
    kind : "runge-kutta", "composition", "near-integrable" and the like, which decides how its order is computed
    stated : the order that the package states, an entry for each power of eps for A + eps B; () where it states none
    named : the order of the published method it is named after, where none is stated
    ours : the name of this project's table with the same numbers, "" if there is none
    numbers : "gamma" (fractions of a composition), "a" and "b" (weights of a splitting), or "A" and "b" (matrix, row by
        row, and weights of a Runge-Kutta method) -> the numbers, as texts
    first : the letter of the first substep, "A" or "B"
    mirrored : True if the source has only the first half of a symmetric table
    used : what the package uses it for, if not to integrate the motion
    remark : further words on it
    """

    package: str
    repository: str
    path: str
    line: int
    commit: str
    date: str
    name: str
    kind: str
    stated: tuple[int, ...]
    named: tuple[int, ...]
    ours: str
    numbers: Mapping[str, Sequence[Any]]
    first: str
    mirrored: bool
    used: str = ""
    remark: str = ""

    @property
    def expected(self) -> tuple[int, ...]:
        """The order that is stated or, if none is, that of the method after which the table is named."""
        return self.stated or self.named

    @property
    def texts(self) -> list[str]:
        """Every number as text."""
        rows = [*self.numbers.get("A", ()), *(self.numbers.get(k, ()) for k in ("gamma", "a", "b"))]
        return [text for row in rows for text in row]

    @property
    def decimals(self) -> int | None:
        """Decimals of the number printed with the fewest decimals; None if all numbers are computed, not printed."""
        return min((len(x.partition(".")[2]) for x in printed(self)), default=None)

    def steps(self, change: int = EXACT) -> list:
        """Return the whole sequence of substeps: fractions of a composition, or pairs (letter, weight) of a splitting.

        ``change`` alters the last digits of the numbers, as in `evaluate`.
        """
        if self.kind == COMPOSITION:
            gamma = [evaluate(x, change) for x in self.numbers["gamma"]]
            return list(mirror(gamma)) if self.mirrored else gamma
        a, b = ([evaluate(x, change) for x in self.numbers[k]] for k in "ab")
        weights = {"a": tuple(self.numbers["a"]), "b": tuple(self.numbers["b"])}
        form = Table(
            self.name, self.kind, self.expected, self.path, (), first=self.first, symmetric=self.mirrored, **weights
        )
        return form.steps([*a, *b])


@cache
def read() -> tuple[Transcribed, ...]:
    """Read every transcribed table of `FILE`, in its order."""
    out = []
    for row in tomllib.loads(FILE.read_text(encoding="utf-8"))["table"]:
        numbers = {key: row.pop(key) for key in ("gamma", "a", "b", "A") if key in row}
        row = row | {"stated": tuple(row.pop("order", ())), "named": tuple(row.pop("named", ()))}
        mirrored, first, ours = row.pop("mirror", False), row.pop("first", ""), row.pop("ours", "")
        out.append(Transcribed(**row, numbers=numbers, mirrored=mirrored, first=first, ours=ours))
    return tuple(out)


def find(package: str, name: str) -> Transcribed:
    """Return the transcribed table of a package with the given name."""
    return next(t for t in read() if (t.package, t.name) == (package, name))


@cache
def evaluate(text: str, change: int = EXACT) -> mpmath.mpf:
    """Evaluate a number or expression in `DIGITS` digits; its decimals are taken as exact fractions, not as doubles.

    ``change`` alters every rounded number in the expression by a unit of its last digit, up or down: `EXACT` not at
    all, `PRINTED` in the last printed digit, `DOUBLES` in the last digit that is both printed and resolved by doubles.
    """
    decimals: dict[str, Any] = {}

    def name(found: re.Match) -> str:
        value = Fraction(found[0])
        if change and is_rounded(found[0]):
            value += shift(found[0], change)
        decimals[f"x{len(decimals)}_"] = sp.Rational(value)
        return [*decimals][-1]

    with mpmath.workdps(DIGITS):
        return mpmath.mpf(str(sp.N(parse(_NUMBER.sub(name, text), decimals), DIGITS + 10)))


def printed(table: Transcribed) -> list[str]:
    """Return the distinct rounded decimals in a table, as texts."""
    found = (x for text in table.texts for x in _DECIMAL.findall(text))
    return list(dict.fromkeys(filter(is_rounded, found)))


def tableau(table: Transcribed, change: int = EXACT) -> tuple[np.ndarray, np.ndarray]:
    """Return the matrix (s, s) and weights (s,) of a transcribed Runge-Kutta method; ``change`` as in `evaluate`."""
    b = np.array([evaluate(x, change) for x in table.numbers["b"]], dtype=object)
    A = np.full((len(b), len(b)), mpmath.mpf(0), dtype=object)
    for i, row in enumerate(table.numbers["A"], 1):
        A[i, : len(row)] = [evaluate(x, change) for x in row]
    return A, b


def _residuals(table: Transcribed, limit: int, change: int = EXACT) -> dict[tuple[int, int], mpmath.mpf]:
    """Map (degree, power of eps) -> the largest residual of a table's order conditions, up to degree ``limit``."""
    if table.kind == RUNGE_KUTTA:
        A, b = tableau(table, change)
        return {(n, 0): trees.order_residual(A, b, [n]) for n in range(1, limit + 1)}
    found = residuals(table.kind, table.steps(change), limit)
    return {key: max(map(abs, r), default=mpmath.mpf(0)) for key, r in found.items()}


def order_of(table: Transcribed) -> tuple[tuple[int, ...], float]:
    """Compute (the order that the order conditions show, the largest residual up to the expected order) of a table."""
    limit = max(table.expected) + BEYOND
    found, shifted = _residuals(table, limit), _residuals(table, limit, change=DOUBLES)
    kept = conditions(found, table.expected)
    rounding = max(abs(shifted[key] - found[key]) for key in kept)
    zero = {key: r <= max(COMPUTED, DIGITS_EXPLAIN * rounding) for key, r in found.items()}
    return order_from(zero, len(table.expected)), float(max(found[key] for key in kept))


def weights(table: Transcribed, change: int) -> tuple[tuple, tuple]:
    """Return the weights (a, b) of drifts and kicks, each kick before its drift.

    A composition is one of drift-kick-drift steps; ``change`` is as in `evaluate`.
    """
    steps = table.steps(change)
    if table.kind == COMPOSITION:
        halves = [0, *steps, 0]
        drifts = [("A", (g + after) / 2) for g, after in pairwise(halves)]
        kicks = [("B", g) for g in steps]
        steps = [*chain(*zip(drifts, kicks, strict=False)), drifts[-1]]
    kicks = [] if steps[0][0] == "B" else [mpmath.mpf(0)]
    return tuple(w for s, w in steps if s == "A"), (*kicks, *(w for s, w in steps if s == "B"))


def method_of(table: Transcribed, change: int = EXACT) -> Method:
    """Make a `Method` that runs a table's numbers as its package composes them; ``change`` as in `evaluate`."""
    if table.kind == RUNGE_KUTTA:
        A, b = tableau(table, change)
        kind = {"family": "runge_kutta", "data": (*(tuple(row[:i]) for i, row in enumerate(A)), tuple(b))}
    else:
        kind = {"family": "splitting", "data": weights(table, change)}
    facts = {"order": table.expected[-1], "symmetric": False, "symplectic": False, "energy": BOUNDED, "quadratic": NONE}
    return Method(id="transcribed", name=table.name, source=table.path, **facts, **kind)


@cache
def _reference(digits: int, span: Fraction) -> tuple:
    """Compute (system, start, state at time ``span``, its uncertainty) of the problem `SYSTEM` in ``digits`` digits."""
    with precision(digits):
        system, y = multiprecision.start(SYSTEM)
        return system, y, *multiprecision.flow(system, y, span, PIECES)


def measured_order(table: Transcribed, rounding: float) -> Order:
    """Measure the order by integrations in many digits, composed as the package does; NaN where rounding hides it.

    Errors near those of rounding are left out: up to three times the effect of a change of the numbers' last digits,
    and up to ten times that of residuals of the order conditions of size ``rounding``.
    """
    with mpmath.workdps(DIGITS):
        records = method_of(table), method_of(table, PRINTED)
    digits = multiprecision.digits(records[0])
    for span, ladder in SPANS:
        system, y, end, doubt = _reference(digits, span)
        with precision(digits):
            ends = [multiprecision.advance(system, records[0], y, span / n, n) for n in ladder]
            moved = multiprecision.advance(system, records[1], y, span / ladder[0], ladder[0])
            noise = max(10 * doubt, 3 * max(abs(moved - ends[0])), 10 * rounding * float(span))
            errors = [float(max(abs(x - end))) for x in ends]
        found = fit_order([float(span / n) for n in ladder], errors, noise=float(noise))
        if found.points:
            break
    return found


def _candidates(ours: str) -> list[mpmath.mpf]:
    """Return the numbers that a package may print for the method of this project's table ``ours``.

    They are its coefficients, the weights of its substeps, the lengths of the steps if the method is written as a
    composition of a first-order method and its adjoint, and half of each of these.
    """
    table = find_table(ours)
    numbers = numbers_of(table)
    steps = table.steps(numbers)
    weights = [s if table.gamma else s[1] for s in steps]
    halves, last = [], mpmath.mpf(0)
    for w in weights:
        last = w - last
        halves.append(last)
    return [y for x in (*numbers, *weights, *halves) for y in (x, x / 2)]


def digits_that_hold(table: Transcribed) -> tuple[int | None, int | None]:
    """Return (printed decimals, right decimals) of the printed number with the most wrong decimals in a table.

    A decimal is right if the printed number is within one unit of this decimal from a number that this project's table
    of the same method gives (`_candidates`).  (None, None) for Runge-Kutta methods, and if there is no such table or no
    rounded number.
    """
    rounded = printed(table)
    if not table.ours or not rounded or table.kind == RUNGE_KUTTA:
        return None, None
    near = [abs(y) for y in _candidates(table.ours)]
    found = []
    with mpmath.workdps(DIGITS):
        for text in rounded:
            decimals = len(text.partition(".")[2])
            far = min(abs(mpmath.mpf(text) - y) for y in near)
            right = decimals if far <= mpmath.mpf(10) ** -decimals else max(0, int(mpmath.floor(-mpmath.log10(far))))
            found.append((right - decimals, decimals, right))
    return min(found)[1:]


def _text(order: Sequence[int]) -> str:
    return ",".join(map(str, order))


def check(table: Transcribed) -> dict[str, Any]:
    """Check a transcribed table by order conditions and against this project's table: a row, without integrations."""
    with mpmath.workdps(DIGITS):
        orders, residual = order_of(table)
        decimals, right = digits_that_hold(table)
    return {
        "package": table.package,
        "name": table.name,
        "repository": table.repository,
        "path": table.path,
        "line": table.line,
        "commit": table.commit,
        "read": table.date,
        "kind": table.kind,
        "stated order": _text(table.stated),
        "named order": _text(table.named),
        "order": _text(orders),
        "residual": residual,
        "ours": table.ours,
        "digits printed": decimals,
        "digits that hold": right,
        "used": table.used,
        "remark": table.remark,
    }


def row(table: Transcribed) -> dict[str, Any]:
    """Make a row of the table "transcribed": that of `check`, and the order measured by integrations without Numba."""
    found = check(table)
    met = all(int(p) >= q for p, q in zip(found["order"].split(","), table.expected, strict=True))
    measured = measured_order(table, found["residual"] if met else 0.0)
    return found | {"measured order": measured.value, "low": measured.low, "high": measured.high}
