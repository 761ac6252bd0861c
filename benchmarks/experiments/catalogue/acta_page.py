"""The report page on the methods in the Acta Numerica survey of splitting methods: which of them are here?"""

from __future__ import annotations

import pandas as pd

from phasebench.benchmarks.page.markdown import join_list
from phasebench.benchmarks.page.page import ROWS, Page, Table, of
from phasebench.benchmarks.page.verdict import EVERY, FAIL, Count, Verdict

from .acta import NO_SOURCE


def _has_numbers(acta: pd.DataFrame) -> pd.Series:
    """True for each listed method for which a public source with its coefficients was found.

    ``acta`` has a row for each method that the Acta Numerica survey of splitting methods lists.
    """
    return acta["why not"].astype(object).fillna("") != NO_SOURCE


def _here(acta: pd.DataFrame) -> pd.DataFrame:
    """Select the rows of the listed methods that this project has.

    ``acta`` has a row for each method that the Acta Numerica survey of splitting methods lists.
    """
    return acta[acta["id"].astype(object).fillna("") != ""]


@of("acta")
def coverage(acta: pd.DataFrame) -> Verdict:
    """Judge whether this project has every listed method for which coefficients were found.

    ``acta`` has a row for each method that the Acta Numerica survey of splitting methods lists.
    """
    published = acta[_has_numbers(acta)]
    missing = list(published[published["id"].astype(object).fillna("") == ""]["work"])
    return Verdict(
        "Every listed method whose coefficients were found is here",
        Count(len(published) - len(missing), len(published)),
        EVERY,
        "methods",
        where=join_list(missing, 3) if missing else "",
    )


@of("acta")
def sources(acta: pd.DataFrame) -> Verdict:
    """Judge whether a public source with the coefficients was found for every listed method.

    ``acta`` has a row for each method that the Acta Numerica survey of splitting methods lists.
    """
    found = _has_numbers(acta)
    return Verdict(
        "The coefficients of every listed method were found",
        Count(int(found.sum()), len(acta)),
        EVERY,
        "rows",
        where=join_list(list(acta[~found]["work"]), 3) if not found.all() else "",
    )


def _agrees(row: pd.Series) -> bool:
    """True if a method's printed order consists of the first entries of the computed one, as (8, 4) of (8, 4, 4).

    A printed order of a single number agrees only with a computed one of a single number.  ``row`` is a row of the
    table "acta", with both orders.
    """
    printed, order = str(row["printed order"]).split(","), str(row["order"]).split(",")
    return order[: len(printed)] == printed and (len(printed) > 1 or len(order) == 1)


@of("acta")
def orders(acta: pd.DataFrame) -> Verdict:
    """Judge whether the order conditions give every listed method of this project its printed order, and no more.

    ``acta`` has a row for each method that the Acta Numerica survey of splitting methods lists.
    """
    here = _here(acta)
    good = here.apply(_agrees, axis=1)
    return Verdict(
        "The order conditions give every method its printed order, and no more",
        Count(int(good.sum()), len(here)),
        EVERY,
        "methods",
        where=join_list(list(here[~good]["id"]), 4) if not good.all() else "",
        otherwise=FAIL,
    )


@of("acta")
def printed_digits(acta: pd.DataFrame) -> Verdict | None:
    """Judge whether all printed digits are right for every method with rounded coefficients; None if there are none.

    ``acta`` has a row for each method that the Acta Numerica survey of splitting methods lists.
    """
    rounded = _here(acta).dropna(subset=["digits printed"])
    if rounded.empty:
        return None
    short = rounded[rounded["digits that hold"] < rounded["digits printed"]]
    lost = short["digits printed"] - short["digits that hold"]
    worst = short.loc[lost.idxmax()] if len(short) else None
    return Verdict(
        "Every printed digit of the coefficients holds",
        Count(len(rounded) - len(short), len(rounded)),
        EVERY,
        "methods",
        where=f"{worst['id']}: {worst['digits that hold']:.0f} of {worst['digits printed']:.0f}" if len(short) else "",
    )


@of("acta")
def processors(acta: pd.DataFrame) -> Verdict | None:
    """Judge whether every processed method's kernel has a lower order without its processor; None if there are none.

    ``acta`` has a row for each method that the Acta Numerica survey of splitting methods lists.
    """
    here = _here(acta)
    made = here[here["processed"].astype(bool)]
    if made.empty:
        return None
    same = made[made["kernel order"].astype(str) == made["order"].astype(str)]
    return Verdict(
        "Every processed kernel has a lower order without its processor",
        Count(len(made) - len(same), len(made)),
        EVERY,
        "methods",
        where=join_list(list(same["id"]), 4) if len(same) else "",
        otherwise=FAIL,
    )


@of("acta")
def count_listed(acta: pd.DataFrame) -> str:
    """Write the page's answer: how many methods of the Acta Numerica survey are here, and how many are processed.

    Processed methods have a kernel and a processor.  The answer also counts the rows of ``acta``, each a method or a
    publication's group of methods, for which no source of the coefficients was found.
    """
    here = _here(acta)
    return (
        f"{len(here)} splitting and composition methods of Acta Numerica's survey are here, "
        f"{int(here['processed'].astype(bool).sum())} of them processed; "
        f"of {int((~_has_numbers(acta)).sum())} groups no numbers were found."
    )


def _digits(row: pd.Series) -> str:
    """Format how many of the printed decimals hold, as "14 of 15"; "" if the coefficients are not rounded."""
    printed, right = row["digits printed"], row["digits that hold"]
    return "" if pd.isna(printed) else f"{right:.0f} of {printed:.0f}"


@of("acta")
def _missing_and_worst(acta: pd.DataFrame) -> Table:
    """Make the page's table: methods of the survey that are missing, processed ones, then those with most wrong digits.

    Processed methods are those with a kernel and a processor.
    """
    lost = acta["digits printed"].astype(float) - acta["digits that hold"].astype(float)
    rank = lost.fillna(-1.0)
    rank[acta["processed"].astype(bool)] += 100.0
    rank[acta["id"].astype(object).fillna("") == ""] += 1000.0
    shown = acta.loc[rank.sort_values(ascending=False, kind="stable").index].head(ROWS)
    columns = ["table", "kind", "stages", "printed order", "work", "id", "order", "kernel order", "why not"]
    texts = shown[columns].astype(object).where(shown[columns].notna(), "")
    texts.insert(len(columns) - 1, "digits that hold", shown.apply(_digits, axis=1))
    caption = (
        "The rows that are not here, the processed methods, and those of which the fewest printed digits hold; `order` "
        "is by the order conditions, with the processor. data/acta.csv has every row."
    )
    return Table(texts, caption)


@of("acta")
def _all(acta: pd.DataFrame) -> pd.DataFrame:
    return acta


PAGE = Page(
    id="acta",
    question="Which of the splitting methods in Acta Numerica's survey of 2024 are here?",
    tables=("acta",),
    setting=(
        "The survey is Blanes, Casas and Murua, Splitting methods for differential equations, Acta Numerica 33 (2024).",
        "Orders are computed from the coefficients, as on the page [coefficients](coefficients.md). A printed decimal holds "
        "if the number is within one unit of it of the nearest solution of the order conditions.",
        "A processed method is P Kⁿ P⁻¹ for n steps: a step costs the kernel K, and the processor P gives its order. P and "
        "its inverse act where a state is stored.",
    ),
    verdicts=(coverage, sources, orders, printed_digits, processors),
    answer=count_listed,
    table=_missing_and_worst,
    whole=_all,
    limits=(
        "The survey's text was not at hand. `table` names its table where a public program transcribes the row; the other "
        "rows are methods of the works that it collects, and methods of its own may be missing.",
        "Digits are those of the copy that was read, at times more than were printed. Decimals are counted from the point: a "
        "small number of as many significant digits as the others has its last ones beyond what holds.",
        "An order (p, q, …) is that of the terms in ε, ε², …; the printed one may leave out the last.",
    ),
    command="pytest benchmarks/experiments/catalogue",
)
