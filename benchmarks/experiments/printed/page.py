"""The talk's printed tables beside the measured ones, and the riddle of Scheme IV."""

from __future__ import annotations

import pandas as pd

from phasebench.benchmarks.measure import metrics
from phasebench.benchmarks.page import style
from phasebench.benchmarks.page.markdown import listed, number
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, Verdict, of

from .printed import AGREEMENT, RIDDLE
from .riddle import CLAIM


def _split(printed: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The entries of Scheme IV and those of all others."""
    riddle = printed["scheme"] == RIDDLE[0]
    return printed[riddle], printed[~riddle]


def _digits(entry: float) -> str:
    """An entry as the talk prints it."""
    return f"{float(entry):.2E}"


def _otherwise(printed: pd.DataFrame) -> pd.DataFrame:
    """The entries that do not round to the printed digits."""
    same = [_digits(m) == _digits(p) for m, p in zip(printed["refinement_difference"], printed["printed"], strict=True)]
    return printed[~pd.Series(same, index=printed.index, dtype=bool)]


@of("printed")
def agreement(printed: pd.DataFrame) -> Verdict | None:
    """How many printed entries of the other schemes are reproduced."""
    _, rest = _split(printed)
    if rest.empty:
        return None
    agree, other = int((rest["units"] <= AGREEMENT).sum()), _otherwise(rest)
    lambdas = rest["lambda"].astype(object).fillna("") if "lambda" in rest else pd.Series("", index=rest.index)
    names = [
        f"{r.scheme}{f'({lambdas[r.Index]})' if lambdas[r.Index] else ''} at h = {number(r.h)}, printed {_digits(r.printed)}, "
        f"measured {r.refinement_difference:.5E}, {number(r.units)} units off"
        for r in other.itertuples()
    ]
    counts = (
        f"Of {len(rest)} printed entries of Schemes I–III, AVF and V {len(rest) - len(other)} are what is measured,"
    )
    counts += f" rounded, and {agree} are within {AGREEMENT} of its last digit"
    return Verdict(
        counts + (f"; not the same, rounded: {listed(names, 4)}." if names else "."),
        agree == len(rest),
        f"{counts}.",
    )


@of("printed")
def scheme_iv(printed: pd.DataFrame) -> Verdict | None:
    """Whether Scheme IV's printed column is reproduced, and the orders of both."""
    iv, _ = _split(printed)
    if len(iv) < 3:
        return None
    agree = int((iv["units"] <= AGREEMENT).sum())
    measured, claimed = (
        metrics.power(iv["h"], iv[c].astype(float)).value for c in ("refinement_difference", "printed")
    )
    return Verdict(
        f"Scheme IV: {agree} of {len(iv)} printed entries are reproduced; on the root nearest 1/2 its order is "
        f"{measured:.2f}, the printed column has order {claimed:.2f}; the talk's theorem says 2.",
        agree == len(iv),
        f"Scheme IV's printed column has order {claimed:.2f}, measured {measured:.2f}; "
        f"{agree} of its {len(iv)} entries are reproduced.",
    )


@of("riddle", "riddle_columns")
def explanations(riddle: pd.DataFrame, riddle_columns: pd.DataFrame) -> Verdict:
    """Whether another root, a constant parameter or a slip explains the column."""
    recipes = riddle_columns[riddle_columns["recipe"] != CLAIM]
    entries = len(_entries(riddle_columns))
    best = int(recipes["entries that agree"].max()) if len(recipes) else 0
    names = list(recipes[recipes["entries that agree"] == best]["recipe"]) if best else []
    closest = (riddle["far root closest to 1/2"] - 0.5).abs().min()
    without = int(riddle["without a root"].sum())
    many = len(names) > 1
    found = ("explain it" if many else "explains it") if best == entries else ("come" if many else "comes") + " nearest"
    return Verdict(
        f"Of {riddle['steps'].sum()} steps of Scheme IV {without} have no root near 1/2, and the {riddle['far roots'].sum()} "
        f"other roots are at least {number(closest)} away from it; of {len(recipes)} ways to make the column "
        + (f"{listed(names, 3)} {found}, with {best} of the {entries} entries." if names else "none gives an entry."),
        without == 0 and best < entries,
        f"Of {len(recipes)} ways to make Scheme IV's column the best gives {best} of {entries} entries.",
    )


def _entries(riddle_columns: pd.DataFrame) -> list[str]:
    """The columns of a recipe's entries: the steps."""
    return [c for c in riddle_columns if c not in ("recipe", "entries that agree")]


@of("printed")
def draw(printed: pd.DataFrame, folder) -> list[Picture]:
    """Measured over printed, and Scheme IV's two columns."""
    iv, rest = _split(printed)
    with style.settings():
        figure, ((left, right),) = style.panels(1, 2, 2.9)
        names = list(dict.fromkeys(rest["scheme"]))
        for k, name in enumerate(names):
            part = rest[rest["scheme"] == name]
            look = style.curve(k % len(style.CURVES)) | {"linestyle": "none"}
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
            style.plain_ticks(axes.xaxis)
            axes.grid(color="0.93", linewidth=0.5)
    caption = (
        f"Left: how far a measured entry is from the printed one (dashed: {AGREEMENT} units, which count as the same). "
        "Right: Scheme IV's printed and measured refinement differences."
    )
    return [Picture(style.save(figure, folder, "printed.png"), "printed and measured entries", caption)]


def _shown(printed: pd.DataFrame) -> pd.DataFrame:
    scientific = {"printed": 2, "refinement_difference": 4, "global_error": 2}
    written = {c: [f"{float(x):.{n}e}" for x in printed[c]] for c, n in scientific.items()}
    shown = printed.assign(**{"lambda": printed["lambda"].astype(object).fillna("")}, **written)
    names = {"refinement_difference": "measured", "units": "units off", "global_error": "global error"}
    return shown[["scheme", "lambda", "h", *scientific, "order", "units"]].rename(columns=names)


@of("riddle_columns")
def table(riddle_columns: pd.DataFrame) -> Table:
    """The riddle: the ways to make Scheme IV's column, the nearest first."""
    heads = _entries(riddle_columns)
    written = riddle_columns.assign(**{c: [f"{float(x):.3e}" for x in riddle_columns[c]] for c in heads})
    shown = written.sort_values("entries that agree", ascending=False, kind="stable").rename(
        columns={c: f"h = {c}" for c in heads}
    )
    caption = (
        "Scheme IV's printed column, and the ways that were tried to make it; every entry of the other columns is in the "
        "CSV, and in a table of the HTML page."
    )
    return Table(shown.head(ROWS), caption)


PAGE = Page(
    id="printed",
    question="Are the talk's printed tables reproduced?",
    tables=("printed", "riddle", "riddle_columns", "riddle_roots"),
    setting=(
        "H = (p₁² + p₂²)/2 + (q₁² + q₂²)/2 + q₁² q₂ − q₂³/3 (Hénon–Heiles), the talk's chaotic orbit, to t = 1.",
        "Printed and measured: max |y_h − y_2h| over q and p at t = 1, the difference of successive refinements.",
        "`global error` is the error against a certified Taylor solution; the tables do not print it.",
        "Scheme IV takes in each step the parameter λ near 1/2 that keeps H; the scan looks for every other root.",
    ),
    verdicts=(agreement, scheme_iv, explanations),
    figures=draw,
    table=table,
    whole=of("printed")(_shown),
    limits=(
        f"An entry counts as reproduced within {AGREEMENT} of its last printed digit: 0.5 is rounding, the rest slack.",
        "The first printed row pairs h = 0.02 with 0.01: a convention that the agreement itself confirms.",
        "The scan covers λ in the range given in data/riddle.csv, on the principal branch of the stage equations.",
        "A way to make Scheme IV's column that has a free number (λ = −51/50) or a slip (one step beyond t = 1) was "
        "looked for until entries agreed: by numerology, and no explanation.",
    ),
    command="pytest benchmarks/experiments/printed",
)
