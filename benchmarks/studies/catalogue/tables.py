"""Coefficient tables as they stand in the sources of other packages, checked by order conditions and integrations.

The numbers are in ``transcribed.toml`` with repository, path, line and date: facts, transcribed by a script from the
sources and compared with them again.  They are compared with this project's tables too.  The order that the conditions
show is confirmed by integrations in many digits, in the sequence of substeps in which the package composes the numbers.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from itertools import accumulate, chain, pairwise
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pandas as pd

from phasebench.benchmarks.measure import metrics, multiprecision
from phasebench.benchmarks.measure.coefficients import DIGITS_EXPLAIN, DOUBLES, EXACT, is_rounded, shift
from phasebench.benchmarks.measure.coefficients import PRINTED as LAST_PRINTED
from phasebench.benchmarks.page.markdown import join_list
from phasebench.benchmarks.page.page import ROWS, Table, of
from phasebench.benchmarks.page.study import Claim, Number, Runs, Study
from phasebench.benchmarks.store.cells import UNCOMPILED
from phasebench.integrators.coefficients import trees
from phasebench.integrators.coefficients.fractions import DIGITS, mirror
from phasebench.integrators.coefficients.order_conditions import conditions, residuals
from phasebench.integrators.coefficients.table import Table as Coefficients
from phasebench.integrators.compile.codegen import precision
from phasebench.integrators.compile.lazy import sympy as sp
from phasebench.integrators.record import BOUNDED, NONE, Method
from phasebench.integrators.systems.formula import parse

from .exactness import (
    HOLD,
    KNOWN,
    PRINTED,
    as_text,
    digits,
    lost,
    most_lost,
    order_from,
    reaches,
    right_decimals,
    table_of,
)

TABLE, FILE = "transcribed", Path(__file__).with_name("transcribed.toml")
RUNGE_KUTTA, COMPOSITION = "runge-kutta", "composition"
#: Residuals below this are rounding, for numbers that are computed, not printed.
COMPUTED = mpmath.mpf("1e-40")
#: Orders are measured on this system, over the first of these (times, numbers of steps) with errors above rounding.
SYSTEM, SPANS = "henon-heiles", ((Fraction(1, 256), (1, 2, 3, 4)), (Fraction(1, 2), (3, 4, 6, 8, 12, 16, 24)))
#: Parts of the time in each of which the reference is extrapolated.
PIECES = 32
#: Largest difference of a measured order, or of its interval, from that of the order conditions.
GATE = 0.1
_DECIMAL, _NUMBER = re.compile(r"\d+\.\d+"), re.compile(r"\d+\.\d*|\d{7,}")


@dataclass(frozen=True)
class Transcribed:
    """A coefficient table of another package, with the entries that the head of ``transcribed.toml`` explains."""

    package: str
    repository: str
    path: str
    line: int
    commit: str
    date: str
    name: str
    kind: str
    order: tuple[int, ...] = ()
    named: tuple[int, ...] = ()
    ours: str = ""
    gamma: tuple[str, ...] = ()
    a: tuple[str, ...] = ()
    b: tuple[str, ...] = ()
    A: tuple[list[str], ...] = ()
    first: str = ""
    mirror: bool = False
    used: str = ""
    remark: str = ""

    @property
    def expected(self) -> tuple[int, ...]:
        """The order that is stated or, if none is, that of the method after which the table is named."""
        return self.order or self.named

    @property
    def printed(self) -> list[str]:
        """The distinct rounded decimals, as texts."""
        texts = chain(*self.A, self.gamma, self.a, self.b)
        return list(dict.fromkeys(x for text in texts for x in _DECIMAL.findall(text) if is_rounded(x)))

    def steps(self, change: int = EXACT) -> list:
        """All substeps: fractions of a composition, or pairs (letter, weight); ``change`` as in `evaluate`."""
        if self.kind == COMPOSITION:
            gamma = [evaluate(x, change) for x in self.gamma]
            return list(mirror(gamma)) if self.mirror else gamma
        about = {"first": self.first, "symmetric": self.mirror, "a": self.a, "b": self.b}
        form = Coefficients(self.name, self.kind, self.expected, self.path, (), **about)
        return form.steps([evaluate(x, change) for x in (*self.a, *self.b)])


@cache
def read() -> dict[tuple[str, str], Transcribed]:
    """(Package, name) -> every transcribed table, in the order of the file."""
    rows = tomllib.loads(FILE.read_text(encoding="utf-8"))["table"]
    tables = [Transcribed(**{k: tuple(v) if isinstance(v, list) else v for k, v in row.items()}) for row in rows]
    return {(t.package, t.name): t for t in tables}


@cache
def evaluate(text: str, change: int = EXACT) -> mpmath.mpf:
    """A number or expression in `DIGITS` digits; its decimals are taken as exact fractions, not as doubles.

    ``change`` alters every rounded number in it by a unit of its last digit, up or down: `EXACT` not at all,
    `LAST_PRINTED` in the last printed digit, `DOUBLES` in the last digit that is both printed and resolved by doubles.
    """
    decimals: dict[str, Any] = {}

    def name(found: re.Match) -> str:
        moved = shift(found[0], change) if change and is_rounded(found[0]) else 0
        decimals[f"x{len(decimals)}_"] = sp.Rational(Fraction(found[0]) + moved)
        return [*decimals][-1]

    with mpmath.workdps(DIGITS):
        return mpmath.mpf(str(sp.N(parse(_NUMBER.sub(name, text), decimals), DIGITS + 10)))


def tableau(table: Transcribed, change: int = EXACT) -> tuple[np.ndarray, np.ndarray]:
    """The matrix (s, s) and weights (s,) of a Runge-Kutta method; ``change`` as in `evaluate`."""
    b = np.array([evaluate(x, change) for x in table.b], dtype=object)
    A = np.full((len(b), len(b)), mpmath.mpf(0), dtype=object)
    for i, row in enumerate(table.A, 1):
        A[i, : len(row)] = [evaluate(x, change) for x in row]
    return A, b


def _residuals(table: Transcribed, change: int = EXACT) -> dict[tuple[int, int], mpmath.mpf]:
    """(Degree, power of eps) -> the largest residual of the conditions, up to a degree beyond the expected order."""
    limit = max(table.expected) + 1
    if table.kind == RUNGE_KUTTA:
        A, b = tableau(table, change)
        return {(n, 0): trees.order_residual(A, b, [n]) for n in range(1, limit + 1)}
    found = residuals(table.kind, table.steps(change), limit)
    return {key: max(map(abs, r), default=mpmath.mpf(0)) for key, r in found.items()}


def order_of(table: Transcribed) -> tuple[tuple[int, ...], float]:
    """(The order that the order conditions show, the largest residual up to the expected order)."""
    found, shifted = _residuals(table), _residuals(table, DOUBLES)
    kept = conditions(found, table.expected)
    rounding = max(abs(shifted[key] - found[key]) for key in kept)
    zero = {key: r <= max(COMPUTED, DIGITS_EXPLAIN * rounding) for key, r in found.items()}
    return order_from(zero, len(table.expected)), float(max(found[key] for key in kept))


def method_of(table: Transcribed, change: int = EXACT) -> Method:
    """The method that runs the numbers as the package composes them; of a composition, drift-kick-drift steps."""
    if table.kind == RUNGE_KUTTA:
        A, b = tableau(table, change)
        kind = {"family": "runge_kutta", "data": (*(tuple(row[:i]) for i, row in enumerate(A)), tuple(b))}
    else:
        steps = table.steps(change)
        if table.kind == COMPOSITION:
            drifts = [("A", (g + after) / 2) for g, after in pairwise([0, *steps, 0])]
            steps = [*chain(*zip(drifts, (("B", g) for g in steps), strict=False)), drifts[-1]]
        kicks = [] if steps[0][0] == "B" else [mpmath.mpf(0)]  # each kick before its drift
        weights = tuple(w for s, w in steps if s == "A"), (*kicks, *(w for s, w in steps if s == "B"))
        kind = {"family": "splitting", "data": weights}
    facts = {"order": table.expected[-1], "symmetric": False, "symplectic": False, "energy": BOUNDED, "quadratic": NONE}
    return Method(id="transcribed", name=table.name, source=table.path, **facts, **kind)


@cache
def _reference(digits: int, span: Fraction) -> tuple:
    """(System, start, state at time ``span``, its uncertainty) of the problem `SYSTEM` in ``digits`` digits."""
    with precision(digits):
        system, y = multiprecision.start(SYSTEM)
        return system, y, *multiprecision.flow(system, y, span, PIECES)


def measured_order(table: Transcribed, rounding: float) -> metrics.Order:
    """The order by integrations in many digits, composed as the package does; NaN where rounding hides it.

    Errors are left out up to three times the effect of a change of the numbers' last digits, and up to ten times that
    of residuals of the order conditions of size ``rounding``.
    """
    with mpmath.workdps(DIGITS):
        method, changed = method_of(table), method_of(table, LAST_PRINTED)
    places = multiprecision.digits(method)
    for span, ladder in SPANS:
        system, y, end, doubt = _reference(places, span)
        with precision(places):
            ends = [multiprecision.advance(system, method, y, span / n, n) for n in ladder]
            moved = multiprecision.advance(system, changed, y, span / ladder[0], ladder[0])
            noise = max(10 * doubt, 3 * max(abs(moved - ends[0])), 10 * rounding * float(span))
            errors = [float(max(abs(x - end))) for x in ends]
        found = metrics.order([float(span / n) for n in ladder], errors, noise=float(noise))
        if found.points:
            break
    return found


def worst_digits(table: Transcribed) -> tuple[int | None, int | None]:
    """(Printed, right decimals) of the printed number with the most wrong ones; None if they cannot be compared.

    It is compared with the nearest of the numbers that a package may print for the method here: its coefficients, the
    weights of its substeps, the lengths of the steps if it is written as a composition of a first-order method and its
    adjoint, and half of each of these.
    """
    if not table.ours or not table.printed or table.kind == RUNGE_KUTTA:
        return None, None
    own, numbers = table_of(table.ours)
    weights = [s if own.gamma else s[1] for s in own.steps(numbers)]
    halves = [*accumulate(weights, lambda last, w: w - last)]
    near = [abs(y) for x in (*numbers, *weights, *halves) for y in (x, x / 2)]
    return min(right_decimals(text, min(abs(mpmath.mpf(text) - y) for y in near)) for text in table.printed)[1:]


def check(table: Transcribed) -> dict[str, Any]:
    """The row of a table by order conditions and beside this project's table, without integrations."""
    with mpmath.workdps(DIGITS):
        orders, residual = order_of(table)
        decimals, right = worst_digits(table)
    row = {k: getattr(table, k) for k in ("package", "name", "repository", "path", "line", "commit")}
    row |= {"read": table.date, "kind": table.kind, "stated order": as_text(table.order)}
    row |= {"named order": as_text(table.named), "order": as_text(orders), "residual": residual, "ours": table.ours}
    return row | {PRINTED: decimals, HOLD: right, "used": table.used, "remark": table.remark}


def measure(package: str, name: str) -> dict[str, Any]:
    """The row of a table, with the order by integrations without Numba."""
    table = read()[package, name]
    found = check(table)
    met = all(int(p) >= q for p, q in zip(found["order"].split(","), table.expected, strict=True))
    order = measured_order(table, found["residual"] if met else 0.0)
    return found | {"measured order": order.value, "low": order.low, "high": order.high}


# -- judging -----------------------------------------------------------------------------------------------------------

STATED = "`stated order` == `stated order`"
NAMED = "`stated order` != `stated order` and `named order` == `named order`"


def reached(column: str) -> Callable[[pd.DataFrame], pd.Series]:
    """A function of rows: True where the order conditions show at least the order in a column."""
    return lambda rows: reaches(rows, "order", column)


def confirmed(rows: pd.DataFrame) -> pd.Series:
    """True where the measured order, or its interval, is within `GATE` of that of the order conditions."""
    shown = pd.to_numeric(rows["order"].astype(str).str.rpartition(",")[2], errors="coerce")
    near = (rows["measured order"] - shown).abs() <= GATE
    return near | ((rows["low"] - GATE <= shown) & (shown <= rows["high"] + GATE))


def weak_packages(rows: pd.DataFrame) -> str:
    """The packages in which weights have a lower order than the method they are named after."""
    wrong = rows[~reached("named order")(rows)]
    return join_list(list(wrong["package"].unique()), 4) if len(wrong) else ""


def place(row: pd.Series) -> str:
    """Where a table stands."""
    file = row["path"].rpartition("/")[2]
    return f"{row['repository']} {file}:{row['line']} ({row['commit']}, {row['read']})"


@of(TABLE)
def shown(rows: pd.DataFrame) -> Table:
    """Tables that lack their order, those with wrong digits, those with a remark."""
    wanted = rows["stated order"].where(rows["stated order"].notna(), rows["named order"].astype(object))
    rank = ~reached("wanted")(rows.assign(wanted=wanted)) * 1000.0 + lost(rows).fillna(0) + rows["remark"].notna() * 0.5
    part = rows.loc[rank.sort_values(ascending=False, kind="stable").index].head(ROWS)
    texts = part.astype(object).where(part.notna(), "")
    frame = pd.DataFrame(
        {
            "package": part["package"],
            "table": part["name"],
            "stated": texts["stated order"].astype(str),
            "named after": texts["named order"].astype(str),
            "by conditions": part["order"].astype(str),
            "measured": part["measured order"],
            HOLD: digits(part),
            "where": part.apply(place, axis=1),
            "used for, remark": (texts["used"] + "; " + texts["remark"]).str.strip("; "),
        }
    )
    caption = (
        "Orders: stated, of the method named after, by the order conditions, and measured. First the tables that lack "
        "an order, then those of which the most digits are wrong, then those with a remark; data/transcribed.csv has "
        "every table with its path."
    )
    return Table(frame, caption)


STUDY = Study(
    id="tables",
    place=444,
    question="Are the coefficient tables in the sources of packages right?",
    answer="Of {all} coefficient tables in the sources of {packages} packages, {wrong} lack the order that their "
    "package states; {weak} more have lower order than the methods they are named after.",
    setting=(
        "Tables of splittings, compositions and Runge–Kutta methods, transcribed as numbers from sources of packages "
        "with repository, path, line and commit.",
        "An order is computed from the order conditions: a residual that a change of the last digits explains is "
        "rounding. The order of a splitting for A + εB is that of the terms in ε, ε², ….",
        "It is confirmed by integrations of the Hénon–Heiles problem in 40 digits and more, in the sequence of "
        "substeps in which the package composes the numbers.",
        "Digits are compared with the nearest solution of the order conditions, where the method is here.",
    ),
    runs=(
        Runs(
            TABLE, measure, [{"package": package, "name": name} for package, name in read()],
            needs=lambda package, name: [repr(read()[package, name])], where=UNCOMPILED,
        ),
    ),
    claims={
        "stated": Claim(
            "Every table has the order that its package states",
            TABLE, reached("stated order"), rows=STATED, unit="tables", where="{package} {name}", names=4,
        ),
        "named": Claim(
            "Weights named after Suzuki and Yoshida have the order of their methods",
            TABLE, reached("named order"), rows=NAMED, unit="tables", where=weak_packages,
        ),
        "measured": Claim(
            "Integrations have the order that the order conditions show",
            TABLE, confirmed, rows="`measured order` == `measured order`", unit="tables", where="{package} {name}",
            names=3, fault=True,
        ),
        "digits": Claim(
            "Every printed digit is that of the method it is named after",
            TABLE, lambda rows: lost(rows) <= 0, rows=KNOWN, unit="tables", where=most_lost("{package} {name}"),
        ),
    },
    numbers={
        "all": Number(TABLE, len),
        "packages": Number(TABLE, lambda rows: rows["package"].nunique()),
        "wrong": Number(TABLE, lambda rows: ~reached("stated order")(rows), STATED, pd.Series.sum),
        "weak": Number(TABLE, lambda rows: ~reached("named order")(rows), NAMED, pd.Series.sum),
    },
    shown=shown,
    limits=(
        "The weights of thermostats serve a chain of Nosé and Hoover, not the motion: a lower order there costs "
        "accuracy of the thermostat at a given number of substeps. The packages call them by the names of Suzuki and "
        "Yoshida; the exponent of the published formula, 1/3, stands there as −1/3.",
        "desolver states for methods of Nielsen (2015) an order that holds near a harmonic oscillator only.",
        "OrdinaryDiffEq.jl marks McAte42 as broken in its source and documentation. The manual of Accelerator Toolbox "
        "calls type 2 Verlet's method of order 2.",
        "What a package computes from its numbers elsewhere was not run here; digits beyond those of doubles do not "
        "act in double precision.",
    ),
)  # fmt: skip
