"""The page on the suite's own tests: which changes of the suite they notice."""

from __future__ import annotations

import pandas as pd

from phasebench.benchmarks.page.markdown import listed
from phasebench.benchmarks.page.page import ROWS, Page, Table, Verdict, of

COUNTS = ["mutants", "tried", "killed", "equivalent", "survived"]
#: Files that were not judged are named where a folder has so many at most.
FEW = 5


def _room(mutation: pd.DataFrame) -> pd.Series:
    """The folder of each file, that of the experiments for all below it."""
    return mutation["file"].map(lambda file: "/".join(file.split("/")[:-1][:2])).rename("folder")


@of("mutation")
def noticed(mutation: pd.DataFrame) -> Verdict:
    """Whether a test notices every change that was tried and matters."""
    mutants, tried, killed, equivalent, survived = (int(mutation[name].sum()) for name in COUNTS)
    files = f"{(mutation['tried'] > 0).sum()} of {len(mutation)} files"
    if not tried:
        text = f"Mutants were tried in {files}."
        return Verdict(text, False, text)
    text = (
        f"Mutants were tried in {files}, {tried} of their {mutants}: the tests notice {killed} ({killed / tried:.1%})"
    )
    text += f"; {equivalent} are argued to change nothing; {survived} survive"
    where = mutation[mutation["survived"] > 0]["file"]
    text += f": in {listed(list(where), 3)}." if survived else "."
    return Verdict(text, survived == 0, f"The tests notice {killed} of {tried} mutants of {files}; {survived} survive.")


@of("mutation")
def judged(mutation: pd.DataFrame) -> Verdict | None:
    """Of which files the score is that of today."""
    known = mutation[mutation["tried"] > 0]
    changed = known[~known["as judged"].astype(bool)]
    text = f"{len(known) - len(changed)} of these {len(known)} files are as they were when they were judged"
    text += f"; changed since: {listed(list(changed['file']), 3)}." if len(changed) else "."
    return Verdict(text, True, text) if len(known) else None


@of("mutation")
def unjudged(mutation: pd.DataFrame) -> Verdict:
    """Of which files nothing is known."""
    left = mutation[mutation["tried"] == 0]
    if left.empty:
        text = f"Not one of the {len(mutation)} files is left out."
        return Verdict(text, True, text)
    said = []
    for room, files in left["file"].groupby(_room(left)):
        names = [f"`{file.split('/')[-1]}`" for file in files]
        said.append(f"{listed(names, FEW)} in {room}" if len(names) <= FEW else f"{len(names)} in {room}")
    short = f"{len(left)} of {len(mutation)} files are not judged"
    return Verdict(f"{short}, and nothing is known of them: {'; '.join(said)}.", False, f"{short}.")


@of("mutation")
def table(mutation: pd.DataFrame) -> Table:
    """A line for each folder, whether or not a file of it was judged."""
    folders = mutation.groupby(_room(mutation))
    lines = folders[COUNTS].sum()
    lines.insert(0, "files", folders.size())
    lines.insert(1, "not judged", (mutation["tried"] == 0).groupby(_room(mutation)).sum())
    caption = "By folder; mutants are counted in the files that are judged. The CSV has every file."
    return Table(lines.reset_index().head(ROWS), caption)


@of("mutation")
def whole(mutation: pd.DataFrame) -> pd.DataFrame:
    """A line for each file, judged or not."""
    return mutation


PAGE = Page(
    id="mutation",
    question="Would the suite's own tests notice if the suite were wrong?",
    tables=("mutation",),
    setting=(
        "A mutant is a file with one change: another number, sign, comparison, condition, choice or return.",
        "Tests that reach its line are run on it; it is killed where one fails, else it survives.",
        "A survivor that changes nothing anybody could notice is argued so, one by one, in `tests/mutation/equivalent.toml`.",
        "Files: the modules of `benchmarks/`, `integrators/` and `reference/` that have a function, a comparison or a "
        "number.",
        "Where a file has more mutants than were tried, these are the first in an order by no rule.",
    ),
    verdicts=(noticed, judged, unjudged),
    table=table,
    whole=whole,
    limits=(
        "Looks are not changed: figures, how many names a sentence lists, to how many digits a number is shown.",
        "A test that fails for another reason than the change kills too; every test passed before.",
        "Two faults at once, and code that is missing, are no mutants.",
        "A kernel is changed and run as the Python function that it is written as, on few steps; its compilation is not judged.",
        "A file is entered when each of its survivors is killed or argued: some that are not judged were tried, and "
        "have survivors.",
        "Tests are not changed, and not counted among the files; `bench_*.py` are tests.",
    ),
    command="python tests/mutation benchmarks/experiments && pytest benchmarks/experiments/catalogue",
)
