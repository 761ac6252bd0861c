"""Compute orders and error constants of compositions and splittings from their coefficients alone."""

from __future__ import annotations

from typing import TYPE_CHECKING

import mpmath
import pandas as pd

from phasebench.integrators import coefficients
from phasebench.integrators.coefficients import DAMAGED, TABLES
from phasebench.integrators.coefficients.fractions import DIGITS
from phasebench.integrators.coefficients.order_conditions import (
    TOLERANCE,
    conditions,
    excess,
    leading_norms,
    next_degrees,
    residuals,
)
from phasebench.integrators.coefficients.polish import locate, starting_values

if TYPE_CHECKING:
    from collections.abc import Mapping

    from phasebench.integrators.coefficients.order_conditions import Key, Residuals


def _digits(x: mpmath.mpf) -> str:
    return mpmath.nstr(x, 2, min_fixed=0, max_fixed=0)


def observed_order(found: Residuals, powers: int) -> tuple[int, ...]:
    """Derive the order from residuals of order conditions: for each power of eps the degree up to which they vanish.

    Parameters
    ----------
    found : (degree, power of eps) -> residuals
    powers : how many powers of eps to report; the last includes all higher ones
    """
    return order_from({key: max(map(abs, r)) < TOLERANCE for key, r in found.items()}, powers)


def order_from(zero: Mapping[Key, bool], powers: int) -> tuple[int, ...]:
    """Derive the order from which order conditions hold: for each power of eps the degree up to which all do.

    ``zero`` maps (degree, power of eps) to True if these conditions hold; ``powers`` is as in `observed_order`.
    """
    orders = []
    for k in range(1, powers + 1):
        known = {key for key in zero if max(key[1], 1) == k or key[1] > k == powers}
        above = [n for n, j in known if not zero[n, j]]
        orders.append(min(above, default=max(known)[0] + 1) - 1)
    return tuple(orders)


def frame() -> pd.DataFrame:
    """Make the table "coefficients": a row for each coefficient table, with orders, residuals and error constants."""
    rows = []
    with mpmath.workdps(DIGITS):
        for t in TABLES:
            steps = coefficients.steps(t.name)
            found = residuals(t.kind, steps, next_degrees(t.order))
            before = residuals(t.kind, t.steps(starting_values(t)), t.order)
            about = coefficients.describe(t.name)
            order = observed_order(found, len(t.order))
            stages = (
                len(steps) if t.gamma else sum(letter == "B" for letter, _ in steps) - (t.first == "B" and t.symmetric)
            )
            rows.append(
                {
                    "kind": t.kind,
                    "table": t.name,
                    "stages": stages,
                    "declared order": ",".join(map(str, t.order)),
                    "order": ",".join(map(str, order)),
                    "conditions": sum(len(found[key]) for key in conditions(found, t.order)),
                    "published residual": _digits(excess(before, t.order)),
                    "polished residual": _digits(excess(found, t.order)),
                    "moved by": about["moved"],
                    "sum of sizes": f"{float(about['sum_of_sizes']):.3f}",
                    "error constant": ", ".join(_digits(x) for x in leading_norms(found, t.order)),
                    "source": t.source,
                }
            )
    return pd.DataFrame(rows)


def repairs() -> pd.DataFrame:
    """Make a row for each misprinted coefficient: its index in the table, the printed number, and the right one."""
    rows = []
    with mpmath.workdps(DIGITS):
        for name, damaged in DAMAGED.items():
            t = coefficients.table(name)
            numbers = starting_values(t, damaged)
            for _ in damaged:
                residual = excess(residuals(t.kind, t.steps(numbers), t.order), t.order)
                k, mended = locate(t, numbers)
                rows.append(
                    {
                        "table": name,
                        "number": f"{k + 1} of {len(numbers)}",
                        "in a copy": damaged.get(k, t.published[k]),
                        "from the order conditions": mpmath.nstr(mended, 36),
                        "published": t.published[k],
                        "residual with it": _digits(residual),
                    }
                )
                numbers[k] = starting_values(t)[k]
    return pd.DataFrame(rows)


def loose() -> pd.DataFrame:
    """Make a row for each coefficient table printed with more digits than are right: decimals printed and right."""
    rows = [
        {
            "table": t.name,
            "decimals printed": max(len(x.partition(".")[2]) for x in t.published),
            "decimals right": t.good,
        }
        for t in TABLES
        if t.good is not None
    ]
    return pd.DataFrame(rows)
