"""The report page on results from other machines: their errors beside those of runs here with as many evaluations."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.page.markdown import join_list, number
from phasebench.benchmarks.page.page import ROWS, Data, Page, Picture, Table, of
from phasebench.benchmarks.page.shared import case
from phasebench.benchmarks.page.verdict import EVERY, Count, Verdict, at_most

from .measure import METHODS, MOST, OURS, THEIRS

#: Largest difference of two energy errors of the same method and step that counts as round-off, of energies of size 1.
SAME = 1e-12
#: Errors below this are drawn at it.
LEAST = 1e-16
BY = "measured elsewhere by"


def _twins(theirs: pd.DataFrame) -> pd.DataFrame:
    """Select the results from other machines that a method here repeated with the same coefficients and step.

    The added column ``apart`` has the difference of the two energy errors.
    """
    both = theirs.dropna(subset="twin_energy_error")
    return both.assign(apart=(both["energy_error"] - both["twin_energy_error"]).abs())


@of(THEIRS)
def reproduced(theirs: pd.DataFrame) -> Verdict | None:
    """Judge whether methods here with the same coefficients reach the energy errors measured on other machines.

    ``theirs`` has a row for each result from another machine; None if no such method was run.
    """
    both = _twins(theirs)
    if both.empty:
        return None
    worst = both.loc[both["apart"].idxmax()]
    return Verdict(
        "Methods of this suite with the same coefficients have the same energy errors",
        Count(int((both["apart"] <= SAME).sum()), len(both)),
        EVERY,
        "rows",
        where=f"{worst['method']}, h = {number(worst['h'])}: {number(worst['apart'], 2)} apart",
    )


@of(THEIRS)
def certain(theirs: pd.DataFrame) -> Verdict | None:
    """Judge whether the reference's uncertainty is below the errors of the end states; None without such errors.

    ``theirs`` has a row for each result from another machine.
    """
    rows = theirs.dropna(subset="error")
    if rows.empty:
        return None
    share = rows["uncertainty"] / rows["error"].where(rows["error"] > 0)
    worst = rows.loc[share.idxmax()] if share.notna().any() else rows.iloc[0]
    return Verdict(
        "The reference is more certain than the errors of the end states",
        float(share.max()),
        at_most(1.0),
        "times the error",
        where=case(worst),
    )


def answer(data: Data) -> str | None:
    """Write the page's answer: how many results other packages have, and how many of their energy errors recur here."""
    theirs, verdict = data(THEIRS), reproduced(data)
    if theirs is None or theirs.empty:
        return None
    packages = join_list(list(dict.fromkeys(f"{r.package} ({r.language})" for r in theirs.itertuples())), 3)
    text = f"{len(theirs)} rows of {packages} were measured on other machines"
    if verdict is None:
        return f"{text}."
    return f"{text}; {verdict.measured.n} of {verdict.measured.of} that are run again here have the same energy error."


def _size(frame: pd.DataFrame) -> pd.Series:
    """Return for each row the error of the end state, or the size of the energy error if the row has no end state."""
    return frame["error"].astype(float).fillna(frame["energy_error"].astype(float).abs())


def _kind(row: pd.Series) -> str:
    return "energy error" if pd.isna(row["error"]) else "error of (q, p)"


@of(THEIRS, OURS)
def draw(theirs: pd.DataFrame, ours: pd.DataFrame, folder: Path) -> list[Picture]:
    """Draw the size of the energy error at the end against the evaluations, a panel for each file (at most two).

    ``theirs`` has the results from other machines, ``ours`` the runs of this suite's methods; the figure is saved in
    ``folder``.
    """
    files = list(dict.fromkeys(theirs["file"]))[:2]
    with style.settings():
        figure, panels = style.panels(1, len(files), 4.2)
        for axes, file in zip(panels[0], files, strict=True):
            part, own = theirs[theirs["file"] == file], ours[(ours["file"] == file) & (ours["status"] == "ok")]
            for k, (name, rows) in enumerate(own.groupby("method", sort=False)):
                size = rows["energy_error"].abs().clip(lower=LEAST)
                axes.loglog(rows["evaluations"], size, label=name, **style.curve(k))
            names = list(part["method"].unique())
            same = next((k for k, letters in enumerate(zip(*names, strict=False)) if len(set(letters)) > 1), 0)
            for k, (name, rows) in enumerate(part.groupby("method", sort=False)):
                size = rows["energy_error"].abs().clip(lower=LEAST)
                look = style.curve(k) | {"color": "0.5", "mfc": "none", "lw": 0.7}
                axes.loglog(rows["evaluations"], size, label=name[same:], **look)
            axes.set(xlabel="evaluations of the gradient", ylabel="|H − H₀| at the end", title=file)
            axes.grid(color="0.93", linewidth=0.5)
        style.legend_above(figure, panels[0][0], 4)
    caption = (
        "Size of H − H₀ at the end against the evaluations: grey and hollow what was measured elsewhere, coloured this "
        "suite's methods, run here."
    )
    return [Picture(style.save(figure, folder, "elsewhere.png"), "energy error against evaluations", caption)]


def _best(ours: pd.DataFrame, row: pd.Series) -> dict:
    """Find the method of this suite that has the least error with at most as many evaluations as a row.

    ``row`` is a result from another machine, ``ours`` has the runs of this suite's methods.  The errors compared are of
    the end state or, if ``row`` has none, of the energy.  Returns the method's id and its error, as two columns of the
    page's table.
    """
    column = "energy_error" if pd.isna(row["error"]) else "error"
    able = ours[(ours["file"] == row["file"]) & (ours["evaluations"] <= row["evaluations"]) & (ours["status"] == "ok")]
    sizes = able[column].astype(float).abs()
    if sizes.isna().all():
        return {"least here": "", "its error": ""}
    best, least = able.loc[sizes.idxmin()], float(sizes.min())
    return {"least here": best["method"], "its error": number(least) if least > LEAST else f"below {LEAST:g}"}


@of(THEIRS, OURS)
def table(theirs: pd.DataFrame, ours: pd.DataFrame) -> Table:
    """Make the page's table: each method's rows with the fewest and the most evaluations, beside this suite's best.

    ``theirs`` has the results from other machines, ``ours`` the runs of this suite's methods.
    """
    compared = theirs[theirs["evaluations"] <= MOST]
    lines = []
    for _, part in compared.groupby(["file", "method"], sort=False):
        ends = part.sort_values("evaluations").iloc[[0, -1]].drop_duplicates(subset="evaluations")
        lines += [_line(row, ours) for _, row in ends.iterrows()]
    shown = lines[:ROWS]
    caption = (
        f"Each method's row with the fewest evaluations, and with the most up to {MOST}; beside it the method of the same "
        f"coefficients, and the least error of {join_list(list(METHODS))}, run here with at most as many evaluations: what a "
        "low order costs, whoever runs it."
    )
    if len(lines) > len(shown):
        caption += f" {len(lines) - len(shown)} more lines are in data/{THEIRS}.csv."
    return Table(pd.DataFrame(shown), caption)


def _line(row: pd.Series, ours: pd.DataFrame) -> dict:
    size = float(_size(row.to_frame().T).iloc[0])
    step = f"tol = {number(row['tol'])}" if pd.isna(row["h"]) else f"h = {number(row['h'])}"
    return {
        BY: f"{row['package']} {row['version']}, {row['language']}",
        "method": row["method"],
        "step": step,
        "evaluations": int(row["evaluations"]),
        "what": _kind(row),
        "error": number(size),
        "same here": row["twin"] if isinstance(row["twin"], str) else "",
        **_best(ours, row),
    }


@of(THEIRS)
def whole(theirs: pd.DataFrame) -> pd.DataFrame:
    """Make the page's long table: all results from other machines (the rows of ``theirs``), in selected columns."""
    columns = ["package", "method", "h", "tol", "evaluations", "energy_error", "error", "uncertainty", "twin"]
    return theirs[columns].replace({np.nan: None}).astype(object).fillna("")


PAGE = Page(
    id="elsewhere",
    question="Do integrators measured on other machines have the errors that the same methods have here?",
    tables=(THEIRS, OURS),
    setting=(
        "Rows of integrators in other languages come as files, made on their own machine or taken from a published table; the "
        "format is checked when they are read.",
        "They are compared in errors and evaluations, never in time.",
        "An end state's error is computed here against the certified reference; an energy error, H − H₀ at the end, is the "
        "source's own where it gives no state.",
        "SUNDIALS: the Kepler problem H = |p|²/2 − 1/|q|, e = 0.6, to t = 50; the answers that its repository stores for the "
        "example ark_kepler (its source is in the file).",
        "Where a method here has the same coefficients, it is run with the same step.",
    ),
    verdicts=(reproduced, certain),
    answer=answer,
    figures=draw,
    table=table,
    whole=whole,
    limits=(
        f"Two energy errors are the same within {SAME:g}, the round-off of some thousand steps: of larger errors that is many "
        "digits, of the smallest it is none.",
        "SUNDIALS ends at t = 50 exactly with a shortened step, if n steps of h in doubles do not: that step is below 1e-10.",
        "An energy error at one time depends on where on the orbit it is: the same method can have less at a longer step.",
        f"Rows with more than {MOST} evaluations are in the table of data alone.",
    ),
    command="pytest benchmarks/experiments/elsewhere",
)
