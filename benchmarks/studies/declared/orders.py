"""The order of every method on every test system, in multiprecision and in double precision."""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.judge.evidence import GATE
from phasebench.benchmarks.measure import declared
from phasebench.benchmarks.measure.integrator import OURS
from phasebench.benchmarks.measure.multiprecision import DIGITS, methods
from phasebench.benchmarks.measure.orders import orders
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import ROWS, Data, Table, of, once
from phasebench.benchmarks.page.shared import picture
from phasebench.benchmarks.page.study import Claim, Runs, Study
from phasebench.benchmarks.page.verdict import EVERY, NONE
from phasebench.benchmarks.problems import scenes
from phasebench.benchmarks.store.cells import UNCOMPILED

TABLE, RUNS = "multiprecision", "rows"
#: Smallest number of step sizes to which an order is fitted.
POINTS = 3
#: An order at least this far below the declared one, with an interval of at most ± `GATE`, contradicts it.
BELOW = 0.5


def as_declared(frame: pd.DataFrame) -> pd.Series:
    """True where an order in multiprecision is the declared one, by "method on problem: order"."""
    names = [f"{r.method} on {r.problem}: {number(r.order) or 'no window'}" for r in frame.itertuples()]
    return ((frame["order"] - frame["declared"]).abs() < GATE).set_axis(names)


@of(RUNS)
@once
def in_doubles(rows: pd.DataFrame) -> pd.DataFrame | None:
    """The orders of this project's methods on each problem in double precision; None if there are none.

    ``deviation`` is the difference from the declared order, ``half`` half the width of the order's interval.
    """
    part = rows[rows["purpose"] == scenes.ORDER].astype(object)
    found = pd.DataFrame(orders(part.where(part.notna(), None).to_dict("records")))
    if found.empty or (found := found[found["kind"] == OURS]).empty:
        return None
    deviation = (found["order"] - found["declared"]).astype(float)
    return found.assign(deviation=deviation, half=(found["high"] - found["low"]) / 2)


def also_in_doubles(data: Data) -> str:
    """The end of the answer: how many orders in double precision contradict; "" if none were measured."""
    said = CLAIMS["doubles"].said(data)
    return "" if said is None else f"; in double precision {said.n} of {said.of} is far below it"


@picture(TABLE, "orders", "deviation of the measured orders")
def _draw(frame: pd.DataFrame) -> tuple[style.Figure, str]:
    problems, known = list(dict.fromkeys(frame["problem"])), sorted(frame["declared"].unique())
    figure, ((axes,),) = style.panels(1, 1, 3.2)
    axes.axhspan(-GATE, GATE, color="0.92")
    for k, problem in enumerate(problems):
        part = frame[frame["problem"] == problem]
        x = [known.index(d) + 0.8 * (k - (len(problems) - 1) / 2) / len(problems) for d in part["declared"]]
        look = style.curve(k) | {"linestyle": "none", "markersize": 2.8, "alpha": 0.7}
        axes.plot(x, (part["order"] - part["declared"]).clip(-0.3, 0.3), label=problem, **look)
    axes.set_xticks(range(len(known)), [f"{d:g}" for d in known])
    axes.set(xlabel="declared order", ylabel="measured − declared")
    axes.axhline(0, color=style.GREY, linewidth=0.7)
    style.legend_above(figure, axes, 4)
    return figure, (
        f"Measured minus declared order of {len(frame)} pairs of a method and a problem in multiprecision; grey: "
        f"±{GATE}, within which an order is as declared; beyond ±0.3 it is drawn at the edge."
    )


@of(in_doubles)
def _whole(found: pd.DataFrame) -> pd.DataFrame:
    known = (found["points"] >= POINTS) & np.isfinite(found["half"].astype(float))
    told = [f"{r.order:.2f} ± {r.half:.2f}" for r in found.itertuples()]
    found = found.assign(measured=np.where(known, told, "no window"))
    return found[["method", "problem", "declared", "measured", "points", "h_first", "h_last"]]


@of(in_doubles, _whole)
def _table(found: pd.DataFrame, whole: pd.DataFrame) -> Table:
    seen = found[found["points"] >= POINTS]
    near, wide = seen["deviation"].abs() < GATE, seen["half"] > GATE
    off = seen[~near & ~wide].sort_values("deviation", key=abs, ascending=False)
    shown = whole.loc[off.index[:ROWS]].rename(columns={"h_first": "largest h", "h_last": "smallest h"})
    caption = (
        f"In double precision {len(seen)} of {len(found)} pairs have {POINTS} steps above the noise: "
        f"{int(near.sum())} are within {GATE} of the declared order, {int((~near & wide).sum())} converge irregularly. "
        f"Shown are of the {len(off)} others the {len(shown)} farthest, `points`: their steps; a higher order is "
        "superconvergence, or steps that are still too large."
    )
    return Table(shown, caption)


CLAIMS = {
    "exact": Claim(
        "In multiprecision every method has its declared order on every problem",
        TABLE, as_declared, EVERY, unit="pairs", names=3, fault=True,
    ),
    "doubles": Claim(
        "In double precision no order is far below the declared one",
        in_doubles, f"deviation <= -{BELOW} and half <= {GATE}", NONE, rows=f"points >= {POINTS}", unit="pairs",
        where="{method} on {problem}: {order:.2f} for {declared:g}", names=3,
    ),
}  # fmt: skip
STUDY = Study(
    id="orders",
    place=120,
    question="Does every method have the order that it declares?",
    answer="{exact.n} of {exact.of} pairs of a method and a problem have the declared order within "
    f"{GATE} without round-off{{doubles}}.",
    setting=(
        "e(h) = max |y_h(T) − y(T)| over q and p against a certified reference; order = d log e / d log h.",
        "Pendulum, Kepler, perturbed Kepler, Hénon–Heiles, Lotka–Volterra, oscillator, to T of 1 to 2; in "
        "multiprecision also systems that are not separable.",
        f"In multiprecision ({DIGITS} digits and more, by MPFR through gmpy2) there is no round-off: too high an order "
        "is as wrong as too low a one.",
        f"In double precision the slope, with its 95 % interval, is fitted to at least {POINTS} steps whose error is "
        "above the noise.",
    ),
    runs=(
        Runs(
            TABLE, declared.order, declared.ORDERS,
            needs=lambda method, problem: [methods()[method]], where=UNCOMPILED,
        ),
    ),
    claims=CLAIMS,
    numbers={"doubles": also_in_doubles},
    figure=_draw,
    shown=_table,
    whole=_whole,
    limits=(
        f"An order is as declared within {GATE}. In double precision an interval wider than ±{GATE} is no "
        f"measurement, and an order is far below if it is at least {BELOW} too low.",
        "Errors below 100 times the reference's uncertainty or round-off are left out: methods of high order have few "
        "steps left.",
        "Schemes IV and V converge irregularly where the orbit passes a point at which, to leading order, λ does not "
        "change the energy: there λ leaves 1/2.",
    ),
    reads=(RUNS, TABLE),
    command="pytest benchmarks -k 'orders or trade'",
)  # fmt: skip
