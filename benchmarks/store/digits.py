"""Which digits of a measured number are stored in the large tables: those that mean something.

Times get six digits, other numbers seven.  Steps, parameters, spans and whatever identifies a row keep all digits.
"""

from __future__ import annotations

import re
from collections.abc import Collection
from typing import Any

from .cells import text

#: Columns of times, of a step or of a run, and those of errors.
TIMES = re.compile(r"(seconds|first run|ms|(us|ns) [^,]*|.*'s ns .*)")
ERRORS = re.compile(r".*(error|defect|uncertainty|refinement_difference|symplecticity|reversibility|energy_max).*")
#: Numeric columns that describe the run, and so identify a row.
SETTINGS = re.compile(
    r"h|tol|e|mu|N|d|orbits|periods|points|lambda|t_end|x|number|pairs?|classical|h omega / pi|steps per orbit|stages"
)
#: Tables of thousands of rows, and their columns that identify rows, too.
LARGE = re.compile(
    r"rows|matrix|front_(finals|times)|kepler_\w+|extremes_(springs|resonances|multistep|solvers)|knobs_l\w+"
)
EXACT = re.compile(r"lam|t|accuracy|order|low|high|ratio|h omega \d")
#: Significant digits of times, and of other numbers.
OF_TIMES, OF_NUMBERS = 6, 7


def stored_text(table: str, column: str, value: Any, key: Collection[str] = ()) -> str:
    """A value as text in a table; a double of a large table is rounded unless its column identifies rows (``key``)."""
    if not (isinstance(value, float) and LARGE.fullmatch(table)) or column in key:
        return text(value)
    if SETTINGS.fullmatch(column) or EXACT.fullmatch(column):
        return text(value)
    digits = OF_TIMES if TIMES.fullmatch(column) else OF_NUMBERS
    return text(float(f"{value:.{digits}g}"))
