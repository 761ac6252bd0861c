r"""The order of a step: from its error at a ladder of falling step sizes, and from the power series of its error in h.

Ladder: `metrics.order` fits the order to the errors :math:`|\Phi_h^n(y) - \varphi_{nh}(y)|`, and returns it with an
interval of confidence and the window of h to which it is fitted.  The errors are computed in many digits if the step
accepts them, else in doubles.  The reference solution is Gragg's extrapolated midpoint rule in 40 digits.

Series, in many digits only: with :math:`\Phi_h - \varphi_h = \sum_k c_k h^k` and :math:`\varphi_h = \sum_k f_k h^k`,
the relative :math:`\varepsilon_k = |c_k|/|f_k|` for k = 1 ... 8, from divided differences at h = 2^-40 j.  For a step
of order p with coefficients in doubles, :math:`\varepsilon_1 ... \varepsilon_p` are of the size of round-off; with
coefficients cut at ten digits they are about :math:`10^{-10}`.  :math:`\varepsilon_1` is the relative error in the
speed of the solution.

In doubles :math:`\varepsilon_1` is the limit of :math:`|\Phi_h - \varphi_h|/(h|f|)` as h falls, by least squares.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np

from phasebench.benchmarks.judge.evidence import EPS, GATE
from phasebench.benchmarks.judge.requirements import ROUNDED
from phasebench.benchmarks.measure import metrics, multiprecision
from phasebench.benchmarks.measure.coefficients import DIGITS_EXPLAIN
from phasebench.integrators.compile.codegen import DOUBLE, MULTIPRECISION, precision, to_number, vector
from phasebench.integrators.values.kinds import Number

from .battery import LADDER, SPAN, Entry
from .stepping import DIGITS, LastDigits, Stepper, numerical_failures

#: Terms of the error's series, the spacing of its steps h, and the digits that their differences need.
TERMS, CLOSE, SERIES_DIGITS = 8, 2.0**-40, 240
#: A coefficient of the series below this is zero up to rounded or cut coefficients of the method.
VANISHES = 1e-6
#: A step of more evaluations than DEAR has only SHORTER rungs in its ladder in many digits.
DEAR, SHORTER = 40, 8
#: Errors below these are round-off: in units of the arithmetic's; in many digits, if a solver stops at that of doubles.
ROUNDINGS, SOLVERS = 20, 1e-13
#: Relative errors below this may be those of the reference.
FINEST = 1e-34
#: Relative errors above this are too large to tell an order.
SATURATED = 0.1
#: Where the arithmetic is coarser than that of doubles the span is so many times as long, so that errors are larger.
LONGER = 8
#: A ladder in many digits with more noise than this (from coefficients in doubles) is fitted by `fit_series`, too.
ROUGH = 1e-17
#: Powers of h that are fitted to a ladder, the highest order tried, and the multiple of its uncertainty that is sure.
POWERS, MOST, SURE = 5, 12, 20.0
#: The steps of the fit in `constant`.
FIT = tuple(2.0 ** (-k / 2) for k in range(4, 15))


@dataclass(frozen=True)
class Series:
    """Power series in h of the error of one step: eps_1, eps_2, ..., each relative to its term of the exact flow."""

    terms: tuple[float, ...]

    @property
    def clean(self) -> int:
        """The number of leading terms so small that rounded or cut coefficients of the method explain them."""
        return next((k for k, x in enumerate(self.terms) if not x < VANISHES), len(self.terms))

    def largest(self, order: int) -> float:
        """The largest of eps_1, ..., eps_k that count as zero, k the smaller of ``order`` and `clean`; 0 if k is 0."""
        return max(self.terms[: min(order, self.clean)], default=0.0)


@lru_cache(maxsize=64)
def flow(entry: Entry, seed: int, h: float | object, pieces: int = 4) -> tuple[np.ndarray, Number]:
    """(Exact state after a time h, array (2 d,); its uncertainty), in `DIGITS` digits, over ``pieces`` parts of h."""
    with precision(DIGITS):
        return multiprecision.flow(entry.system, entry.start(seed), h, pieces)


@lru_cache(maxsize=64)
def nearby(entry: Entry, seed: int) -> list:
    """Exact states after 0, 1, 2, ... times `CLOSE` units of time, of `SERIES_DIGITS` digits."""
    with precision(SERIES_DIGITS):
        field, y = entry.system.vector_field(MULTIPRECISION), vector(entry.start(seed))
        close = to_number(CLOSE * entry.unit, MULTIPRECISION)
        ends = (multiprecision.extrapolate(lambda x: field(0, x), y, j * close)[0] for j in range(1, TERMS + 3))
        return [y, *ends]


def differences(values: Sequence[np.ndarray]) -> list:
    """The coefficients of h^0, h^1, ... of the polynomial through arrays at h = 0, 1, 2, ..."""
    rows, newton = list(values), []
    for k in range(len(rows)):
        newton.append(rows[0])
        rows = [(b - a) / (k + 1) for a, b in pairwise(rows)]
    out: list = [0 * newton[0]]
    for k in reversed(range(len(newton))):  # p(x) = newton_k + (x - k) * p(x)
        shifted = [0 * newton[0], *out]
        out = [a - k * b for a, b in zip(shifted, [*out, 0 * newton[0]], strict=True)]
        out[0] = out[0] + newton[k]
    return out[: len(newton)]


def series(stepper: Stepper, seed: int) -> Series:
    """The power series of a step's error; raises StepFailed if the step does not accept numbers of many digits."""
    with precision(SERIES_DIGITS):
        close, truth = to_number(CLOSE * stepper.entry.unit, MULTIPRECISION), nearby(stepper.entry, seed)
        y = truth[0]
        taken = [y] + [stepper(y, j * close) for j in range(1, len(truth))]
        size, error = differences(truth), differences([a - b for a, b in zip(taken, truth, strict=True)])
        pairs = list(zip(error, size, strict=True))[1 : TERMS + 1]
        sizes = stepper.entry.sizes
        return Series(tuple(float(max(abs(c) / sizes) / max(abs(f) / sizes)) for c, f in pairs))


def _ladder(steps: np.ndarray, away: np.ndarray, noise: float) -> dict:
    return {"h": list(steps), "error": [float(np.abs(x).max()) for x in away], "noise": noise}


def ladder_errors(stepper: Stepper, seed: int, noise: float = 0.0) -> tuple[np.ndarray, np.ndarray, float]:
    """(h (n,), signed errors (n, 2 d) at the end of one span, their round-off, at least the argument ``noise``).

    Errors are in units of the state's largest component, NaN where a run fails.
    """
    entry, double = stepper.entry, stepper.arithmetic == DOUBLE
    longer = LONGER if stepper.subject.eps > EPS else 1
    span = SPAN * longer * Fraction(entry.unit)
    truth, doubt = flow(entry, seed, span, 4 * longer)
    if double:
        truth = truth.astype(float)
    sizes = entry.sizes * float(max(abs(truth / entry.sizes)))
    away = []
    with precision(DIGITS):
        numbers = rungs(stepper)
        for n in numbers:
            h = float(span / n) if double else to_number(span / n, MULTIPRECISION)
            rows = ()
            with numerical_failures():
                rows = stepper.run(entry.start(seed), h, n, every=n)
            away.append(((rows[-1] - truth) / sizes).astype(float) if len(rows) == 2 else np.full(len(truth), np.nan))
    noise = max(noise, ROUNDINGS * stepper.subject.eps if double else 10 * float(doubt) / float(sizes.min()))
    return np.array([float(span / n) for n in numbers]), np.array(away), noise


def rungs(stepper: Stepper) -> tuple[int, ...]:
    """The numbers of steps of the runs from which an order is measured; fewer in many digits for a dear step."""
    if stepper.arithmetic == DOUBLE:
        return LADDER
    before = sum(stepper.system.evaluations)
    stepper(stepper.state(stepper.entry.start(0)), stepper.number(float(SPAN) * stepper.entry.unit))
    return LADDER if sum(stepper.system.evaluations) - before <= DEAR else LADDER[:SHORTER]


def order(stepper: Stepper, seed: int) -> dict:
    """Measure the order of a step on a system, with its interval, over a ladder of steps h: a row of the certificate.

    In many digits it also has the terms of the error's power series in h, in doubles the limit computed by `constant`.
    """
    row = {"on": stepper.entry.name, "arithmetic": stepper.arithmetic}
    if stepper.arithmetic == DOUBLE:
        steps, away, noise = ladder_errors(stepper, seed)
        row |= _ladder(steps, away, noise)
        found = _integral(_fit_order(row), steps, away, noise)
        return row | _order_fields(found) | constant(stepper, seed, found)
    terms = series(stepper, seed)
    steps, away, noise = ladder_errors(stepper, seed, SOLVERS)
    row |= _ladder(steps, away, noise)
    found = _fit_order(row)
    if not found.points or terms.clean >= round(found.value):
        finer = 100 * terms.largest(terms.clean) * float(SPAN)  # of the state's size: a unit of time moves it so far
        row["noise"] = max(finer, min(row["noise"], FINEST)) if terms.clean else row["noise"]
        found = _fit_order(row)
    if row["noise"] > ROUGH:
        found = _integral(found, steps, away, row["noise"])
    row |= _order_fields(found) | {"terms": list(terms.terms), "clean": terms.clean}
    if max(terms.terms[: terms.clean], default=0.0) <= ROUNDED:
        return row
    changed = series(LastDigits(stepper.subject, stepper.entry, MULTIPRECISION), seed).terms
    clock, *rest = (DIGITS_EXPLAIN * abs(a - b) for a, b in zip(changed, terms.terms, strict=True))
    return row | {"explained": [clock, *[max(rest[: max(terms.clean - 1, 1)])] * len(rest)]}


def _fit_order(row: Mapping[str, Any]) -> metrics.Order:
    return metrics.order(row["h"], row["error"], row["noise"], SATURATED)


def _integral(found: metrics.Order, steps: np.ndarray, away: np.ndarray, noise: float) -> metrics.Order:
    """The fitted order or, if that is not near a whole number, the one that `fit_series` finds, if any."""
    if found.points and abs(found.value - round(found.value)) < GATE:
        return found
    return fit_series(steps / steps[0], away, noise) or found


def fit_series(h: np.ndarray, errors: np.ndarray, noise: float) -> metrics.Order | None:
    """The order p of errors c_0 h^p + c_1 h^(p+1) + ... at falling steps h, if only one p explains them; else None.

    For errors of which too few are above round-off (``noise``) for the first term to prevail: fitted by least squares
    for each p, which explains them if the residual is round-off and c_0 exceeds `SURE` times its own uncertainty.
    """
    whole = np.isfinite(errors).all(axis=1) & (np.abs(errors).max(axis=1) < SATURATED)
    for first in range(3):  # from the widest step, or without it
        x, e = h[whole][first:], errors[whole][first:]
        if len(x) < POWERS + 3:
            return None
        fits = [(p, *_power_series(x / x[0], e, p, noise / 5)) for p in range(1, MOST + 1)]
        found = [(p, lead) for p, left, lead in fits if left < 1 and lead > SURE]
        if len(found) == 1:
            p, lead = found[0]
            half = 1 / lead
            return metrics.Order(float(p), p - half, p + half, float(x[0]), float(x[-1]), len(x))
    return None


def _power_series(x: np.ndarray, e: np.ndarray, p: int, noise: float) -> tuple[float, float]:
    """Fit errors e (n, 2 d) by x^p, x^(p+1), ...: (residual, first coefficient), both in units of their round-off."""
    columns = np.stack([x ** (p + k) for k in range(POWERS)], axis=1) / noise
    inverse = np.linalg.pinv(columns)
    fitted = inverse @ e / noise
    left = (columns @ fitted - e / noise) ** 2
    free = (len(x) - POWERS) * e.shape[1]
    return float(np.sqrt(left.sum() / free)), float(np.abs(fitted[0]).max() / np.linalg.norm(inverse[0]))


def _order_fields(found: metrics.Order) -> dict:
    names = ("value", "low", "high", "first", "last", "points")
    return {name: getattr(found, name) for name in names}


def constant(stepper: Stepper, seed: int, found: metrics.Order) -> dict:
    """Estimate the limit of |error of a step| / (h |f|) as h falls, f the vector field; 0 for a consistent step.

    Returns {"constant": the limit, "doubt": its uncertainty}; empty if too few steps succeed.
    """
    entry = stepper.entry
    y, sizes = entry.start(seed), entry.sizes
    speed = float(np.abs(entry.system.vector_field()(0.0, y) / sizes).max()) * entry.unit
    least = max(1, round(found.value)) if found.points else 1
    h, left = [], []
    for step in FIT:
        end = np.nan
        with numerical_failures():
            end = stepper(y, step * entry.unit)
        if np.isfinite(end).all():
            h.append(step)
            truth = flow(entry, seed, step * entry.unit, 1)[0].astype(float)
            left.append((end - truth) / sizes / step / speed)
    if len(h) < 8:
        return {}
    h, left = np.array(h), np.array(left)
    columns = np.stack([h**k for k in (0, *range(least, least + 5))], axis=1)
    scale = h / stepper.subject.eps / float(np.abs(y / sizes).max()) * speed
    inverse = np.linalg.pinv(columns * scale[:, None])
    fitted = inverse @ (left * scale[:, None])
    rest = np.abs((columns @ fitted - left) * scale[:, None]).max()
    doubt = float(np.linalg.norm(inverse[0]) * max(rest, 1.0))
    return {"constant": float(np.abs(fitted[0]).max()), "doubt": 5 * doubt}
