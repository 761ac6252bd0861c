"""Options that change the step map: a scheme's parameter lambda, the order, the energy-preserving method."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.ladder.choice import at
from phasebench.benchmarks.measure.timing import NOWHERE, TIED, cheaper
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import ROWS, Data, Table, of, once
from phasebench.benchmarks.page.shared import picture, together
from phasebench.benchmarks.page.study import Claim, Runs, Study
from phasebench.benchmarks.page.verdict import at_most
from phasebench.benchmarks.store.cells import ALONE, ProblemKey, states
from phasebench.integrators.driver import OK
from phasebench.integrators.registry import BY_ID

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
CASE, PLACE = ["scene", "method"], "{method} on {scene}"


@of(OFF)
def best(errors: pd.DataFrame) -> pd.DataFrame:
    """The lambda of least trajectory error at the larger step, by scheme and orbit; ``gain``: the error at 1/2 over it.

    Errors that are not above the uncertainty of the truth do not count.
    """
    rows = errors[(errors["finer"] == 1) & (errors["trajectory"] > errors["uncertainty"])]
    rows = rows[np.isfinite(rows["trajectory"])]
    half = rows[rows["lam"] == HALF].set_index(CASE)["trajectory"]
    least = rows.loc[rows.groupby(CASE, sort=False)["trajectory"].idxmin()]
    least = least.join(half.rename("at half"), on=CASE, how="inner")
    return least.assign(gain=least["at half"] / least["trajectory"])


def half_is_longest(costs: pd.DataFrame) -> pd.Series:
    """True where lambda = 1/2 allows the longest step, for each scheme and orbit."""
    return (costs["largest h"] >= costs.groupby(CASE)["largest h"].transform("max"))[costs["lam"] == HALF]


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
            costs = {
                name: cost for name, own in part.groupby("setting", sort=False) if (cost := at(own, error)) != NOWHERE
            }
            if costs:
                first = min(costs, key=lambda name: costs[name].value)
                ties = [name for name in costs if name != first and cheaper(costs[first], costs[name]) == TIED]
                slowest = max(c.value for c in costs.values()) / costs[first].value
                rows.append((option, scene, error, first, ", ".join(ties), costs[first].value, len(costs), slowest))
    columns = ["option", "scene", "error", "setting", "ties", "us", "settings", "dearest / cheapest"]
    return pd.DataFrame(rows, columns=columns)


def each_scene(option: str, good: Callable[[pd.Series], bool]) -> Callable[[pd.DataFrame], pd.Series]:
    """True where the fastest settings of an option, from the largest error to the smallest, are good, by orbit."""

    def judged(rungs: pd.DataFrame) -> pd.Series:
        settings = cheapest(rungs, option).groupby("scene", sort=False)["setting"]
        return pd.Series({scene: bool(good(names)) for scene, names in settings}, dtype=bool)

    return judged


def rises(orders: pd.Series) -> bool:
    """True if compositions are in the order of `SETTINGS`."""
    return orders.map({name: k for k, name in enumerate(SETTINGS[COMPOSITION])}).is_monotonic_increasing


def higher(names: pd.Series) -> bool:
    """True if the last generating function has a larger order r than the first; that of an unknown one is 0."""
    first, last = (ORDERS.get(name, (0,))[0] for name in (names.iloc[0], names.iloc[-1]))
    return last > first


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
        return " or ".join(found[found["error"] == found["error"].min()]["setting"].unique()) or None

    return of(TABLE)(named)


# -- what is shown -----------------------------------------------------------------------------------------------------


@of(best, COSTS, TABLE)
def _table(best: pd.DataFrame, costs: pd.DataFrame, rungs: pd.DataFrame) -> Table:
    rows = []
    for r in best.to_dict("records"):
        part = costs[(costs["scene"] == r["scene"]) & (costs["method"] == r["method"])].set_index("lam")
        gradients = part["gradients per step"]
        dearer = gradients.iloc[np.abs(part.index - r["lam"]).argmin()] / gradients[HALF]
        gives = f"error {number(r['trajectory'], 2)}, at λ = 1/2 {times(r['gain'])} that"
        rows.append((f"λ of {r['method']}", r["scene"], number(r["lam"], 2), gives, f"{times(dearer)} the gradients"))
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


@picture(
    (OFF, COSTS), "options-lambda", "error, cost and longest step over λ",
    "From above: the largest error of the trajectory at fixed h, the gradients of a step, the longest step; "
    "errors and steps over those at λ = 1/2 (dotted). Where an error is below 1, that λ is better than 1/2.",
)  # fmt: skip
def _draw_lambda(errors: pd.DataFrame, costs: pd.DataFrame) -> style.Figure:
    """Error, gradients a step and largest step over lambda: a column of panels for each scheme."""
    errors = errors[errors["finer"] == 1]
    figure, panels = style.panels(3, len(METHODS), 6.4, sharex=True, sharey="row")
    rows = {
        "error / that at 1/2": (errors, "trajectory"),
        "gradients a step": (costs, "gradients per step"),
        "largest h / that at 1/2": (costs, "largest h"),
    }
    for line, (label, (table, column)) in zip(panels, rows.items(), strict=True):
        line[0].set_ylabel(label)
        for axes, method in zip(line, METHODS, strict=True):
            for k, scene in enumerate(SCENES):
                part = table[(table["method"] == method) & (table["scene"] == scene)].sort_values("lam")
                y = part[column]
                if "that at 1/2" in label:
                    half = y[part["lam"] == HALF].max()
                    y = (y / half).replace([0, np.inf], np.nan) if 0 < half < np.inf else y[:0]
                axes.plot(part["lam"][: len(y)], y, label=scene, **style.curve(k, len(part), 6))
            axes.set_yscale("log")
            axes.axvline(HALF, color=style.GREY, linewidth=0.8, linestyle=":")
    for first, last, method in zip(panels[0], panels[-1], METHODS, strict=True):
        first.set_title(method)
        last.set_xlabel("λ")
    style.legend_above(figure, panels[0, 0], 3)
    return figure


def plot(axes: Axes, rows: pd.DataFrame, by: list[str], x: str, y: str, label: str) -> None:
    """Curves of a column over another, one for each group; ``label`` is a format string of a row."""
    for look, (_, part) in zip(style.looks(), rows.groupby(by, sort=False), strict=False):
        part = part.sort_values(x)
        axes.plot(part[x], part[y].clip(lower=SMALLEST), label=label.format_map(part.iloc[0]), **look)


def _ladders(parts: list[pd.DataFrame], legends: bool) -> style.Figure | None:
    """Errors over times, panels side by side with a legend each or one for all."""
    parts = [part for part in (part[(part["status"] == OK) & (part["error"] > 0)] for part in parts) if len(part)]
    if not parts:
        return None
    figure, (panels,) = style.panels(1, len(parts), 3.9, sharey=True)
    for axes, part in zip(panels, parts, strict=True):
        plot(axes, part, ["setting"], "us", "error", "{setting}")
        axes.set(xlabel="µs to the end", title=part["scene"].iloc[0], xscale="log", yscale="log", ylim=(1e-14, 10))
        if legends:
            axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.12), ncols=2, handlelength=3.0)
    panels[0].set_ylabel("error at the end")
    if not legends:
        style.legend_above(figure, panels[0], 3)
    return figure


@picture(
    TABLE, "options-orders", "orders",
    "Error against time: left compositions of Störmer–Verlet of order 2 to 10, right generating functions to the "
    "power r of h; the CSV has other scenes.",
)  # fmt: skip
def _draw_orders(rungs: pd.DataFrame) -> style.Figure | None:
    options = [rungs[rungs["knob"] == option] for option in (COMPOSITION, GENERATING)]
    return _ladders([part[part["scene"] == part["scene"].iloc[0]] for part in options if len(part)], True)


@picture(
    TABLE, "options-energy", "methods that keep the energy",
    f"Error of the end against time, of runs whose relative energy error is at most {KEPT:g}.",
)  # fmt: skip
def _draw_keepers(rungs: pd.DataFrame) -> style.Figure | None:
    return _ladders([part for _, part in usable(rungs, ENERGY).groupby("scene", sort=False)], False)


def _needs(knob: str, scene: str) -> tuple:
    made = ProblemKey(scene)
    return ladders.LADDERS[knob, scene], *SETTINGS[knob].values(), made, states(made.id)


def _needs_lambda(scene: str, method: str) -> tuple:
    return ProblemKey(scene), SCENES[scene], BY_ID[method]


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
        Runs(OFF, lambdas.errors_of, lambdas.KEYS, needs=_needs_lambda),
        Runs(COSTS, lambdas.costs_of, lambdas.KEYS, needs=_needs_lambda),
        Runs(TABLE, ladders.ladders, ladders.KEYS, needs=_needs, where=ALONE, own=True),
    ),
    claims={
        "best": Claim(
            "λ = 1/2 has the smallest trajectory error",
            best, lambda rows: rows["gain"].sort_values(ascending=False) <= SAME, unit="cases of a scheme and a scene",
            where=f"{PLACE}: {{gain:.2g}} times the error at λ = {{lam:.2g}}",
        ),
        "longest": Claim(
            "No λ that was tried allows a longer step than 1/2",
            COSTS, half_is_longest, unit="cases of a scheme and a scene", where=PLACE, names=3,
        ),
        "rises": Claim(
            "The cheapest order of a composition rises as the error falls",
            TABLE, each_scene(COMPOSITION, rises), unit="scenes", names=3,
        ),
        "higher": Claim(
            "A generating function of higher r pays at small errors",
            TABLE, each_scene(GENERATING, higher), unit="scenes", names=3,
        ),
        "schemes": Claim(
            "Scheme IV or V is, at some error, the cheapest energy-preserving method",
            TABLE, each_scene(ENERGY, lambda names: names.str.startswith("scheme-").any()), unit="scenes", names=3,
        ),
    },
    numbers={
        "order": fastest(COMPOSITION),
        "error": of(TABLE)(lambda rungs: power(cheapest(rungs, COMPOSITION)["error"].min())),
        "keeper": fastest(ENERGY),
    },
    checks={
        "ends": Claim("Runs at λ = 1/2 reach their end", OFF, "trajectory", at_most(10.0),
                      rows=f"lam == {HALF}", where=PLACE),
        "stable": Claim("At λ = 1/2 the step at which all are compared is possible", COSTS, "`largest h` >= h",
                        rows=f"lam == {HALF}", where=PLACE),
        "fine": Claim("Every setting reaches small errors", TABLE, lambda rows: rows["error"].fillna(np.inf).groupby(
                      [rows[k] for k in ("knob", "scene", "setting")]).min(), at_most(1e-2)),
    },
    figure=together(_draw_lambda, _draw_orders, _draw_keepers),
    shown=_table,
    whole=of(TABLE)(lambda rungs: pd.concat([cheapest(rungs, o) for o in SETTINGS]).drop(columns="settings")),
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
