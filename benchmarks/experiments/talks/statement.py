"""The record `Statement` of a talk's statement: its place in the talk, its content, and how it is judged."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from .judging import Judge, Judgement

if TYPE_CHECKING:
    from phasebench.benchmarks.page.page import Data

DEFINITION, THEOREM, REMARK, TABLE, FIGURE, FORMULA, METHOD, SYSTEM = KINDS = (
    "definition",
    "theorem",
    "remark",
    "table",
    "figure",
    "formula",
    "method",
    "system",
)


@dataclass(frozen=True)
class Statement:
    """A statement of a talk: a definition, theorem, remark, table, figure, formula, method or system.

    Attributes
    ----------
    where : its number in the talk, or its slide
    kind : one of `KINDS`
    words : its content in a few words
    judge : the function of measured tables that decides whether it holds
    page : the id of the page that shows the measurement
    """

    where: str
    kind: str
    words: str
    judge: Judge
    page: str

    def judgement(self, data: Data) -> Judgement:
        """Judge whether the statement holds; ``data`` maps a table's name to the measured table or None."""
        return self.judge(data)
