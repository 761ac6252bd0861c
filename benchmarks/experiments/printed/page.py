"""The report page on a talk's printed error tables beside the measured ones, with the printed column of Scheme IV.

Scheme IV chooses a parameter lambda in each step so that H is kept.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.measure import metrics
from phasebench.benchmarks.page.markdown import join_list, number
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, of
from phasebench.benchmarks.page.verdict import EVERY, FAIL, NONE, Count, Verdict

from .printed import AGREEMENT, SCHEME_IV
from .recipes import CLAIM

if TYPE_CHECKING:
    from pathlib import Path


def _split_schemes(printed: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Split the table of printed entries into (the entries of Scheme IV, those of all other schemes).

    Scheme IV chooses a parameter lambda in each step so that H is kept.
    """
    iv = printed["scheme"] == SCHEME_IV[0]
    return printed[iv], printed[~iv]


def _agreeing(entries: pd.DataFrame) -> Count:
    return Count(int((entries["units"] <= AGREEMENT).sum()), len(entries))


@of("printed")
def agreement(printed: pd.DataFrame) -> Verdict | None:
    """Judge whether the talk's printed entries of all schemes but Scheme IV are reproduced.

    ``printed`` is the table of entries, a row for each scheme, parameter and step size; None if it has only Scheme IV.
    """
    _, rest = _split_schemes(printed)
    if rest.empty:
        return None
    worst = rest.loc[rest["units"].idxmax()]
    return Verdict(
        "The printed entries of Schemes I–III, AVF and V are reproduced",
        _agreeing(rest),
        EVERY,
        "entries",
        where=f"{worst['scheme']} at h = {number(worst['h'])}: {number(worst['units'])} of the last printed digit",
        otherwise=FAIL,
    )


@of("printed")
def scheme_iv(printed: pd.DataFrame) -> Verdict | None:
    """Judge whether the column that the talk prints for Scheme IV is reproduced.

    Scheme IV chooses a parameter lambda in each step so that H is kept.  ``printed`` is the table of entries; None if
    it has fewer than three of this scheme.
    """
    iv, _ = _split_schemes(printed)
    if len(iv) < 3:
        return None
    return Verdict("The printed entries of Scheme IV are reproduced", _agreeing(iv), EVERY, "entries")


@of("riddle")
def roots(scans: pd.DataFrame) -> Verdict:
    """Judge whether every step of Scheme IV has a root lambda near 1/2, so that no other branch of roots is taken.

    Scheme IV chooses a parameter lambda in each step so that H is kept.  ``scans`` is the table of the scans for such
    roots, a row for each step size.
    """
    steps, without = int(scans["steps"].sum()), int(scans["without a root"].sum())
    closest = (scans["far root closest to 1/2"] - 0.5).abs().min()
    return Verdict(
        "Every step of Scheme IV has a root near λ = 1/2",
        Count(steps - without, steps),
        EVERY,
        "steps",
        where=f"the nearest other root is {number(closest)} away" if closest == closest else "",
    )


@of("riddle_columns")
def explanations(columns: pd.DataFrame) -> Verdict | None:
    """Judge whether no other computation, such as a constant parameter, gives the column that is printed for Scheme IV.

    Scheme IV chooses a parameter lambda in each step so that H is kept.  ``columns`` is the table of the computations
    that were tried (recipes), a row for each; None if it has none.
    """
    recipes, entries = columns[columns["recipe"] != CLAIM], len(_entries(columns))
    if recipes.empty:
        return None
    best = recipes["entries that agree"].max()
    nearest = recipes[recipes["entries that agree"] == best]["recipe"]
    return Verdict(
        "No other computation that was tried gives Scheme IV's printed column",
        Count(int((recipes["entries that agree"] == entries).sum()), len(recipes)),
        NONE,
        "ways",
        where=f"{join_list(nearest, 3)}: {best} of {entries} entries" if best else "",
    )


@of("printed")
def answer(printed: pd.DataFrame) -> str:
    """Write the page's answer, a sentence: how many printed entries are reproduced, and the orders of Scheme IV.

    The orders are those of the scheme's printed and of its measured column; it chooses a parameter in each step to keep
    H.  ``printed`` is the table of entries.
    """
    iv, rest = _split_schemes(printed)
    same = _agreeing(rest)
    text = f"Of Schemes I–III, AVF and V {same.n} of {same.of} printed entries are reproduced"
    if len(iv) < 3:
        return f"{text}."
    measured, claimed = (
        metrics.power(iv["h"], iv[c].astype(float)).value for c in ("refinement_difference", "printed")
    )
    return f"{text}; Scheme IV's printed column has order {claimed:.2f}, the measured one {measured:.2f}, its theorem says 2."


def _entries(columns: pd.DataFrame) -> list[str]:
    """List the columns that hold entries, one for each step size, in the table of computations that were tried.

    The table has a row for each computation that might explain a printed column.
    """
    return [c for c in columns if c not in ("recipe", "entries that agree")]


@of("printed")
def draw(printed: pd.DataFrame, folder: Path) -> list[Picture]:
    """Draw how far measured entries are from the printed ones, and both columns of Scheme IV; save it in ``folder``.

    Left: the distances in units of the last printed digit over h, for all schemes but Scheme IV.  Right: the printed
    and the measured refinement differences of Scheme IV, which are not the same.  ``printed`` is the table of entries.
    """
    iv, rest = _split_schemes(printed)
    with style.settings():
        figure, ((left, right),) = style.panels(1, 2, 2.9)
        names = list(dict.fromkeys(rest["scheme"]))
        for k, name in enumerate(names):
            part = rest[rest["scheme"] == name]
            look = style.curve(k) | {"linestyle": "none"}
            left.semilogx(part["h"], part["units"], label=name, **look)
        left.axhline(AGREEMENT, color=style.GREY, linewidth=0.9, linestyle="--")
        left.set(xlabel="$h$", ylabel="units of the last printed digit", title="distance of measured from printed")
        left.set_ylim(0, 1)
        left.legend(loc="upper right", ncols=2)
        for k, (column, label) in enumerate((("printed", "printed"), ("refinement_difference", "measured"))):
            right.loglog(iv["h"], iv[column].astype(float), label=label, **style.curve(k))
        right.set(xlabel="$h$", ylabel="refinement difference", title="Scheme IV")
        right.legend()
        for axes in (left, right):
            axes.grid(color="0.93", linewidth=0.5)
    caption = (
        f"Left: distance of a measured entry from the printed one in units of its last digit (dashed: {AGREEMENT}, the limit "
        "of agreement). "
        "Right: Scheme IV's printed and measured refinement differences."
    )
    return [Picture(style.save(figure, folder, "printed.png"), "printed and measured entries", caption)]


def _format_rows(printed: pd.DataFrame) -> pd.DataFrame:
    scientific = {"printed": 2, "refinement_difference": 4, "global_error": 2}
    written = {c: [f"{float(x):.{n}e}" for x in printed[c]] for c, n in scientific.items()}
    shown = printed.assign(**{"lambda": printed["lambda"].astype(object).fillna("")}, **written)
    names = {"refinement_difference": "measured", "units": "units off", "global_error": "global error"}
    return shown[["scheme", "lambda", "h", *scientific, "order", "units"]].rename(columns=names)


@of("riddle_columns")
def table(columns: pd.DataFrame) -> Table:
    """Make the page's table: the computations tried to explain Scheme IV's printed column, those that agree most first.

    ``columns`` has a row for each computation, with the entry that it gives at each step size.
    """
    heads = _entries(columns)
    written = columns.assign(**{c: [f"{float(x):.3e}" for x in columns[c]] for c in heads})
    shown = written.sort_values("entries that agree", ascending=False, kind="stable").rename(
        columns={c: f"h = {c}" for c in heads}
    )
    caption = (
        "Scheme IV's printed column, and the computations that were tried to obtain it. The other schemes' entries are in "
        "the CSV, and in a table of the HTML page."
    )
    return Table(shown.head(ROWS), caption)


PAGE = Page(
    id="printed",
    question="Are the talk's printed tables reproduced?",
    tables=("printed", "riddle", "riddle_columns", "riddle_roots"),
    setting=(
        "H = (p₁² + p₂²)/2 + (q₁² + q₂²)/2 + q₁² q₂ − q₂³/3 (Hénon–Heiles), the talk's chaotic orbit, to t = 1.",
        "The talk: “A general symplectic integrator for canonical Hamiltonian systems” (Y. Wang with Y. Bo and W. Cai); all of "
        "its statements are judged on [the page of the talks](talks.md).",
        "Printed and measured: max |y_h − y_2h| over q and p at t = 1, the difference of successive refinements.",
        "Beside it stands the error against a certified Taylor solution, which the talk does not print.",
        "Scheme IV takes in each step the parameter λ near 1/2 that keeps H, by theorem λ = 1/2 + O(h) and order 2; a scan "
        "looks for every other root.",
    ),
    verdicts=(agreement, scheme_iv, roots, explanations),
    answer=answer,
    figures=draw,
    table=table,
    whole=of("printed")(_format_rows),
    limits=(
        f"An entry counts as reproduced within {AGREEMENT} of its last printed digit: 0.5 is rounding, the rest slack.",
        "The first printed row is taken to compare h = 0.02 with 0.01, which the talk does not say: the agreement confirms it.",
        "The scan covers the range of λ given in data/riddle.csv, on the branch of the stage equations that begins at λ = 1/2.",
        "The computations with a free number (λ = −51/50) or a slip (one step beyond t = 1) were searched for until entries "
        "agreed; that they come near explains nothing.",
    ),
    command="pytest benchmarks/experiments/printed",
)
