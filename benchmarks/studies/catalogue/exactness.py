"""What the studies of coefficients share: orders from order conditions, and digits that hold."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping

import mpmath
import pandas as pd

from phasebench.integrators import coefficients
from phasebench.integrators.coefficients.order_conditions import TOLERANCE, Key, Residuals
from phasebench.integrators.coefficients.table import Table

PRINTED, HOLD = "digits printed", "digits that hold"
#: Rows of which digits are known.
KNOWN = f"`{PRINTED}` == `{PRINTED}`"


def files() -> list[str]:
    """The digest of the file of polished numbers."""
    return [hashlib.sha256(coefficients.POLISHED.read_bytes()).hexdigest()]


def table_of(id: str) -> tuple[Table, list[mpmath.mpf]]:
    """The table of a method of this project, and the numbers on which it runs."""
    return coefficients.table(id), list(coefficients.polished_numbers(id))


def observed_order(found: Residuals, powers: int) -> tuple[int, ...]:
    """For each of so many powers of eps the degree up to which residuals {(degree, power): numbers} vanish."""
    return order_from({key: max(map(abs, r)) < TOLERANCE for key, r in found.items()}, powers)


def order_from(zero: Mapping[Key, bool], powers: int) -> tuple[int, ...]:
    """For each power of eps the degree up to which all order conditions hold; the last includes all higher powers.

    ``zero`` maps (degree, power of eps) to True if these conditions hold.
    """
    orders = []
    for k in range(1, powers + 1):
        known = {key for key in zero if max(key[1], 1) == k or key[1] > k == powers}
        above = [n for n, j in known if not zero[n, j]]
        orders.append(min(above, default=max(known)[0] + 1) - 1)
    return tuple(orders)


def as_text(order: tuple[int, ...]) -> str:
    """An order as text: "8,6,4"."""
    return ",".join(map(str, order))


def reaches(rows: pd.DataFrame, column: str, least: str) -> pd.Series:
    """True where the order, as text, in a column is at least that in another one, in every power of eps."""

    def reached(*texts: object) -> bool:
        found, wanted = (pd.to_numeric(str(text).split(","), errors="coerce") for text in texts)
        return len(found) == len(wanted) and bool((found >= wanted).all())

    return pd.Series(map(reached, rows[column], rows[least]), rows.index, dtype=bool)


def right_decimals(text: str, far: mpmath.mpf) -> tuple[int, int, int]:
    """(Right less printed decimals, printed, right) of a printed decimal that is ``far`` from the exact number."""
    printed = len(text.partition(".")[2])
    right = printed if far <= mpmath.mpf(10) ** -printed else max(0, int(mpmath.floor(-mpmath.log10(far))))
    return right - printed, printed, right


def lost(rows: pd.DataFrame) -> pd.Series:
    """The number of printed digits that do not hold."""
    return rows[PRINTED].astype(float) - rows[HOLD].astype(float)


def most_lost(text: str) -> Callable[[pd.DataFrame], str]:
    """A function of rows: the one that lost most digits, formatted by ``text``; "" if none did."""
    return lambda rows: text.format_map(rows.loc[lost(rows).idxmax()]) if lost(rows).max() > 0 else ""


def digits(rows: pd.DataFrame) -> list[str]:
    """How many of the printed digits hold, as "14 of 15"; "" if the coefficients are not rounded."""
    return ["" if pd.isna(n) else f"{good:.0f} of {n:.0f}" for n, good in zip(rows[PRINTED], rows[HOLD], strict=True)]
