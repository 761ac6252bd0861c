"""List the methods in the Acta Numerica survey of splitting methods, and compute which are here and how exact they are.

The survey is S. Blanes, F. Casas, A. Murua, Acta Numerica 33 (2024) 1-161.  Its text was not at hand.  `LISTED` holds
the processed methods that public programs transcribe from its tables 8.1 and 8.5 (``quoted``), and the methods of the
publications that the survey collects.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import mpmath
import pandas as pd

from phasebench.integrators import coefficients
from phasebench.integrators.coefficients import collected, force_gradient, processed, sampling
from phasebench.integrators.coefficients.fractions import DIGITS
from phasebench.integrators.coefficients.order_conditions import TOLERANCE, next_degrees, residuals
from phasebench.integrators.coefficients.polish import starting_values
from phasebench.integrators.coefficients.table import Table, is_exact, unit

from .coefficients import observed_order

COMPOSITION, SPLITTING = "composition of a symmetric method", "splitting in two parts"
NYSTROM, GRADIENT = "Nystrom splitting", "force gradient"
PERTURBED = "splitting for A + eps B"
#: Kind -> the number of the survey's table, of the rows that a program quotes.
NUMBERED = {COMPOSITION: "8.1", PERTURBED: "8.5"}
#: Numbers of more decimals are of a closed form.
CLOSED = 50
FILES = (collected.FILE, processed.FILE, force_gradient.FILE)
NO_SOURCE = "no public source with its numbers was found"


@dataclass(frozen=True)
class Listed:
    """A method that the Acta Numerica survey of splitting methods collects.

    Attributes
    ----------
    kind : what it is a splitting or composition of, such as `NYSTROM`
    stages, order : as printed
    work : the publication
    id : the method's id in this project; "" if this project lacks it
    why : the reason why this project lacks it
    quoted : True if a public program names the row of the survey's table
    processed : True if the method has a kernel and a processor
    """

    kind: str
    stages: str
    order: str
    work: str
    id: str = ""
    why: str = ""
    quoted: bool = False
    processed: bool = False


def _rows(kind: str, text: str) -> tuple[Listed, ...]:
    """Parse lines "stages | order | publication | ids" into `Listed` methods of a kind, one for each id of a line."""
    out = []
    for line in text.strip().splitlines():
        stages, order, work, ids = (x.strip() for x in line.split("|"))
        out += [Listed(kind, stages, order, work, id) for id in ids.split()]
    return tuple(out)


def _processed(kind: str, text: str, quoted: bool = True) -> tuple[Listed, ...]:
    """Parse lines as `_rows` does, into processed methods (a kernel between a processor and its inverse).

    ``quoted`` is True if a public program names the rows of the survey's table.
    """
    return tuple(Listed(r.kind, r.stages, r.order, r.work, r.id, "", quoted, True) for r in _rows(kind, text))


def _missing(kind: str, stages: str, order: str, work: str, why: str = NO_SOURCE) -> Listed:
    return Listed(kind, stages, order, work, "", why, processed=True)


LISTED: tuple[Listed, ...] = (
    *_rows(
        COMPOSITION,
        """
        3 | 4 | Forest & Ruth 1990; Yoshida 1990 | forest-ruth
        5 | 4 | Suzuki 1990 | suzuki-4
        5 | 4 | McLachlan 1995 | mclachlan-ss5
        7 | 6 | Yoshida 1990 | yoshida-6a yoshida-6b yoshida-6c
        9 | 6 | McLachlan 1995 | mclachlan-ss9
        9 | 6 | Kahan & Li 1997 | kahan-li-6 kahan-li-6b
        11 | 6 | Sofroniou & Spaletta 2005 | sofroniou-spaletta-6-11
        13 | 6 | Sofroniou & Spaletta 2005 | sofroniou-spaletta-6
        15 | 8 | Yoshida 1990 | yoshida-8a yoshida-8b yoshida-8c yoshida-8d yoshida-8e
        15 | 8 | Suzuki & Umeno 1993; McLachlan 1995 | suzuki-umeno-8
        17 | 8 | McLachlan 1995 | mclachlan-ss17
        17 | 8 | Kahan & Li 1997 | kahan-li-8 kahan-li-8b
        19 | 8 | Sofroniou & Spaletta 2005 | sofroniou-spaletta-8-19
        21 | 8 | Sofroniou & Spaletta 2005 | sofroniou-spaletta-8
        31 | 10 | Kahan & Li 1997 | kahan-li-10-31
        31 | 10 | Sofroniou & Spaletta 2005 | sofroniou-spaletta-10-31
        33 | 10 | Kahan & Li 1997 | kahan-li-10-33
        33 | 10 | Tsitouras 1999 | tsitouras-10
        33 | 10 | Hairer, Lubich & Wanner 2006 | hlw-10
        33 | 10 | Sofroniou & Spaletta 2005 | sofroniou-spaletta-10-33
        35 | 10 | Sofroniou & Spaletta 2005 | sofroniou-spaletta-10
        """,
    ),
    *_processed(
        COMPOSITION,
        """
        7 | 6 | Blanes 2001 | blanes-p7-6
        11 | 6 | Blanes, Casas & Murua 2006 | blanes-casas-murua-p11-6
        13 | 6 | Blanes, Casas & Murua 2006 | blanes-casas-murua-p13-6
        13 | 8 | Blanes, Casas & Murua 2006 | blanes-casas-murua-p13-8
        23 | 10 | Blanes, Casas & Murua 2006 | blanes-casas-murua-p23-10
        """,
    ),
    *_rows(
        SPLITTING,
        """
        2 | 2 | McLachlan & Atela 1992 | mclachlan-atela-2
        3 | 3 | Ruth 1983 | ruth-3
        3 | 3 | McLachlan & Atela 1992 | mclachlan-atela-3
        2 | 2 | McLachlan 1995 | mclachlan-s2
        4 | 4 | McLachlan 1995 | mclachlan-s4
        5 | 4 | McLachlan 1995 | mclachlan-s5
        4 | 4 | Omelyan, Mryglod & Folk 2002 | efrl pefrl vefrl
        6 | 4 | Blanes & Moan 2002 | blanes-moan-s6
        10 | 6 | Blanes & Moan 2002 | blanes-moan-s10
        2 | 2 | Blanes, Casas & Sanz-Serna 2014 | blanes-casas-sanz-serna-2
        3 | 2 | Blanes, Casas & Sanz-Serna 2014 | blanes-casas-sanz-serna-3
        4 | 2 | Blanes, Casas & Sanz-Serna 2014 | blanes-casas-sanz-serna-4
        """,
    ),
    _missing(SPLITTING, "several", "4, 6", "Blanes, Casas & Murua 2006: compositions of a method with its adjoint"),
    *_rows(
        NYSTROM,
        """
        4 | 4 | McLachlan & Atela 1992 | mclachlan-atela-4
        6 | 5 | McLachlan & Atela 1992 | mclachlan-atela-5
        5 | 4 | Calvo & Sanz-Serna 1993 | calvo-sanz-serna-4
        7 | 6 | Okunbor & Skeel 1994 | okunbor-skeel-6
        4 | 4 | McLachlan 1995 | mclachlan-sb3a4
        5 | 4 | McLachlan 1995 | mclachlan-sb3a5
        6 | 4 | Blanes & Moan 2002 | blanes-moan-srkn6b
        11 | 6 | Blanes & Moan 2002 | blanes-moan-srkn11b
        14 | 6 | Blanes & Moan 2002 | blanes-moan-srkn14a
        17 | 8 | Blanes, Casas & Escorihuela-Tomas 2022 | blanes-casas-escorihuela-srkn17
        17 | 8 | Blanes, Casas & Escorihuela-Tomas 2022 | blanes-casas-escorihuela-srkn17b
        18 | 8 | Blanes, Casas & Escorihuela-Tomas 2022 | blanes-casas-escorihuela-srkn18a
        18 | 8 | Blanes, Casas & Escorihuela-Tomas 2022 | blanes-casas-escorihuela-srkn18b
        19 | 8 | Blanes, Casas & Escorihuela-Tomas 2022 | blanes-casas-escorihuela-srkn19a
        19 | 8 | Blanes, Casas & Escorihuela-Tomas 2022 | blanes-casas-escorihuela-srkn19b
        """,
    ),
    _missing(NYSTROM, "several", "4, 6", "Blanes, Casas & Ros 1999, 2001: processed Nystrom splittings"),
    *_rows(
        GRADIENT,
        """
        1 | 2 | Takahashi & Imada 1984 | takahashi-imada
        2 | 4 | Chin 1997 | chin-4a chin-4b
        3 | 4 | Chin 1997 | chin-4c
        3 | 4 | Omelyan, Mryglod & Folk 2003 | omelyan-4-3f1g-v omelyan-4-3f2g-v omelyan-4-3f1g-p omelyan-4-3f2g-p
        5 | 4 | Omelyan, Mryglod & Folk 2003 | omelyan-4-5f1g-v omelyan-4-5f1g-p
        4 | 6 | Omelyan, Mryglod & Folk 2002 | omelyan-6-4f3g-v
        5 | 6 | Omelyan, Mryglod & Folk 2003 | omelyan-6-5f3g-p omelyan-6-5f4g-v omelyan-6-5f5g-v
        """,
    ),
    _missing(
        GRADIENT,
        "1, 3",
        "4, 6",
        "Blanes, Casas & Ros 1999, 2001: processed splittings with force gradients",
        "left out: their processors have force gradients; the numbers stand in REBOUND's EOS",
    ),
    *_rows(
        PERTURBED,
        """
        2 | 4,2 | Laskar & Robutel 2001; McLachlan 1995 | saba-2 sbab-2
        3 | 6,2 | Laskar & Robutel 2001; McLachlan 1995 | saba-3 sbab-3
        4 | 8,2 | Laskar & Robutel 2001; McLachlan 1995 | saba-4 sbab-4
        5 | 10,2 | Laskar & Robutel 2001 | saba-5 sbab-5
        6 | 12,2 | Laskar & Robutel 2001 | saba-6 sbab-6
        7 | 14,2 | Laskar & Robutel 2001 | saba-7 sbab-7
        8 | 16,2 | Laskar & Robutel 2001 | saba-8 sbab-8
        9 | 18,2 | Laskar & Robutel 2001 | saba-9 sbab-9
        10 | 20,2 | Laskar & Robutel 2001 | saba-10 sbab-10
        5 | 8,4 | McLachlan 1995 | mclachlan-aba-84 mclachlan-bab-84
        7 | 10,4 | Blanes et al. 2013 | aba-104
        7 | 8,6,4 | Blanes et al. 2013 | aba-864
        8 | 10,6,4 | Blanes et al. 2013 | aba-1064
        6 | 8,4 | Blanes et al. 2013, perturbation of two parts | abah-844 babh-844
        8 | 8,6,4 | Blanes et al. 2013, perturbation of two parts | abah-864 babh-864
        9 | 10,6,4 | Blanes et al. 2013, perturbation of two parts | abah-1064
        """,
    ),
    *_processed(
        PERTURBED,
        """
        2 | 6,4 | Blanes, Casas & Ros 2000 | blanes-casas-ros-p2
        3 | 7,6 | Blanes, Casas & Ros 2000 | blanes-casas-ros-p3
        4 | 7,6 | Blanes, Casas & Ros 2000 | blanes-casas-ros-p4
        """,
    ),
)


@cache
def find_table(id: str) -> Table:
    """Return the coefficient table of a method of this project; raise KeyError if it has none."""
    for tables in (coefficients.BY_NAME, *(f.tables for f in FILES), sampling.BY_NAME):
        if id in tables:
            return tables[id]
    raise KeyError(id)


def numbers_of(table: Table) -> list[mpmath.mpf]:
    """Return the coefficients that the method of a table runs on, in many digits, in the order of `Table.published`."""
    if table.name in coefficients.BY_NAME:
        return list(coefficients.polished_numbers(table.name))
    for file in FILES:
        if table.name in file.tables:
            return list(file.numbers(table.name))
    return starting_values(table)


def digits(table: Table, numbers: list[mpmath.mpf]) -> tuple[int | None, int | None]:
    """Return (printed decimals, right decimals) of the coefficient with the most wrong decimals in a table.

    A decimal is right if the printed number is within one unit of this decimal from the exact number in ``numbers``,
    which solves the order conditions.  (None, None) if all numbers are exact or closed forms.
    """
    found = []
    with mpmath.workdps(DIGITS):
        for text, x, y in zip(table.published, starting_values(table), numbers, strict=True):
            printed, far = len(text.partition(".")[2]), abs(x - y)
            if is_exact(text) or printed > CLOSED:
                continue
            right = printed if far <= unit(text) else max(0, int(mpmath.floor(-mpmath.log10(far))))
            found.append((right - printed, printed, right))
    return min(found)[1:] if found else (None, None)


def order_of(table: Table, numbers: list[mpmath.mpf]) -> tuple[int, ...]:
    """Return the order of a table's method with the coefficients ``numbers``, as the order conditions show it.

    For A + eps B it has an entry for each power of eps, as in (8, 4).
    """
    if table.name in force_gradient.FILE.tables:
        return _order_of_gradients(table, numbers)
    found = residuals(table.kind, table.steps(numbers), next_degrees(table.order))
    return observed_order(found, len(table.order))


def _order_of_gradients(table: Table, numbers: list[mpmath.mpf]) -> tuple[int]:
    found = force_gradient.residuals(table.steps(numbers), table.order[0] + 1)
    wrong = [n for n, r in enumerate(found) if max(map(abs, r)) > TOLERANCE]
    return (min(wrong, default=len(found)) - 1,)


def kernel_order(table: processed.ProcessedTable, numbers: list[mpmath.mpf]) -> tuple[int, ...]:
    """Compute the order of a processed method's kernel without its processor, in the form of `order_of`."""
    found = residuals(table.kind, table.kernel(numbers), next_degrees(table.order))
    return observed_order(found, len(table.order))


def _text(order: tuple[int, ...]) -> str:
    return ",".join(map(str, order))


def frame() -> pd.DataFrame:
    """Make the table "acta": a row for each method of `LISTED`, with its id here, order, and number of right digits."""
    rows = []
    with mpmath.workdps(DIGITS):
        for m in LISTED:
            row = {
                "kind": m.kind,
                "table": NUMBERED[m.kind] if m.quoted else "",
                "processed": m.processed,
                "stages": m.stages,
                "printed order": m.order,
                "work": m.work,
                "id": m.id,
                "order": "",
                "kernel order": "",
                "digits printed": None,
                "digits that hold": None,
                "why not": m.why,
            }
            if m.id:
                table = find_table(m.id)
                numbers = numbers_of(table)
                row["order"] = _text(order_of(table, numbers))
                row["digits printed"], row["digits that hold"] = digits(table, numbers)
                if m.processed:
                    row["kernel order"] = _text(kernel_order(table, numbers))
            rows.append(row)
    return pd.DataFrame(rows)
