r"""Coefficients to full precision, from published digits, by Gauss-Newton steps on the order conditions.

With r(x) the residuals of `order_conditions` and J their Jacobian at the published digits,

.. math::
    x \leftarrow x - J^{+} r(x),

where the pseudo-inverse makes the step of minimum norm: of a family of solutions it finds the one nearest to the
published digits.  J in doubles is enough, each step gains some 12 digits.  Halves stay mirrored, and published numbers
that are fractions or of few digits are design choices, which stay.

``python -m phasebench.integrators.coefficients.polish`` writes ``coefficients/polished.json``.

Source: A. Ben-Israel, J. Math. Anal. Appl. 15 (1966) 243-252 (Newton steps by the generalised inverse).
"""

from __future__ import annotations

import json
from collections.abc import Sequence

import mpmath
import numpy as np

from . import POLISHED, TABLES
from .fractions import DIGITS
from .order_conditions import conditions, excess, residuals
from .table import Table, is_exact, value

GUARD = 10
STEPS = 12
#: Singular values below this share of the largest are those of redundant conditions or of directions left free.
RANK = 1e-9
DIFFERENCE = mpmath.mpf("1e-25")


def starting(table: Table, replaced: dict[int, str] | None = None) -> list[mpmath.mpf]:
    """The published numbers, those of some indices replaced."""
    texts = list(table.published)
    for k, text in (replaced or {}).items():
        texts[k] = text
    return [value(x) for x in texts]


def residual(table: Table, numbers: Sequence[mpmath.mpf]) -> np.ndarray:
    """Every coefficient that the order needs to vanish; of a symmetric method those of odd degree imply the others."""
    order = table.order
    found = residuals(table.kind, table.steps(numbers), max(order) - (table.symmetric and max(order) % 2 == 0))
    keys = [key for key in conditions(found, order) if key[0] % 2 or not table.symmetric]
    return np.concatenate([found[key] for key in keys])


def jacobian(table: Table, numbers: Sequence[mpmath.mpf], free: Sequence[int]) -> np.ndarray:
    """The derivatives of `residual` by the numbers of the indices ``free``, in doubles."""
    r = residual(table, numbers)
    columns = []
    for k in free:
        moved = list(numbers)
        moved[k] = moved[k] + DIFFERENCE
        columns.append([float(x / DIFFERENCE) for x in residual(table, moved) - r])
    return np.array(columns).T


def polish(table: Table, numbers: Sequence[mpmath.mpf] | None = None) -> list[mpmath.mpf]:
    """The solution of the order conditions nearest to ``numbers`` (at first the published ones).

    Raises
    ------
    ArithmeticError
        If the residual does not fall to round-off.
    """
    with mpmath.workdps(DIGITS + GUARD):
        x = list(starting(table) if numbers is None else numbers)
        free = [k for k, text in enumerate(table.published) if not is_exact(text)]
        if free:
            inverse = np.linalg.pinv(jacobian(table, x, free), rcond=RANK)
            for _ in range(STEPS):
                r = residual(table, x)
                size = max(map(abs, r))
                if size < mpmath.mpf(10) ** -(DIGITS + GUARD // 2):
                    break
                scaled = inverse @ np.array([float(v / size) for v in r])
                for k, step in zip(free, scaled, strict=True):
                    x[k] = x[k] - size * mpmath.mpf(step)
        left = max(map(abs, residual(table, x)))
        if left > mpmath.mpf(10) ** (2 - DIGITS):
            raise ArithmeticError(f"{table.name}: a residual of {mpmath.nstr(left, 3)} is left")
        return x


def locate(table: Table, numbers: Sequence[mpmath.mpf]) -> tuple[int, mpmath.mpf]:
    """Which single number explains the residual best: (its index, what it should be).

    For each number its own least-squares correction; the one that leaves the least residual.
    """
    with mpmath.workdps(DIGITS + GUARD):
        r = residual(table, numbers)
        J = jacobian(table, numbers, range(len(numbers)))
        scale = max(map(abs, r))
        unit = np.array([float(x / scale) for x in r])
        shift = (J * unit[:, None]).sum(axis=0) / (J * J).sum(axis=0)
        left = np.linalg.norm(unit[:, None] - J * shift, axis=0)
        k = int(np.argmin(left))
        return k, numbers[k] - scale * mpmath.mpf(shift[k])


def entry(table: Table) -> dict:
    """What the data file says of a table."""
    before, after = starting(table), polish(table)
    with mpmath.workdps(DIGITS):
        texts = [x if is_exact(x) else mpmath.nstr(y, DIGITS) for x, y in zip(table.published, after, strict=True)]
        full = table.steps([value(x) for x in texts])
        found = [residuals(table.kind, table.steps(x), max(table.order)) for x in (before, [value(x) for x in texts])]
        n, m = len(table.gamma), len(table.gamma) + len(table.a)
        weights = full if table.gamma else [w for _, w in full]
        return {
            **{part: t for part, t in (("gamma", texts[:n]), ("a", texts[n:m]), ("b", texts[m:])) if t},
            "residual_before": mpmath.nstr(excess(found[0], table.order), 3),
            "residual_after": mpmath.nstr(excess(found[1], table.order), 3),
            "moved": mpmath.nstr(max(abs(x - y) for x, y in zip(before, after, strict=True)), 3),
            "sum": mpmath.nstr(mpmath.fsum(weights), 3),
            "sum_of_sizes": mpmath.nstr(mpmath.fsum(map(abs, weights)), 10),
        }


def main() -> None:
    """Write ``polished.json``."""
    data = {}
    for t in TABLES:
        data[t.name] = entry(t)
        print(f"{t.name}: {data[t.name]['residual_before']} -> {data[t.name]['residual_after']}")
    POLISHED.write_text(json.dumps(data, indent=1) + "\n")


if __name__ == "__main__":
    main()
