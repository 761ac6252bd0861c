"""Measured orders: every method on every problem, against the order it declares."""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks.experiments.trade import sweep
from phasebench.benchmarks.measure.integrator import OURS
from phasebench.benchmarks.measure.multiprecision import DIGITS
from phasebench.benchmarks.page import style
from phasebench.benchmarks.page.markdown import listed, number
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, Verdict, of, once

#: A measured order within this of the declared one is that order.
GATE = 0.1
#: A window has at least so many steps.
POINTS = 3
#: An order at least this far below the declared one, with a sharp interval, contradicts it.
BELOW = 0.5


@once
def in_doubles(rows: pd.DataFrame) -> pd.DataFrame:
    """The orders of this project's methods on the order scenes, with their deviation and half-width."""
    records = rows.astype(object).where(rows.notna(), None).to_dict("records")
    found = pd.DataFrame(sweep.orders(records))
    if found.empty:
        return found
    found = found[found["kind"] == OURS].copy()
    return found.assign(
        deviation=(found["order"] - found["declared"]).astype(float), half=(found["high"] - found["low"]) / 2
    )


@of("multiprecision")
def exact(multiprecision: pd.DataFrame) -> Verdict:
    """Whether the orders hold without round-off."""
    wrong = multiprecision[~((multiprecision["order"] - multiprecision["declared"]).abs() < GATE)]
    good = len(multiprecision) - len(wrong)
    names = [f"{r.method} on {r.problem} ({number(r.order) or 'no window'})" for r in wrong.itertuples()]
    counts = f"{good} of {len(multiprecision)} orders are as declared"
    return Verdict(
        f"Without round-off ({int(multiprecision['digits'].min())} digits or more) {counts}, two-sided within {GATE}"
        + (f"; not so {listed(names, 4)}." if names else "."),
        wrong.empty,
        f"{counts} (within {GATE}, without round-off).",
    )


@of("rows")
def confirmed(rows: pd.DataFrame) -> Verdict | None:
    """Whether doubles confirm them."""
    found = in_doubles(rows)
    if found.empty:
        return None
    seen = found[found["points"] >= POINTS]
    good = int((seen["deviation"].abs() < GATE).sum())
    wrong = seen[(seen["deviation"] <= -BELOW) & (seen["half"] <= GATE)]
    wide = int(((seen["deviation"].abs() >= GATE) & (seen["half"] > GATE)).sum())
    names = [f"{r.method} on {r.problem} ({r.order:.2f} for {r.declared:g})" for r in wrong.itertuples()]
    return Verdict(
        f"In doubles, of {len(found)} pairs {len(seen)} have a window of {POINTS} steps above the noise: {good} are "
        f"within {GATE} of the declared order, {wide} converge irregularly (interval wider than that), and "
        + (
            f"{len(wrong)} {'is' if len(wrong) == 1 else 'are'} an order too low: {listed(names, 3)}."
            if names
            else "none is an order too low."
        ),
        wrong.empty,
        f"In doubles {len(wrong)} of {len(seen)} pairs with a window of steps {'is' if len(wrong) == 1 else 'are'} an order too low.",
    )


@of("multiprecision")
def draw(multiprecision: pd.DataFrame, folder) -> list[Picture]:
    """The deviation of every measured order."""
    problems = list(dict.fromkeys(multiprecision["problem"]))
    declared = sorted(multiprecision["declared"].unique())
    with style.settings():
        figure, ((axes,),) = style.panels(1, 1, 3.2)
        axes.axhspan(-GATE, GATE, color="0.92")
        for k, problem in enumerate(problems):
            part = multiprecision[multiprecision["problem"] == problem]
            x = [declared.index(d) + 0.8 * (k - (len(problems) - 1) / 2) / len(problems) for d in part["declared"]]
            look = style.curve(k % len(style.CURVES)) | {"linestyle": "none", "markersize": 2.8, "alpha": 0.7}
            axes.plot(x, (part["order"] - part["declared"]).clip(-0.3, 0.3), label=problem, **look)
        axes.set_xticks(range(len(declared)), [f"{d:g}" for d in declared])
        axes.set(xlabel="declared order", ylabel="measured − declared")
        axes.axhline(0, color=style.GREY, linewidth=0.7)
        style.legend_above(figure, axes, 4)
    caption = (
        f"Measured less declared order of {len(multiprecision)} pairs of a method and a problem in multiprecision; grey: "
        f"the gate of ±{GATE}; what is beyond ±0.3 stands at the edge."
    )
    return [Picture(style.save(figure, folder, "orders.png"), "deviation of the measured orders", caption)]


def _exceptions(found: pd.DataFrame) -> pd.DataFrame:
    """The pairs in doubles that are off with a sharp interval, the farthest first."""
    off = found[(found["points"] >= POINTS) & (found["deviation"].abs() >= GATE) & (found["half"] <= GATE)]
    return off.reindex(off["deviation"].abs().sort_values(ascending=False).index)


def _shown(found: pd.DataFrame) -> pd.DataFrame:
    interval = [
        f"{r.order:.2f} ± {r.half:.2f}" if r.points >= POINTS and np.isfinite(r.half) else "no window"
        for r in found.itertuples()
    ]
    return found.assign(measured=interval)[["method", "problem", "declared", "measured", "points", "h_first", "h_last"]]


@of("rows")
def table(rows: pd.DataFrame) -> Table | None:
    """The exceptions in doubles."""
    found = in_doubles(rows)
    if found.empty:
        return None
    off = _exceptions(found)
    shown = off.head(ROWS)
    return Table(
        _shown(shown).rename(columns={"h_first": "largest h", "h_last": "smallest h"}),
        f"In doubles: the {len(shown)} farthest of the {len(off)} pairs that are more than {GATE} off with an interval "
        "narrower than that. A positive distance is superconvergence, or a ladder that is not asymptotic yet.",
    )


@of("rows")
def _whole(rows: pd.DataFrame) -> pd.DataFrame | None:
    found = in_doubles(rows)
    return None if found.empty else _shown(found)


PAGE = Page(
    id="orders",
    question="Does every method have the order that it declares?",
    tables=("rows", "multiprecision"),
    setting=(
        "e(h) = max |y_h(T) − y(T)| over q and p against a certified reference; order = d log e / d log h.",
        "In doubles: pendulum, Kepler, perturbed Kepler, Hénon–Heiles, Lotka–Volterra, oscillator, T of 1 to 2; in "
        "multiprecision also systems that are not separable.",
        f"In multiprecision ({DIGITS} digits and more, MPFR's numbers through gmpy2) there is no round-off: the gate is two-sided.",
        f"In doubles the window is found: at least {POINTS} steps above the noise, with a 95 % interval of the slope.",
    ),
    verdicts=(exact, confirmed),
    figures=draw,
    table=table,
    whole=_whole,
    limits=(
        f"GATE = {GATE} for both; in doubles an interval wider than that is no measurement, and an order is too low from "
        f"BELOW = {BELOW} below the declared one on.",
        "Errors below 100 times the reference's uncertainty or round-off are left out: high orders lose their window.",
        "Schemes IV and V converge irregularly where the orbit passes a zero of a(y): there the root leaves 1/2.",
    ),
    command="pytest benchmarks/experiments/orders benchmarks/experiments/trade",
)
