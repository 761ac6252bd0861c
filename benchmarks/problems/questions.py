"""QUESTIONS, the scenes on which costs are compared: a quantity of a problem at a time, and accuracies to reach.

The study `studies.trade` compares the costs at which integrators reach an accuracy.  (A `Scene` of `scenes` is another
thing: it has steps at which errors are compared with stored ones.)  The accuracies fall from 1e-1 (a picture needs
about 1e-2, an ephemeris 1e-12) as far as doubles and the reference's uncertainty allow.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .base import Problem


def down_to(last: int) -> tuple[float, ...]:
    """Return the accuracies (errors) 1e-1, 1e-2, ... down to ten to the minus ``last``."""
    return tuple(10.0**-k for k in range(1, last + 1))


@dataclass(frozen=True)
class Question:
    """A scene on which costs are compared: a problem, a time span, and a quantity to compute to given accuracies.

    Attributes
    ----------
    id, problem : kebab-case name, and ``id:orbit``
    t_end : the end of the span, in the problem's own unit of time
    quantity : the name of a quantity (`benchmarks.measure.quantities`)
    accuracies : falling errors, for each of which the cheapest integration is searched
    about : a description in one line
    """

    id: str
    problem: str
    t_end: float
    quantity: str
    accuracies: tuple[float, ...]
    about: str

    def build_problem(self) -> Problem:
        """Return the `Problem` of the question, on its orbit."""
        from . import problem

        return problem(self.problem)


def _question(id: str, entry: dict) -> Question:
    accuracies = tuple(entry["accuracies"]) if "accuracies" in entry else down_to(entry["to"])
    return Question(id, entry["problem"], entry["t_end"], entry["quantity"], accuracies, entry["about"])


_TABLE = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
QUESTIONS: tuple[Question, ...] = tuple(_question(id, entry) for id, entry in _TABLE.items())
BY_ID = {x.id: x for x in QUESTIONS}
