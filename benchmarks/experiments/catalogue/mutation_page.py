"""The report page on the suite's own tests: which deliberate faults they notice, and in which files none were tried."""

from __future__ import annotations

import pandas as pd

from phasebench.benchmarks.page.page import ROWS, Page, Table, of
from phasebench.benchmarks.page.verdict import EVERY, FAIL, Count, Verdict, at_least

COUNTS = ["mutants", "tried", "killed", "survived"]
#: The share of faults that tests are to notice; some change nothing that anybody could notice.
NOTICED = 0.95


def _folder(mutation: pd.DataFrame) -> pd.Series:
    """Return the folder of each file in the table, at most two levels deep."""
    return mutation["file"].map(lambda file: "/".join(file.split("/")[:-1][:2])).rename("folder")


@of("mutation")
def coverage(mutation: pd.DataFrame) -> Verdict:
    """Judge whether deliberate faults were tried in every source file."""
    tried = mutation["tried"] > 0
    left = _folder(mutation)[~tried].value_counts()
    return Verdict(
        "Faults were tried in every file",
        Count(int(tried.sum()), len(mutation)),
        EVERY,
        "files",
        where=f"{left.index[0]}: {left.iloc[0]} files not tried" if len(left) else "",
    )


@of("mutation")
def detection(mutation: pd.DataFrame) -> Verdict:
    """Judge whether a test fails for a large enough share of the deliberate faults that were tried."""
    worst = mutation.loc[mutation["survived"].idxmax()]
    return Verdict(
        "A test fails for a fault that was tried",
        Count(int(mutation["killed"].sum()), int(mutation["tried"].sum())),
        at_least(NOTICED),
        "faults",
        where=f"{worst['file']}: {worst['survived']} survive" if worst["survived"] else "",
        otherwise=FAIL,
    )


@of("mutation")
def answer(mutation: pd.DataFrame) -> str:
    """Write the page's answer: in how many files no fault was tried, and how many faults are noticed in the others."""
    tried = int((mutation["tried"] > 0).sum())
    return (
        f"In {len(mutation) - tried} of the suite's {len(mutation)} source files this was not tested; in the other "
        f"{tried} the tests notice {mutation['killed'].sum()} of {mutation['tried'].sum()} deliberate faults."
    )


@of("mutation")
def table(mutation: pd.DataFrame) -> Table:
    """Make the page's table: mutants tried and killed in each folder, and the number of files without any tried."""
    folders = mutation.groupby(_folder(mutation))
    lines = folders[COUNTS].sum()
    lines.insert(0, "files", folders.size())
    lines.insert(1, "not tried", (mutation["tried"] == 0).groupby(_folder(mutation)).sum())
    stale = int(((mutation["tried"] > 0) & ~mutation["as judged"].astype(bool)).sum())
    caption = (
        "By folder; possible mutants are counted in the files that were tried, of which "
        f"{stale or 'none'} changed since. The CSV has every file."
    )
    return Table(lines.reset_index().head(ROWS), caption)


@of("mutation")
def full_table(mutation: pd.DataFrame) -> pd.DataFrame:
    """Return the measured table "mutation" unchanged: a row for each source file, with its numbers of mutants."""
    return mutation


PAGE = Page(
    id="mutation",
    question="Would the suite's own tests notice if the suite were wrong?",
    tables=("mutation",),
    setting=(
        "A mutant is a source file with one fault: another number, sign, comparison, condition, choice or return.",
        "It is killed if a test that reaches the changed line fails, else it survives. Some survivors change no result.",
        "Large files: the first mutants of a fixed random order. Kernels are run as Python functions, on few steps.",
    ),
    verdicts=(coverage, detection),
    answer=answer,
    table=table,
    whole=full_table,
    limits=(
        "Not tried: two faults at once, missing code, compilation, the looks of figures and pages, faults in tests.",
    ),
    command="python tests/mutation benchmarks/experiments && pytest benchmarks/experiments/catalogue",
)
