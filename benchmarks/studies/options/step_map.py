"""Options that change the step map: a scheme's parameter lambda, the order, the energy-preserving method."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.ladder.costs import at
from phasebench.benchmarks.measure.timing import NOWHERE, TIED, cheaper
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import ROWS, Data, Picture, Table, of, once
from phasebench.benchmarks.page.study import Claim, Runs, Study
from phasebench.benchmarks.page.verdict import EVERY, at_most
from phasebench.benchmarks.store.cells import ALONE
from phasebench.integrators.driver import OK

from . import ladders, lambdas
from .ladders import COMPOSITION, ENERGY, GENERATING, ORDERS, SETTINGS, TABLE
from .lambdas import COSTS, METHODS, SCENES
from .lambdas import ERRORS as OFF

if TYPE_CHECKING:
    from matplotlib.axes import Axes

HALF = 0.5
#: Errors at which settings are compared; the factor up to which two numbers count as equal.
ERRORS, SAME = (1e-1, 1e-2, 1e-4, 1e-6, 1e-8, 1e-10), 1.1
#: Relative energy error up to which the energy counts as kept; smaller errors are drawn at this value.
KEPT, SMALLEST = 1e-12, 1e-17


def best(errors: pd.DataFrame) -> pd.DataFrame:
    """The lambda of least trajectory error at the larger step, by scheme and orbit; ``gain``: the error at 1/2 over it.

    Errors that are not above the uncertainty of the truth do not count.
    """
    rows = errors[(errors["finer"] == 1) & (errors["trajectory"] > errors["uncertainty"])]
    rows = rows[np.isfinite(rows["trajectory"])]
    half = rows[rows["lam"] == HALF].set_index(["scene", "method"])["trajectory"]
    least = rows.loc[rows.groupby(["scene", "method"], sort=False)["trajectory"].idxmin()]
    least = least.join(half.rename("at half"), on=["scene", "method"], how="inner")
    return least.assign(gain=least["at half"] / least["trajectory"])


def half_is_best(errors: pd.DataFrame) -> pd.Series:
    """True where lambda = 1/2 has the least error, or nearly."""
    return best(errors)["gain"] <= SAME


def where_not(errors: pd.DataFrame) -> str:
    """The case in which another lambda gains most."""
    if half_is_best(errors).all():
        return ""
    found = best(errors)
    worst = found.loc[found["gain"].idxmax()]
    gain = f"{number(worst['gain'], 2)} times the error at λ = {number(float(worst['lam']), 2)}"
    return f"{worst['method']} on {worst['scene']}: {gain}"


def half_is_longest(costs: pd.DataFrame) -> pd.Series:
    """True where lambda = 1/2 allows the longest step, by "scheme on orbit"."""
    longest = costs.groupby(["scene", "method"], sort=False)["largest h"].max()
    half = costs[costs["lam"] == HALF].set_index(["scene", "method"])["largest h"]
    found = half >= longest.reindex(half.index)
    return found.set_axis([f"{method} on {scene}" for scene, method in found.index])


def usable(rungs: pd.DataFrame, option: str) -> pd.DataFrame:
    """The completed runs of an option; of `ENERGY` those that kept it, with a solution in every step."""
    rungs = rungs[(rungs["knob"] == option) & (rungs["status"] == OK)]
    return rungs[(rungs["energy error"] <= KEPT) & (rungs["fallbacks"] == 0)] if option == ENERGY else rungs


@once
def cheapest(rungs: pd.DataFrame, option: str) -> pd.DataFrame:
    """The fastest setting of an option at each error, by orbit; ``ties``: settings that are not certainly slower."""
    rows = []
    for scene, part in usable(rungs, option).groupby("scene", sort=False):
        for error in ERRORS:
            costs = {name: at(own, error) for name, own in part.groupby("setting", sort=False)}
            costs = {name: cost for name, cost in costs.items() if cost is not NOWHERE}
            if not costs:
                continue
            first = min(costs, key=lambda name: costs[name].value)
            ties = [name for name in costs if name != first and cheaper(costs[first], costs[name]) == TIED]
            row = {"option": option, "scene": scene, "error": error, "setting": first, "ties": ", ".join(ties)}
            row |= {"us": costs[first].value, "settings": len(costs)}
            rows.append(row | {"dearest / cheapest": max(c.value for c in costs.values()) / costs[first].value})
    columns = ["option", "scene", "error", "setting", "ties", "us", "settings", "dearest / cheapest"]
    return pd.DataFrame(rows, columns=columns)


def each_scene(option: str, good: Callable[[pd.Series], bool]) -> Callable[[pd.DataFrame], pd.Series]:
    """True where the fastest settings of an option, from the largest error to the smallest, are good, by orbit."""

    def judged(rungs: pd.DataFrame) -> pd.Series:
        found = cheapest(rungs, option)
        if found.empty:
            return pd.Series(dtype=bool)
        return found.groupby("scene", sort=False)["setting"].agg(good).astype(bool)

    return judged


def place(orders: pd.Series) -> pd.Series:
    """The places of compositions by their order; NaN of an unknown one."""
    return orders.map({name: k for k, name in enumerate(SETTINGS[COMPOSITION])})


def r(setting: str) -> int:
    """The order r of a generating function; 0 of an unknown one."""
    return ORDERS.get(setting, (0,))[0]


def power(error: float) -> str:
    """The nearest power of ten, such as 1e-6."""
    return f"1e{round(np.log10(error))}"


def times(x: float) -> str:
    """A factor as text, such as "1.4 times"."""
    return f"{number(float(x), 2)} times"


def fastest(option: str) -> Callable[[Data], str | None]:
    """The names of the fastest settings at the smallest error that is reached."""

    def named(rungs: pd.DataFrame) -> str | None:
        found = cheapest(rungs, option)
        return None if found.empty else " or ".join(found[found["error"] == found["error"].min()]["setting"].unique())

    return of(TABLE)(named)


# -- what is shown -----------------------------------------------------------------------------------------------------


@of(OFF, COSTS, TABLE)
def table(errors: pd.DataFrame, costs: pd.DataFrame, rungs: pd.DataFrame) -> Table:
    """The best setting of each option on each orbit, its gain and its cost."""
    rows = []
    for _, r in best(errors).iterrows():
        part = costs[(costs["scene"] == r["scene"]) & (costs["method"] == r["method"])]
        near = part.loc[(part["lam"] - r["lam"]).abs().idxmin(), "gradients per step"]
        gives = f"error {number(r['trajectory'], 2)}, at λ = 1/2 {times(r['gain'])} that"
        dearer = f"{times(near / part.loc[part['lam'] == HALF, 'gradients per step'].iloc[0])} the gradients"
        rows.append((f"λ of {r['method']}", r["scene"], number(r["lam"], 2), gives, dearer))
    for option in SETTINGS:
        for last in cheapest(rungs, option).groupby("scene", sort=False).tail(1).to_dict("records"):
            gives = f"error {power(last['error'])} in {number(last['us'])} µs"
            dearest = f"the slowest takes {times(last['dearest / cheapest'])} as long"
            dearest = dearest if last["settings"] > 1 else "no other gets there"
            rows.append((option, last["scene"], last["setting"], gives, dearest))
    caption = (
        "The best setting of each option on each scene. λ: the one of the smallest trajectory error, and its gradients "
        "a step over those at 1/2. The others: the fastest at the smallest error reached of "
        f"{power(ERRORS[0])} to {power(ERRORS[-1])}, and how long the slowest takes there."
    )
    return Table(pd.DataFrame(rows[:ROWS], columns=["option", "scene", "best setting", "gives", "costs"]), caption)


@of(TABLE)
def whole(rungs: pd.DataFrame) -> pd.DataFrame:
    """The fastest setting of each option at every error."""
    return pd.concat([cheapest(rungs, option) for option in SETTINGS]).drop(columns="settings")


@style.styled
def draw_lambda(errors: pd.DataFrame, costs: pd.DataFrame, folder: Path) -> Picture:
    """Error, gradients a step and largest step over lambda: a column of panels for each scheme."""
    errors = errors[errors["finer"] == 1]
    figure, panels = style.panels(3, len(METHODS), 6.4, sharex=True, sharey="row")

    def relative(axes: Axes, part: pd.DataFrame, column: str, **look: Any) -> None:
        half = part.loc[part["lam"] == HALF, column]
        if len(half) and 0 < half.iloc[0] < np.inf:
            axes.plot(part["lam"], (part[column] / half.iloc[0]).replace([0, np.inf], np.nan), **look)

    for column, method in enumerate(METHODS):
        for k, scene in enumerate(SCENES):
            part, cost = (
                t[(t["method"] == method) & (t["scene"] == scene)].sort_values("lam") for t in (errors, costs)
            )
            look = style.curve(k, len(cost), 6)
            relative(panels[0, column], part, "trajectory", label=scene, **style.curve(k, len(part), 6))
            panels[1, column].plot(cost["lam"], cost["gradients per step"], **look)
            relative(panels[2, column], cost, "largest h", **look)
        panels[0, column].set(title=method, yscale="log")
        panels[1, column].set(yscale="log")
        panels[2, column].set(yscale="log", xlabel="λ")
        for axes in panels[:, column]:
            axes.axvline(HALF, color=style.GREY, linewidth=0.8, linestyle=":")
    labels = ("error / that at 1/2", "gradients a step", "largest h / that at 1/2")
    for axes, label in zip(panels[:, 0], labels, strict=True):
        axes.set_ylabel(label)
    style.legend_above(figure, panels[0, 0], 3)
    caption = (
        "From above: the largest error of the trajectory at fixed h, the gradients of a step, the longest step; "
        "errors and steps over those at λ = 1/2 (dotted). Where an error is below 1, that λ is better than 1/2."
    )
    return Picture(style.save(figure, folder, "options-lambda.png"), "error, cost and longest step over λ", caption)


def plot(axes: Axes, rows: pd.DataFrame, by: list[str], x: str, y: str, label: str) -> None:
    """Curves of a column over another, one for each group; ``label`` is a format string of a row."""
    for look, (_, part) in zip(style.looks(), rows.groupby(by, sort=False), strict=False):
        part = part.sort_values(x)
        axes.plot(part[x], part[y].clip(lower=SMALLEST), label=label.format_map(part.iloc[0]), **look)


def draw_ladders(parts: list[pd.DataFrame], legends: bool, *about: Any) -> Picture:
    """Errors over times, panels side by side with a legend each or one for all."""
    figure, (panels,) = style.panels(1, len(parts), 3.9, sharey=True)
    for axes, part in zip(panels, parts, strict=True):
        arrived = part[(part["status"] == OK) & (part["error"] > 0)]
        plot(axes, arrived, ["setting"], "us", "error", "{setting}")
        axes.set(xlabel="µs to the end", title=part["scene"].iloc[0], xscale="log", yscale="log", ylim=(1e-14, 10))
        if legends:
            axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.12), ncols=2, handlelength=3.0)
    panels[0].set_ylabel("error at the end")
    if not legends:
        style.legend_above(figure, panels[0], 3)
    folder, file, title, caption = about
    return Picture(style.save(figure, folder, file), title, caption)


@of(OFF, COSTS, TABLE)
@style.styled
def draw(errors: pd.DataFrame, costs: pd.DataFrame, rungs: pd.DataFrame, folder: Path) -> list[Picture]:
    """The figures of lambda, of orders, and of methods that keep the energy."""
    options = [rungs[rungs["knob"] == option] for option in (COMPOSITION, GENERATING)]
    first = [part[part["scene"] == part["scene"].iloc[0]] for part in options if len(part)]
    keeping = usable(rungs, ENERGY)
    keepers = [part for _, part in keeping.groupby("scene", sort=False)] if len(keeping) else []
    orders = (
        "Error against time: left compositions of Störmer–Verlet of order 2 to 10, right generating functions to the "
        "power r of h; the CSV has other scenes."
    )
    kept = f"Error of the end against time, of runs whose relative energy error is at most {KEPT:g}."
    ladders = (
        (first, True, folder, "options-orders.png", "orders", orders),
        (keepers, False, folder, "options-energy.png", "methods that keep the energy", kept),
    )
    return [draw_lambda(errors, costs, folder), *(draw_ladders(*ladder) for ladder in ladders if ladder[0])]


STUDY = Study(
    id="options",
    place=60,
    question="Which λ, which order and which energy-preserving method are best?",
    answer="Schemes I and III err least at λ = 1/2 in {best.n} of {best.of} cases; compositions of order {order} reach "
    "an error of {error} fastest; among energy-preserving methods {keeper} does.",
    setting=(
        "Scheme I takes the step (q, p) + h J⁻¹∇H(q + (1 − λ)Δq, p + λΔp); Scheme III composes it with its adjoint; a "
        "composition of III has order 4.",
        f"λ runs from {lambdas.LOW} to {lambdas.HIGH} at fixed h, on {', '.join(SCENES)}; the error is the largest of "
        "the trajectory against a certified solution.",
        "Compositions of Störmer–Verlet have order 2 to 10; generating functions are expanded to the power r of h, at "
        "λ = 1/3 and at 1/2, where an odd r gives order r + 1.",
        "Energy-preserving: Schemes IV and V with compositions, projection, relaxation. Orders and energy-preserving "
        "methods run a ladder of steps; the error is that of the end, the times are taken in turns.",
    ),
    runs=(
        Runs(OFF, lambdas.errors_of, lambdas.KEYS, needs=lambdas.needs),
        Runs(COSTS, lambdas.costs_of, lambdas.KEYS, needs=lambdas.needs),
        Runs(TABLE, ladders.ladders, ladders.KEYS, needs=ladders.needs, where=ALONE, own=True),
    ),
    claims={
        "best": Claim(
            "λ = 1/2 has the smallest trajectory error",
            OFF, half_is_best, EVERY, unit="cases of a scheme and a scene", where=where_not,
        ),
        "longest": Claim(
            "No λ that was tried allows a longer step than 1/2",
            COSTS, half_is_longest, EVERY, unit="cases of a scheme and a scene", names=3,
        ),
        "rises": Claim(
            "The cheapest order of a composition rises as the error falls",
            TABLE, each_scene(COMPOSITION, lambda orders: place(orders).is_monotonic_increasing), EVERY, unit="scenes",
            names=3,
        ),
        "higher": Claim(
            "A generating function of higher r pays at small errors",
            TABLE, each_scene(GENERATING, lambda names: r(names.iloc[-1]) > r(names.iloc[0])), EVERY, unit="scenes",
            names=3,
        ),
        "schemes": Claim(
            "Scheme IV or V is, at some error, the cheapest energy-preserving method",
            TABLE, each_scene(ENERGY, lambda names: names.str.startswith("scheme-").any()), EVERY, unit="scenes",
            names=3,
        ),
    },
    numbers={
        "order": fastest(COMPOSITION),
        "error": of(TABLE)(lambda rungs: power(cheapest(rungs, COMPOSITION)["error"].min())),
        "keeper": fastest(ENERGY),
    },
    checks={
        "ends": Claim("Runs at λ = 1/2 reach their end", OFF, "trajectory", at_most(10.0),
                      rows=f"lam == {HALF}", where="{method} on {scene}"),
        "stable": Claim("At λ = 1/2 the step at which all are compared is possible", COSTS, "`largest h` >= h",
                        rows=f"lam == {HALF}", where="{method} on {scene}"),
        "fine": Claim("Every setting reaches small errors", TABLE, lambda rows: rows["error"].fillna(np.inf).groupby(
                      [rows[k] for k in ("knob", "scene", "setting")]).min(), at_most(1e-2)),
    },
    figure=draw,
    shown=table,
    whole=whole,
    limits=(
        f"λ = 1/2 counts as best where its error is at most {SAME:g} times the smallest; λ is on a grid of "
        f"1/{lambdas.FINE}, its steps and gradients on one of 1/{lambdas.COARSE}.",
        "The best λ is that of one orbit, time span and step: at another, errors of opposite sign cancel elsewhere.",
        "A step counts as possible if it, and every shorter one tried, keeps the energy error below the size of H's "
        f"terms for {lambdas.SURVIVED} steps.",
        "Times are this machine's, medians of rounds taken in turns; a setting whose interval overlaps the cheapest's "
        "is tied with it.",
        f"A run of an energy-preserving method counts only if its relative energy error is at most {KEPT:g} and every "
        "step had a solution.",
    ),
)  # fmt: skip
