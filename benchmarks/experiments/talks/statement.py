"""The record `Statement` of a talk's statement: its place in the talk, its content in a few words, and its judge."""

from __future__ import annotations

from dataclasses import dataclass

from .judging import Judge, Judgement

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
    """A definition, theorem, remark, table, figure, formula, method or system of a talk.

    Attributes
    ----------
    where : its number in the talk, or its slide
    kind : one of `KINDS`
    words : its content in a few words
    judge : the function that decides from measured rows whether it holds
    page : the id of the page that shows the measurement
    """

    where: str
    kind: str
    words: str
    judge: Judge
    page: str

    def judgement(self, data) -> Judgement:
        """The judgement of the statement from the tables of ``data``."""
        return self.judge(data)
