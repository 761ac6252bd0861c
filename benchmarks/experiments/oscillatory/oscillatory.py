r"""Resonances of the integrators for highly oscillatory systems: the Fermi-Pasta-Ulam problem over h omega.

For each method and each :math:`h\omega`: the greatest error of H and the greatest deviation of the oscillatory energy
I over a time span.  omega is that of the published problem and h varies; a curve therefore shows the growth with h as
well as the resonances near the integer multiples of pi.

After E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration (2006), XIII.2 (there h is fixed and omega
varies).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.fpu import oscillatory_energies
from phasebench.benchmarks.store.cells import Cell, ProblemKey, Rows, content
from phasebench.integrators.driver import INVALID, OK, integrate
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.record import Method
from phasebench.integrators.records.oscillatory import METHODS
from phasebench.integrators.registry import method

if TYPE_CHECKING:
    import pandas as pd

SPAN = 200.0
#: The first point of the grid, in h omega, far below the resonances; its last point, in multiples of pi.
FIRST, LAST = 0.1, 4.5


def methods() -> tuple[Method, ...]:
    """List every method for systems with a fast linear part, and Stormer-Verlet."""
    return (*METHODS, method("stormer-verlet"))


def multiples(parts: int) -> list[float]:
    """Return the grid of h omega / pi: `FIRST` / pi, then the multiples of 1 / ``parts`` up to `LAST`."""
    return [FIRST / math.pi, *(k / parts for k in range(1, round(LAST * parts) + 1) if k / parts > FIRST / math.pi)]


def errors(methods: Iterable[Method], ratios: Sequence[float], t_end: float = SPAN, **parameters: Any) -> pd.DataFrame:
    """Integrate the Fermi-Pasta-Ulam problem and return the errors: a row for each method and each h omega / pi.

    Parameters
    ----------
    methods : methods to integrate with
    ratios : values of h omega / pi
    t_end : time span; h is not adjusted to it, the last step may end a little later
    parameters : parameters of the Fermi-Pasta-Ulam problem

    Returns
    -------
    DataFrame with the columns method, h omega / pi, h, steps, status, reason, energy error, oscillatory energy error;
    the errors are the greatest over all steps, absolute, and missing where the status is not ok
    """
    import pandas as pd

    found = problem("fpu", **parameters)
    system, omega = found.system, found.parameters["omega"]
    energy = sum(oscillatory_energies(found))
    rows = []
    for chosen in methods:
        for ratio in ratios:
            h = ratio * math.pi / omega
            steps = math.ceil(t_end / h)
            row = {"method": chosen.label, "h omega / pi": ratio, "h": h, "steps": steps}
            try:
                s = integrate(found, chosen, h=h, steps=steps)
            except InvalidInput as error:
                rows.append(row | {"status": INVALID, "reason": str(error)})
                continue
            row |= {"status": s.status, "reason": s.reason}
            if s.status == OK:
                for name, expression in (("energy error", system.H), ("oscillatory energy error", energy)):
                    value = system.observe(expression, s.q, s.p)
                    row[name] = float(np.abs(value - value[0]).max())
            rows.append(row)
    frame = pd.DataFrame(rows)
    return frame.reindex(columns=[*(c for c in frame if c not in ERRORS), *ERRORS])


ERRORS = ("energy error", "oscillatory energy error")
PARTS = 40


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`), one for each method; none if ``quick``."""
    return [] if quick else [_cell(m) for m in methods()]


def _cell(chosen: Method) -> Cell:
    return Cell(
        "oscillatory",
        ("oscillatory",),
        {"method": chosen.label},
        measure_rows,
        (chosen.id,),
        content("oscillatory", chosen, ProblemKey("fpu"), code=[__name__]),
        frozenset({"fpu", chosen.id}),
    )


def measure_rows(id: str) -> Rows:
    """Measure the errors of the method ``id`` on the Fermi-Pasta-Ulam problem: rows for all h omega, by table name."""
    frame = errors([method(id)], multiples(PARTS))
    return {"oscillatory": frame.astype(object).where(frame.notna(), None).to_dict("records")}
