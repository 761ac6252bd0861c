"""The curves of the talks' figures as cells, one for each figure, and the checks of their statements."""

from __future__ import annotations

from phasebench.benchmarks.problems import PROBLEMS
from phasebench.benchmarks.rows.cells import Cell, Problem, Rows, content
from phasebench.integrators.registry import METHODS

from . import checks
from .gallery import FIGURES
from .record import TABLE, Figure


def cells(quick: bool = False) -> list[Cell]:
    """A cell for each figure that is measured and each check; none of the quick tier."""
    return [] if quick else [*(_cell(f) for f in FIGURES if f.measure), *checks.cells()]


def _cell(figure: Figure) -> Cell:
    # Which methods and problems a figure runs stands in its functions: it depends on all.
    about = content("talk", figure.id, *METHODS, *map(Problem, PROBLEMS), code=[figure.measure.__module__])
    return Cell("talks", (TABLE,), {"figure": figure.id}, measured, (figure.id,), about, frozenset({figure.id}))


def measured(id: str) -> Rows:
    """The rows of a figure."""
    return {TABLE: next(f for f in FIGURES if f.id == id).rows()}
