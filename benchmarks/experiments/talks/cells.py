"""The measurements for the two talks: the curves of each figure, and each number that tests a statement.

A measurement is a `Cell`: a function, its arguments and the tables that its rows go to.
"""

from __future__ import annotations

from phasebench.benchmarks.problems import PROBLEMS
from phasebench.benchmarks.store.cells import Cell, ProblemKey, Rows, content
from phasebench.integrators.registry import METHODS

from . import checks
from .gallery import FIGURES
from .record import TABLE, Figure


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`): one for each figure with curves, one for each check; none if ``quick``.

    A check is a small measurement that tests a statement of a talk.
    """
    return [] if quick else [*(_cell(f) for f in FIGURES if f.measure), *checks.cells()]


def _cell(figure: Figure) -> Cell:
    # Only a figure's functions know which methods and problems they run: the cell depends on all of them.
    about = content("talk", figure.id, *METHODS, *map(ProblemKey, PROBLEMS), code=[figure.measure.__module__])
    return Cell("talks", (TABLE,), {"figure": figure.id}, measure_rows, (figure.id,), about, frozenset({figure.id}))


def measure_rows(id: str) -> Rows:
    """Measure the curves of the talks' figure with this id; return {`TABLE`: a row for each curve}."""
    return {TABLE: next(f for f in FIGURES if f.id == id).rows()}
