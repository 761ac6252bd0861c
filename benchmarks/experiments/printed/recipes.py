"""Computations that might explain the printed column of Scheme IV: other roots of its energy equation, other methods.

Scheme IV chooses a parameter lambda in each step so that H is kept.  The talk's table shows it as first order.  By its
theorem (lambda = 1/2 + O(h)) it is second order, and so it is as measured with the root nearest 1/2.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from phasebench.benchmarks.measure.accuracy import end_state
from phasebench.benchmarks.measure.metrics import refinement_difference
from phasebench.benchmarks.measure.root_scan import along, summary
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.base import Problem
from phasebench.benchmarks.store.cells import Cell, ProblemKey, Rows, content
from phasebench.integrators.driver import integrate
from phasebench.integrators.record import Method
from phasebench.integrators.registry import method

from .printed import AGREEMENT, PRINTED, SCHEME_IV, STEPS, unit


@dataclass(frozen=True)
class Recipe:
    """A computation that might have given the column that a talk prints for Scheme IV.

    Attributes
    ----------
    name : the computation's name in the page's table
    method : the method
    beyond : number of steps that runs go beyond the talk's end time t = 1
    q_alone : whether end states are compared in q alone, and not in (q, p)
    """

    name: str
    method: Method
    beyond: int = 0
    q_alone: bool = False

    def column(self, found: Problem) -> list[float]:
        """Compute the refinement differences ||y_h - y_2h|| of this candidate on a problem at the talk's steps."""
        kept = slice(found.system.d if self.q_alone else None)
        states = [
            end_state(integrate(found, self.method, h=h, steps=round(1 / h) + self.beyond, save_every=0)) for h in STEPS
        ]
        return [float(refinement_difference(a[kept], b[kept])) for a, b in pairwise(states)]


def scheme_i(lam: str) -> Method:
    """Return Scheme I, a symplectic one-stage method, with the constant parameter lambda = ``lam``."""
    return method("scheme-i", lam=lam)


#: Scheme IV itself, constant parameters, and the candidates that come nearest.
RECIPES = (
    Recipe("Scheme IV, root nearest 1/2", method("scheme-iv")),
    *(Recipe(f"Scheme I, lambda = {lam}", scheme_i(lam)) for lam in ("-2/5", "0", "1", "29/20", "3/2")),
    Recipe("implicit midpoint", method("implicit-midpoint")),
    Recipe("Scheme IV, one step more", method("scheme-iv"), beyond=1),
    Recipe("Scheme I, lambda = -51/50, in q alone", scheme_i("-51/50"), q_alone=True),
)
CLAIM = "printed for Scheme IV"


def agreeing(column: Sequence[float]) -> int:
    """Count the entries of a column that agree with the column of Scheme IV in the printed table.

    ``column`` has a number for each step size of the table; to agree is to be within `AGREEMENT` units of the printed
    number's last digit.
    """
    return sum(abs(x - float(t)) <= AGREEMENT * unit(t) for x, t in zip(column, PRINTED[SCHEME_IV], strict=True))


def columns() -> list[dict]:
    """Compute the table of candidates: a row for the printed column of Scheme IV, and one for each of `RECIPES`.

    A row has the entry at each step size, and the number of entries that agree with the printed ones.
    """
    found = problem("henon-heiles:chaotic")
    known = {CLAIM: [float(t) for t in PRINTED[SCHEME_IV]]} | {r.name: r.column(found) for r in RECIPES}
    heads = [f"{h:g}" for h in STEPS[1:]]
    return [
        {"recipe": name, **dict(zip(heads, column, strict=True)), "entries that agree": agreeing(column)}
        for name, column in known.items()
    ]


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`) on the printed column of Scheme IV; none if ``quick``.

    There is one for each step size, a scan for the roots of the scheme's energy equation, and one that compares other
    computations with the column.
    """
    scheme, problem_of = method("scheme-iv"), ProblemKey("henon-heiles:chaotic")
    names = frozenset({"henon-heiles", "scheme-iv"})

    def cell(tables: tuple[str, ...], key: dict, measure: Callable[..., Rows], arguments: tuple) -> Cell:
        about = content(measure.__name__, key, scheme, problem_of, code=[__name__])
        return Cell("printed", tables, key, measure, arguments, about, names)

    if quick:
        return []
    scans = [cell(("riddle", "riddle_roots"), {"h": h}, measure_scan_rows, (h,)) for h in STEPS]
    return [*scans, cell(("riddle_columns",), {}, recipes, ())]


def measure_scan_rows(h: float) -> Rows:
    """Scan every step of Scheme IV with step size h for all roots lambda of its energy equation: rows by table name.

    Scheme IV chooses a parameter lambda in each step so that H is kept.  One table has a summary of the scan, the other
    the roots that are not nearest to 1/2.
    """
    s = along(problem("henon-heiles:chaotic"), "scheme-iv", h, 1.0)
    roots = [{"h": h, "t": i * s.h, "lambda": float(lam)} for i, r in enumerate(s.roots) for lam in r[1:]]
    return {"riddle": [row | {"h": h} for row in summary([s])], "riddle_roots": roots}


def recipes() -> Rows:
    """Compare each computation of `RECIPES` with the printed column of Scheme IV: rows, by table name."""
    return {"riddle_columns": columns()}
