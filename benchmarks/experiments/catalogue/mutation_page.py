"""The page on the suite's own tests: which changes of the suite they notice."""

from __future__ import annotations

import pandas as pd

from phasebench.benchmarks.page.markdown import listed
from phasebench.benchmarks.page.page import ROWS, Page, Table, Verdict, of

COUNTS = ["mutants", "tried", "killed", "equivalent", "survived"]


@of("mutation")
def noticed(mutation: pd.DataFrame) -> Verdict:
    """Whether a test notices every change that matters."""
    tried, killed, equivalent, survived = (int(mutation[name].sum()) for name in COUNTS[1:])
    text = f"Of {tried} mutants of {len(mutation)} files the tests notice {killed} ({killed / tried:.1%})"
    text += f"; {equivalent} are argued to change nothing; {survived} survive"
    where = mutation[mutation["survived"] > 0]["file"]
    text += f": in {listed(list(where), 3)}." if survived else "."
    return Verdict(text, survived == 0, f"The tests notice {killed} of {tried} mutants; {survived} survive.")


@of("mutation")
def judged(mutation: pd.DataFrame) -> Verdict:
    """Of which files the score is that of today."""
    changed = mutation[~mutation["as judged"].astype(bool)]
    text = f"{len(mutation) - len(changed)} of {len(mutation)} files are as they were when they were judged"
    text += f"; changed since: {listed(list(changed['file']), 3)}." if len(changed) else "."
    return Verdict(text, True, text)


@of("mutation")
def table(mutation: pd.DataFrame) -> Table:
    """A line for each folder, that of the experiments with all below it."""
    room = mutation["file"].map(lambda file: "/".join(file.split("/")[:-1][:2]))
    lines = mutation.groupby(room)[COUNTS].sum()
    lines.insert(0, "files", mutation.groupby(room).size())
    return Table(lines.rename_axis("folder").reset_index().head(ROWS), "By folder; the CSV has every file.")


@of("mutation")
def whole(mutation: pd.DataFrame) -> pd.DataFrame:
    """A line for each file."""
    return mutation


PAGE = Page(
    id="mutation",
    question="Would the suite's own tests notice if the suite were wrong?",
    tables=("mutation",),
    setting=(
        "A mutant is a file with one change: another number, sign, comparison, condition, choice or return.",
        "Tests that reach its line are run on it; it is killed where one fails, else it survives.",
        "A survivor that changes nothing anybody could notice is argued so, one by one, in `tests/mutation/equivalent.toml`.",
        "Where a file has more mutants than were tried, these are the first in an order by no rule.",
    ),
    verdicts=(noticed, judged),
    table=table,
    whole=whole,
    limits=(
        "Looks are not changed: figures, how many names a sentence lists, to how many digits a number is shown.",
        "A test that fails for another reason than the change kills too; every test passed before.",
        "Two faults at once, and code that is missing, are no mutants.",
        "A kernel is changed and run as the Python function that it is written as, on few steps; its compilation is not judged.",
        "A file is entered when each of its survivors is killed or argued: of files that are not listed nothing is said, and some that were tried have survivors.",
    ),
    command="python tests/mutation benchmarks/experiments && pytest benchmarks/experiments/catalogue",
)
