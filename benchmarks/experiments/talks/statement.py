"""What a statement of the talks is: where it stands, a few words of it, and the judge of the rows."""

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
    words : what it says, in a few words
    judge : what the rows say of it
    page : the id of the page that shows it
    """

    where: str
    kind: str
    words: str
    judge: Judge
    page: str

    def judged(self, data) -> Judgement:
        """What the rows of ``data`` say."""
        return self.judge(data)
