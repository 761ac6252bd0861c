"""Error tables printed in a talk on symplectic schemes, entry by entry, beside the measured values.

The tables "Convergence rates with chaotic orbits at t = 1" print the successive refinement difference ||y_h - y_2h|| in
the maximum norm over (p, q), the first row pairing h = 0.02 with h = 0.01 (a convention that the agreement itself
confirms), not the error against the exact solution; both are tabulated here.

Source: Y. Wang, Y. Bo, W. Cai, "A general symplectic integrator for canonical Hamiltonian systems" (talk).
"""

from __future__ import annotations

from collections.abc import Iterator
from math import floor, log10
from typing import TYPE_CHECKING

import numpy as np

from phasebench.benchmarks.measure import metrics
from phasebench.benchmarks.measure.accuracy import end_state, truth
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import Cell, ProblemKey, Rows, content
from phasebench.integrators.driver import integrate
from phasebench.integrators.registry import method

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem
    from phasebench.integrators.record import Method

SCENE = "henon-heiles-chaotic-t1"
STEPS = tuple(0.02 / 2**k for k in range(5))

#: (scheme, lambda) -> the four printed entries at h = 0.02/2, 0.02/4, 0.02/8, 0.02/16.
PRINTED: dict[tuple[str, str | None], tuple[str, str, str, str]] = {
    ("scheme-i", "-1"): ("4.31E-03", "2.09E-03", "1.03E-03", "5.13E-04"),
    ("scheme-i", "1/3"): ("4.38E-04", "2.23E-04", "1.12E-04", "5.63E-05"),
    ("scheme-i", "3/2"): ("2.63E-03", "1.34E-03", "6.73E-04", "3.38E-04"),
    ("scheme-i", "2"): ("3.85E-03", "1.98E-03", "1.00E-03", "5.06E-04"),
    ("scheme-ii", "-1"): ("5.09E-04", "1.25E-04", "3.11E-05", "7.74E-06"),
    ("scheme-ii", "1/3"): ("2.35E-05", "5.87E-06", "1.47E-06", "3.67E-07"),
    ("scheme-ii", "3/2"): ("2.24E-04", "5.67E-05", "1.42E-05", "3.57E-06"),
    ("scheme-ii", "2"): ("4.77E-04", "1.21E-04", "3.06E-05", "7.68E-06"),
    ("scheme-iii", "-1"): ("1.12E-04", "2.79E-05", "6.97E-06", "1.74E-06"),
    ("scheme-iii", "1/3"): ("3.54E-06", "8.84E-07", "2.21E-07", "5.52E-08"),
    ("scheme-iii", "3/2"): ("5.04E-05", "1.26E-05", "3.15E-06", "7.88E-07"),
    ("scheme-iii", "2"): ("1.18E-04", "2.94E-05", "7.34E-06", "1.84E-06"),
    ("avf", None): ("1.78E-05", "4.46E-06", "1.11E-06", "2.78E-07"),
    ("scheme-iv", None): ("2.50E-03", "1.24E-03", "6.22E-04", "3.10E-04"),
    ("scheme-v", None): ("4.23E-06", "1.06E-06", "2.64E-07", "6.60E-08"),
}
#: A measured entry agrees if it is within this many units of the last printed digit.
AGREEMENT = 0.6
#: The column that Scheme IV with the root nearest 1/2 does not reproduce; see `recipes`.
SCHEME_IV = ("scheme-iv", None)


def unit(printed: str) -> float:
    """Return one unit of the last digit of a printed entry such as 4.31E-03."""
    return 10.0 ** (floor(log10(float(printed))) - 2)


def ends(made: Problem, chosen: Method) -> list[np.ndarray]:
    """Integrate the problem ``made`` by the method ``chosen`` to t = 1 with each step size of `STEPS`.

    Returns the end states (q, p), arrays (2 d,).
    """
    found = [integrate(made, chosen, h=h, t_end=1.0, save_every=0) for h in STEPS]
    return [end_state(s) for s in found]


def column_rows(scheme: str, lam: str | None) -> Iterator[dict]:
    """Reproduce the printed column of a scheme at the parameter ``lam`` (None without one), a row for each step size.

    A row has h, the printed entry, the measured refinement difference, the order, the error and its uncertainty, and
    the distance from the printed entry in units of its last digit.
    """
    made = problem("henon-heiles:chaotic")
    chosen = method(scheme, **({} if lam is None else {"lam": lam}))
    true = truth(SCENE)
    states = ends(made, chosen)
    last = None
    for k, text in enumerate(PRINTED[scheme, lam], 1):
        difference = float(metrics.refinement_difference(states[k - 1], states[k]))
        yield {
            "scheme": scheme,
            "lambda": lam or "",
            "h": STEPS[k],
            "printed": text,
            "refinement_difference": difference,
            "order": float(np.log2(last / difference)) if last else float("nan"),
            "units": abs(difference - float(text)) / unit(text),
            "global_error": true.error(states[k]),
            "uncertainty": true.uncertainty,
        }
        last = difference


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`), one for each printed column.

    The list does not depend on ``quick``; only the measurement of Scheme I with lambda = 1/3 is marked as part of a
    quick run.
    """
    return [_cell(scheme, lam, (scheme, lam) == ("scheme-i", "1/3")) for scheme, lam in PRINTED]


def _cell(scheme: str, lam: str | None, handful: bool) -> Cell:
    chosen = method(scheme, **({} if lam is None else {"lam": lam}))
    return Cell(
        "printed",
        ("printed",),
        {"scheme": scheme, "lambda": lam or ""},
        column,
        (scheme, lam),
        content("printed", chosen, ProblemKey("henon-heiles:chaotic"), STEPS, PRINTED[scheme, lam], code=[__name__]),
        frozenset({"henon-heiles", scheme}),
        quick=handful,
    )


def column(scheme: str, lam: str | None) -> Rows:
    """Reproduce the printed column of a scheme at the parameter ``lam`` (None without one): rows, by table name.

    There is a row for each step size, with the printed and the measured entry.
    """
    return {"printed": list(column_rows(scheme, lam))}
