r"""Compute coefficients to full precision: the solution of the order conditions nearest to the published digits.

With r(x) the residuals of `order_conditions`, J(x) their Jacobian and :math:`x_0` the published digits, this is x with

.. math::
    r(x) = 0, \qquad x - x_0 \in \operatorname{range} J(x)^T,

an isolated solution or, of a family with free directions, its member at the least distance.  It is found by the
iteration of minimum norm on the linearised conditions, with J anew at each x,

.. math:: x \leftarrow x_0 + J^+ (J (x - x_0) - r(x)),

all in multiprecision, so that the digits depend on nothing but the published ones.  Halves stay mirrored, and published
numbers that are fractions or of few digits are design choices, which stay.

Source: A. Ben-Israel, J. Math. Anal. Appl. 15 (1966) 243-252 (Newton steps by the generalised inverse).
"""

from __future__ import annotations

from collections.abc import Sequence

import mpmath
import numpy as np

from .fractions import DIGITS
from .table import Table, is_exact, value

#: Digits carried beyond those that are kept, and the displacement of a central difference: a third of all digits.
GUARD = 40
DIFFERENCE = mpmath.mpf(10) ** (-(DIGITS + GUARD) // 3)
#: The changes of the numbers fall by the factor of their first one or faster.
STEPS, SMALL = 12, mpmath.mpf(10) ** -(DIGITS + 5)
#: A condition whose gradient is that of others to this share of the largest is redundant.
RANK = mpmath.mpf("1e-12")


def starting_values(table: Table, replaced: dict[int, str] | None = None) -> list[mpmath.mpf]:
    """The published numbers of a table, where polishing starts; ``replaced`` maps indices to other texts for them."""
    texts = list(table.published)
    for k, text in (replaced or {}).items():
        texts[k] = text
    return [value(x) for x in texts]


def jacobian(table: Table, numbers: Sequence[mpmath.mpf], free: Sequence[int]) -> np.ndarray:
    """Derivatives of the residuals by the numbers with the indices ``free``, a column each, by central differences."""
    columns = []
    for k in free:
        above, below = list(numbers), list(numbers)
        above[k], below[k] = above[k] + DIFFERENCE, below[k] - DIFFERENCE
        columns.append((table.residual(above) - table.residual(below)) / (2 * DIFFERENCE))
    return np.array(columns, dtype=object).T


def independent_rows(J: np.ndarray) -> list[int]:
    """Indices of independent rows of J that span all its rows, by Gram-Schmidt with the largest row first."""
    rows: list[int] = []
    left, largest = J, None
    while len(rows) < J.shape[1]:
        squares = [row @ row for row in left]
        k = max(range(len(squares)), key=squares.__getitem__)
        largest = largest or squares[k]
        if squares[k] <= RANK**2 * largest:
            break
        rows.append(k)
        left = left - np.outer(left @ left[k], left[k]) / squares[k]
    return rows


def polish(table: Table, numbers: Sequence[mpmath.mpf] | None = None) -> list[mpmath.mpf]:
    """The solution of a table's order conditions nearest to ``numbers``, by default the published ones.

    Raises
    ------
    ArithmeticError
        If the residual does not fall to round-off.
    """
    with mpmath.workdps(DIGITS + GUARD):
        first = np.array(starting_values(table) if numbers is None else numbers, dtype=object)
        x, free = first.copy(), [k for k, text in enumerate(table.published) if not is_exact(text)]
        rows: list[int] = []
        for _ in range(STEPS if free else 0):
            J, r = jacobian(table, x, free), table.residual(x)
            rows = rows or independent_rows(J)
            A = J[rows]
            factors = mpmath.lu_solve((A @ A.T).tolist(), list(A @ (x - first)[free] - r[rows]))
            nearer = first[free] + A.T @ np.array(list(factors), dtype=object)
            change = max(abs(nearer - x[free]))
            x[free] = nearer
            if change < SMALL:
                break
        left = max(map(abs, table.residual(x)))
        if left > mpmath.mpf(10) ** (2 - DIGITS):
            order = ",".join(map(str, table.order))
            raise ArithmeticError(
                f"{table.name} has not the order {order} it declares: a residual of {mpmath.nstr(left, 3)} is left"
            )
        return list(x)


def locate(table: Table, numbers: Sequence[mpmath.mpf]) -> tuple[int, mpmath.mpf]:
    """The number, perhaps misprinted, whose least-squares correction leaves the least residual: (index, new value)."""
    with mpmath.workdps(DIGITS + GUARD):
        r = table.residual(numbers)
        J = jacobian(table, numbers, range(len(numbers))).astype(float)
        scale = max(map(abs, r))
        unit = np.array([float(x / scale) for x in r])
        shift = (J * unit[:, None]).sum(axis=0) / (J * J).sum(axis=0)
        left = np.linalg.norm(unit[:, None] - J * shift, axis=0)
        k = int(np.argmin(left))
        return k, numbers[k] - scale * mpmath.mpf(shift[k])


def entry(table: Table) -> dict:
    """The entry of a table for ``polished.json``: what `coefficients.describe` returns."""
    before, after = starting_values(table), polish(table)
    with mpmath.workdps(DIGITS):
        texts = [x if is_exact(x) else mpmath.nstr(y, DIGITS) for x, y in zip(table.published, after, strict=True)]
        return {
            "published": table.digest,
            "numbers": texts,
            "residual_before": mpmath.nstr(table.excess(before), 3),
            "residual_after": mpmath.nstr(table.excess(list(map(value, texts))), 3),
            "moved": mpmath.nstr(max(abs(x - y) for x, y in zip(before, after, strict=True)), 3),
        }
