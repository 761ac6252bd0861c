"""The report page on coefficient tables in the sources of packages: are their orders and digits right?"""

from __future__ import annotations

import pandas as pd

from phasebench.benchmarks.page.markdown import join_list
from phasebench.benchmarks.page.page import ROWS, Page, Table, of
from phasebench.benchmarks.page.verdict import EVERY, FAIL, Count, Verdict

TABLE = "transcribed"
#: Largest difference of a measured order, or of its interval, from that of the order conditions.
GATE = 0.1


def _text(rows: pd.DataFrame, column: str) -> pd.Series:
    """Return a column as text, with "" where a value is missing."""
    return rows[column].astype(object).where(rows[column].notna(), "").astype(str)


def _reaches(rows: pd.DataFrame, column: str) -> pd.Series:
    """True for each row whose order by the order conditions is at least the one in ``column``, in every power of eps.

    ``rows`` is the table "transcribed", a row for each coefficient table in a package's source.
    """

    def reached(order: str, wanted: str) -> bool:
        return all(float(p) >= float(q) for p, q in zip(order.split(","), wanted.split(","), strict=True))

    pairs = zip(_text(rows, "order"), _text(rows, column), strict=True)
    return pd.Series([reached(*pair) for pair in pairs], index=rows.index, dtype=bool)


def _names(rows: pd.DataFrame, most: int = 3) -> str:
    return join_list(list((rows["package"] + " " + rows["name"].astype(str)).head(most)), most) if len(rows) else ""


def _stated(rows: pd.DataFrame) -> pd.DataFrame:
    return rows[_text(rows, "stated order") != ""]


def _named(rows: pd.DataFrame) -> pd.DataFrame:
    return rows[(_text(rows, "stated order") == "") & (_text(rows, "named order") != "")]


@of(TABLE)
def stated_orders(rows: pd.DataFrame) -> Verdict:
    """Judge whether the coefficient tables in packages' sources have the orders that the packages state.

    ``rows`` is the table "transcribed", a row for each coefficient table in a package's source.
    """
    stated = _stated(rows)
    good = _reaches(stated, "stated order")
    return Verdict(
        "Every table has the order that its package states",
        Count(int(good.sum()), len(stated)),
        EVERY,
        "tables",
        where=_names(stated[~good], 4),
    )


@of(TABLE)
def named_orders(rows: pd.DataFrame) -> Verdict | None:
    """Judge whether weights named after a method have that method's order, where the package states none.

    ``rows`` is the table "transcribed", a row for each coefficient table in a package's source.
    """
    named = _named(rows)
    if named.empty:
        return None
    good = _reaches(named, "named order")
    return Verdict(
        "Weights named after Suzuki and Yoshida have the order of their methods",
        Count(int(good.sum()), len(named)),
        EVERY,
        "tables",
        where=join_list(list(named[~good]["package"].unique()), 4) if not good.all() else "",
    )


@of(TABLE)
def measured_orders(rows: pd.DataFrame) -> Verdict | None:
    """Judge whether integrations with each package's coefficients have the order that the order conditions show.

    The numbers of each table are composed to steps as in the package.  ``rows`` is the table "transcribed"; None if no
    order is measured.
    """
    seen = rows[rows["measured order"].notna()]
    if seen.empty:
        return None
    shown = _text(seen, "order").str.rpartition(",")[2].astype(float)
    good = (seen["measured order"] - shown).abs() <= GATE
    good |= (seen["low"] - GATE <= shown) & (shown <= seen["high"] + GATE)
    return Verdict(
        "Integrations have the order that the order conditions show",
        Count(int(good.sum()), len(seen)),
        EVERY,
        "tables",
        where=_names(seen[~good]),
        otherwise=FAIL,
    )


@of(TABLE)
def printed_digits(rows: pd.DataFrame) -> Verdict | None:
    """Judge whether the digits printed in packages' sources are those of exact solutions of the order conditions.

    They are compared with this project's table of the same method.  ``rows`` is the table "transcribed"; None if it has
    no such digits.
    """
    compared = rows.dropna(subset=["digits printed"])
    if compared.empty:
        return None
    lost = compared["digits printed"] - compared["digits that hold"]
    worst = compared.loc[lost.idxmax()]
    return Verdict(
        "Every printed digit is that of the method it is named after",
        Count(int((lost <= 0).sum()), len(compared)),
        EVERY,
        "tables",
        where="" if lost.max() <= 0 else f"{worst['package']} {worst['name']}",
    )


@of(TABLE)
def sentence(rows: pd.DataFrame) -> str:
    """Write the page's answer: how many tables were read, from how many packages, and how many lack their order."""
    stated, named = _stated(rows), _named(rows)
    wrong = int((~_reaches(stated, "stated order")).sum())
    weak = int((~_reaches(named, "named order")).sum()) if len(named) else 0
    return (
        f"Of {len(rows)} coefficient tables in the sources of {rows['package'].nunique()} packages, {wrong} lack the order "
        f"that their package states; {weak} more have lower order than the methods they are named after."
    )


@of(TABLE)
def _findings(rows: pd.DataFrame) -> Table:
    """Make the page's table: coefficient tables that lack their order, those with wrong digits, those with a remark."""
    wanted = _text(rows, "stated order").where(_text(rows, "stated order") != "", _text(rows, "named order"))
    reached = _reaches(rows.assign(wanted=wanted), "wanted")
    lost = (rows["digits printed"].astype(float) - rows["digits that hold"].astype(float)).fillna(0.0)
    rank = (~reached) * 1000.0 + lost + (_text(rows, "remark") != "") * 0.5
    shown = rows.loc[rank.sort_values(ascending=False, kind="stable").index].head(ROWS)
    printed, right = shown["digits printed"], shown["digits that hold"]
    frame = pd.DataFrame(
        {
            "package": shown["package"],
            "table": shown["name"],
            "stated": _text(shown, "stated order"),
            "named after": _text(shown, "named order"),
            "by conditions": _text(shown, "order"),
            "measured": shown["measured order"],
            "digits that hold": [
                "" if pd.isna(p) else f"{r:.0f} of {p:.0f}" for p, r in zip(printed, right, strict=True)
            ],
            "where": [
                f"{r.repository} {r.path.rpartition('/')[2]}:{r.line} ({r.commit}, {r.read})"
                for r in shown.itertuples()
            ],
            "used for, remark": [
                "; ".join(x for x in pair if x)
                for pair in zip(_text(shown, "used"), _text(shown, "remark"), strict=True)
            ],
        }
    )
    caption = (
        "Orders: stated, of the method named after, by the order conditions, and measured. First the tables that lack an order, "
        "then those of which the most digits are wrong, then those with a remark; data/transcribed.csv has every table with its path."
    )
    return Table(frame, caption)


@of(TABLE)
def _all(rows: pd.DataFrame) -> pd.DataFrame:
    return rows


PAGE = Page(
    id="tables",
    question="Are the coefficient tables in the sources of packages right?",
    tables=(TABLE,),
    setting=(
        "Tables of splittings, compositions and Runge–Kutta methods, transcribed as numbers from sources of packages with "
        "repository, path, line and commit.",
        "An order is computed from the order conditions: a residual that a change of the last digits explains is rounding. "
        "The order of a splitting for A + εB is that of the terms in ε, ε², ….",
        "It is confirmed by integrations of the Hénon–Heiles problem in 40 digits and more, in the sequence of substeps in "
        "which the package composes the numbers.",
        "Digits are compared with the nearest solution of the order conditions, where the method is here.",
    ),
    verdicts=(stated_orders, named_orders, measured_orders, printed_digits),
    answer=sentence,
    table=_findings,
    whole=_all,
    limits=(
        "The weights of thermostats serve a chain of Nosé and Hoover, not the motion: a lower order there costs accuracy of "
        "the thermostat at a given number of substeps. The packages call them by the names of Suzuki and Yoshida; the exponent "
        "of the published formula, 1/3, stands there as −1/3.",
        "desolver states for methods of Nielsen (2015) an order that holds near a harmonic oscillator only.",
        "OrdinaryDiffEq.jl marks McAte42 as broken in its source and documentation. The manual of Accelerator Toolbox calls "
        "type 2 Verlet's method of order 2.",
        "What a package computes from its numbers elsewhere was not run here; digits beyond those of doubles do not act in "
        "double precision.",
    ),
    command="pytest benchmarks/experiments/catalogue",
)
