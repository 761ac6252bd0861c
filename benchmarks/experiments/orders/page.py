"""The report page on the measured orders of every method on every problem, beside the declared ones."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.measure.integrator import OURS
from phasebench.benchmarks.measure.multiprecision import DIGITS
from phasebench.benchmarks.measure.orders import orders
from phasebench.benchmarks.page.markdown import join_list, number
from phasebench.benchmarks.page.page import ROWS, Data, Page, Picture, Table, of, once
from phasebench.benchmarks.page.verdict import EVERY, FAIL, NONE, Count, Verdict

if TYPE_CHECKING:
    from pathlib import Path

#: Largest difference of a measured order from the declared one that counts as agreement.
GATE = 0.1
#: Smallest number of step sizes to which an order is fitted.
POINTS = 3
#: An order at least this far below the declared one, with an interval of at most ± `GATE`, contradicts it.
BELOW = 0.5


@once
def in_doubles(rows: pd.DataFrame) -> pd.DataFrame:
    """Compute the orders of this project's methods in double precision from the table of runs: a row for each pair.

    A pair is a method and a problem.  The columns ``deviation`` and ``half`` are the difference from the declared order
    and half the width of the order's interval.
    """
    records = rows.astype(object).where(rows.notna(), None).to_dict("records")
    found = pd.DataFrame(orders(records))
    if found.empty:
        return found
    found = found[found["kind"] == OURS].copy()
    return found.assign(
        deviation=(found["order"] - found["declared"]).astype(float), half=(found["high"] - found["low"]) / 2
    )


def _off(multiprecision: pd.DataFrame) -> pd.DataFrame:
    """Select the pairs (method, problem) whose order in multiprecision is `GATE` or more off the declared one."""
    return multiprecision[~((multiprecision["order"] - multiprecision["declared"]).abs() < GATE)]


@of("multiprecision")
def exact(multiprecision: pd.DataFrame) -> Verdict:
    """Judge whether every method has its declared order in multiprecision on every problem.

    ``multiprecision`` is the table of these orders, a row for each pair.
    """
    off = _off(multiprecision)
    names = [f"{r.method} on {r.problem}: {number(r.order) or 'no window'}" for r in off.itertuples()]
    return Verdict(
        "In multiprecision every method has its declared order on every problem",
        Count(len(multiprecision) - len(off), len(multiprecision)),
        EVERY,
        "pairs",
        where=join_list(names, 3) if names else "",
        otherwise=FAIL,
    )


@of("rows")
def declared_orders(rows: pd.DataFrame) -> Verdict | None:
    """Judge whether no order in double precision is far below the declared one.

    ``rows`` is the table of runs; None if no order can be computed from it.
    """
    found = in_doubles(rows)
    if found.empty:
        return None
    seen = found[found["points"] >= POINTS]
    low = seen[(seen["deviation"] <= -BELOW) & (seen["half"] <= GATE)]
    names = [f"{r.method} on {r.problem}: {r.order:.2f} for {r.declared:g}" for r in low.itertuples()]
    return Verdict(
        "In double precision no order is far below the declared one",
        Count(len(low), len(seen)),
        NONE,
        "pairs",
        where=join_list(names, 3) if names else "",
    )


def answer(data: Data) -> str | None:
    """Write the page's answer, a sentence: how many pairs of a method and a problem have the declared order.

    None without orders in multiprecision.
    """
    table = data("multiprecision")
    if table is None or table.empty:
        return None
    text = f"{len(table) - len(_off(table))} of {len(table)} pairs of a method and a problem have the declared order"
    text += f" within {GATE} without round-off"
    low = declared_orders(data)
    if low is None:
        return f"{text}."
    return f"{text}; in double precision {low.measured.n} of {low.measured.of} is far below it."


@of("multiprecision")
def draw(multiprecision: pd.DataFrame, folder: Path) -> list[Picture]:
    """Draw the deviation of every order in multiprecision from the declared one; a marker for each problem."""
    problems = list(dict.fromkeys(multiprecision["problem"]))
    declared = sorted(multiprecision["declared"].unique())
    with style.settings():
        figure, ((axes,),) = style.panels(1, 1, 3.2)
        axes.axhspan(-GATE, GATE, color="0.92")
        for k, problem in enumerate(problems):
            part = multiprecision[multiprecision["problem"] == problem]
            x = [declared.index(d) + 0.8 * (k - (len(problems) - 1) / 2) / len(problems) for d in part["declared"]]
            look = style.curve(k) | {"linestyle": "none", "markersize": 2.8, "alpha": 0.7}
            axes.plot(x, (part["order"] - part["declared"]).clip(-0.3, 0.3), label=problem, **look)
        axes.set_xticks(range(len(declared)), [f"{d:g}" for d in declared])
        axes.set(xlabel="declared order", ylabel="measured − declared")
        axes.axhline(0, color=style.GREY, linewidth=0.7)
        style.legend_above(figure, axes, 4)
    caption = (
        f"Measured minus declared order of {len(multiprecision)} pairs of a method and a problem in multiprecision; grey: "
        f"±{GATE}, within which an order is as declared; beyond ±0.3 it is drawn at the edge."
    )
    return [Picture(style.save(figure, folder, "orders.png"), "deviation of the measured orders", caption)]


def _exceptions(found: pd.DataFrame) -> pd.DataFrame:
    """Select the pairs whose order in doubles differs from the declared one and has a narrow interval.

    ``found`` is the result of `in_doubles`; the largest difference comes first.
    """
    off = found[(found["points"] >= POINTS) & (found["deviation"].abs() >= GATE) & (found["half"] <= GATE)]
    return off.reindex(off["deviation"].abs().sort_values(ascending=False).index)


def _format_rows(found: pd.DataFrame) -> pd.DataFrame:
    interval = [
        f"{r.order:.2f} ± {r.half:.2f}" if r.points >= POINTS and np.isfinite(r.half) else "no window"
        for r in found.itertuples()
    ]
    return found.assign(measured=interval)[["method", "problem", "declared", "measured", "points", "h_first", "h_last"]]


@of("rows")
def table(rows: pd.DataFrame) -> Table | None:
    """Make the page's table: the pairs of a method and a problem whose order in doubles is not the declared one.

    ``rows`` is the table of runs; None if no order can be computed from it.
    """
    found = in_doubles(rows)
    if found.empty:
        return None
    off = _exceptions(found)
    shown, seen = off.head(ROWS), found[found["points"] >= POINTS]
    near, wide = seen["deviation"].abs() < GATE, seen["half"] > GATE
    return Table(
        _format_rows(shown).rename(columns={"h_first": "largest h", "h_last": "smallest h"}),
        f"In double precision {len(seen)} of {len(found)} pairs have {POINTS} steps above the noise: {int(near.sum())} are "
        f"within {GATE} of the declared order, {int((~near & wide).sum())} converge irregularly. Shown are of the {len(off)} "
        f"others the {len(shown)} farthest, `points`: their steps; a higher order is superconvergence, or steps that are still too large.",
    )


@of("rows")
def _full_table(rows: pd.DataFrame) -> pd.DataFrame | None:
    found = in_doubles(rows)
    return None if found.empty else _format_rows(found)


PAGE = Page(
    id="orders",
    question="Does every method have the order that it declares?",
    tables=("rows", "multiprecision"),
    setting=(
        "e(h) = max |y_h(T) − y(T)| over q and p against a certified reference; order = d log e / d log h.",
        "Pendulum, Kepler, perturbed Kepler, Hénon–Heiles, Lotka–Volterra, oscillator, to T of 1 to 2; in multiprecision also "
        "systems that are not separable.",
        f"In multiprecision ({DIGITS} digits and more, by MPFR through gmpy2) there is no round-off: too high an order is as wrong as "
        "too low a one.",
        f"In double precision the slope, with its 95 % interval, is fitted to at least {POINTS} steps whose error is above the noise.",
    ),
    verdicts=(exact, declared_orders),
    answer=answer,
    figures=draw,
    table=table,
    whole=_full_table,
    limits=(
        f"An order is as declared within {GATE}. In double precision an interval wider than ±{GATE} is no measurement, and an order "
        f"is far below if it is at least {BELOW} too low.",
        "Errors below 100 times the reference's uncertainty or round-off are left out: methods of high order have few steps left.",
        "Schemes IV and V converge irregularly where the orbit passes a point at which, to leading order, λ does not change the "
        "energy: there λ leaves 1/2.",
    ),
    command="pytest benchmarks/experiments/orders benchmarks/experiments/trade",
)
