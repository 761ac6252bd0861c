"""The figures of the knobs."""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks.page import style
from phasebench.benchmarks.page.page import Picture
from phasebench.integrators.driver import OK

from . import arithmetic, findings, ladders, lambdas, nodes, solvers

#: No error below is drawn.
SMALLEST = 1e-17


@style.drawn
def over_lambda(errors: pd.DataFrame, costs: pd.DataFrame, folder) -> Picture:
    """The error, the evaluations and the largest step over lambda; a column a scheme, a curve a scene."""
    errors = errors[errors["finer"] == errors["finer"].min()]
    methods, scenes = list(dict.fromkeys(errors["method"])), list(dict.fromkeys(errors["scene"]))
    figure, panels = style.panels(3, len(methods), 6.4, sharex=True, sharey="row")
    for column, id in enumerate(methods):
        for k, scene in enumerate(scenes):
            part, cost = (t[(t["method"] == id) & (t["scene"] == scene)].sort_values("lam") for t in (errors, costs))
            _relative(panels[0, column], part["lam"], part["trajectory"], label=scene, **style.curve(k, len(part), 6))
            panels[1, column].plot(cost["lam"], cost["gradients per step"], **style.curve(k, len(cost), 6))
            _relative(panels[2, column], cost["lam"], cost["largest h"], **style.curve(k, len(cost), 6))
        panels[0, column].set(title=id, yscale="log")
        panels[1, column].set(yscale="log")
        panels[2, column].set(yscale="log", xlabel="λ")
        for axes in panels[:, column]:
            axes.axvline(findings.HALF, color=style.GREY, linewidth=0.8, linestyle=":")
    for axes, label in zip(
        panels[:, 0], ("error / that at 1/2", "gradients a step", "largest h / that at 1/2"), strict=True
    ):
        axes.set_ylabel(label)
    style.legend_above(figure, panels[0, 0], 3)
    caption = (
        "The largest error of the trajectory at fixed h, the gradients of a step, the largest h that survives; errors "
        "and steps in units of those at λ = 1/2 (dotted). Where the first curves are below 1, another λ is better."
    )
    return Picture(style.save(figure, folder, "knobs-lambda.png"), "error, cost and largest step over lambda", caption)


def _relative(axes, lam: pd.Series, values: pd.Series, **look) -> None:
    """A curve in units of its value at 1/2; nothing where that is missing."""
    half = values[lam == findings.HALF]
    if len(half) and 0 < half.iloc[0] < np.inf:
        axes.plot(lam, (values / half.iloc[0]).replace([0, np.inf], np.nan), **look)


def _curves(axes, table: pd.DataFrame, by: list[str], x: str, y: str, name) -> None:
    """A curve for each group of a table; ``name`` makes a label of a group's key."""
    for look, (key, part) in zip(style.looks(), table.groupby(by, sort=False), strict=False):
        part = part.sort_values(x)
        axes.plot(part[x], part[y].clip(lower=SMALLEST), label=name(*key), **look)


def _ladder(axes, rungs: pd.DataFrame) -> None:
    """Error against time, a curve a setting."""
    arrived = rungs[(rungs["status"] == OK) & (rungs["error"] > 0)]
    _curves(axes, arrived, ["setting"], "us", "error", str)
    axes.set(xlabel="µs to the end", title=rungs["scene"].iloc[0], xscale="log", yscale="log", ylim=(1e-14, 10))


def _legend(axes, columns: int) -> None:
    handles, labels = axes.get_legend_handles_labels()
    axes.legend(handles, labels, loc="lower center", bbox_to_anchor=(0.5, 1.12), ncols=columns, handlelength=3.0)


def _first(rungs: pd.DataFrame, knob: str) -> pd.DataFrame:
    """A knob's rungs on its first scene."""
    part = rungs[rungs["knob"] == knob]
    return part[part["scene"] == part["scene"].iloc[0]] if len(part) else part


def _side_by_side(parts: list[pd.DataFrame], drawn, label: str):
    """(a figure with a panel for each of the parts that has rows, its panels); None where none has."""
    parts = [part for part in parts if len(part)]
    if not parts:
        return None
    figure, (panels,) = style.panels(1, len(parts), 3.9, sharey=True)
    for axes, part in zip(panels, parts, strict=True):
        drawn(axes, part)
    panels[0].set_ylabel(label)
    return figure, panels


@style.drawn
def orders(rungs: pd.DataFrame, folder) -> Picture | None:
    """The order of a composition, the r of a generating function."""
    made = _side_by_side(
        [_first(rungs, knob) for knob in (ladders.COMPOSITION, ladders.GENERATING)], _ladder, "error at the end"
    )
    if made is None:
        return None
    for axes in made[1]:
        _legend(axes, 2)
    caption = (
        "Error against time: left compositions of Stormer-Verlet of order 2 to 10, right generating functions of order "
        "r; the CSV has other scenes."
    )
    return Picture(style.save(made[0], folder, "knobs-orders.png"), "orders", caption)


def _scenes(table: pd.DataFrame) -> list[pd.DataFrame]:
    return [part for _, part in table.groupby("scene", sort=False)]


@style.drawn
def keepers(rungs: pd.DataFrame, folder) -> Picture | None:
    """Methods that keep the energy."""
    made = _side_by_side(_scenes(findings.usable(rungs, ladders.ENERGY)), _ladder, "error at the end")
    if made is None:
        return None
    style.legend_above(made[0], made[1][0], 3)
    caption = f"Runs that kept the energy to {findings.KEPT:g}: error of the end against time."
    return Picture(style.save(made[0], folder, "knobs-energy.png"), "methods that keep the energy", caption)


@style.drawn
def solving(table: pd.DataFrame, folder) -> Picture | None:
    """The tolerance of the stage equations: evaluations against error, at the smaller step of each scene."""

    def panel(axes, part: pd.DataFrame) -> None:
        part = part[
            (part["h"] == part["h"].min()) & (part["start"] == solvers.FIVE) & (part["solver"] != solvers.NEWTON)
        ]
        part = part[part["status"] == OK]
        _curves(axes, part, ["solver"], "evaluations", "error", str)
        axes.set(xlabel="evaluations a step", title=part["scene"].iloc[0], yscale="log")

    made = _side_by_side([p for p in _scenes(table) if (p["status"] == OK).any()], panel, "error at the end")
    if made is None:
        return None
    style.legend_above(made[0], made[1][0], 3)
    caption = (
        f"{solvers.METHOD}, its equations solved to tolerances from {max(solvers.TOLERANCES):g} to round-off: what a "
        "looser one saves, and where its own error shows."
    )
    return Picture(style.save(made[0], folder, "knobs-solvers.png"), "solving to a tolerance", caption)


@style.drawn
def floors(rules: pd.DataFrame, sums: pd.DataFrame, folder) -> Picture:
    """The energy over the nodes of AVF's quadrature; round-off over the steps."""
    figure, ((left, right),) = style.panels(1, 2, 3.9)
    fixed = rules[rules["nodes"] != nodes.CONFIRMED]
    _curves(left, fixed, ["scene", "h"], "nodes", "energy error", lambda scene, h: f"{scene}, h = {h:g}")
    left.set(xlabel="nodes", ylabel="largest relative energy error", title="AVF", yscale="log")
    _curves(right, sums, ["scene", "arithmetic"], "steps", "round-off rms", lambda scene, kind: f"{scene}, {kind}")
    right.set(xlabel="steps", ylabel="rms round-off at the end", title=arithmetic.METHOD, xscale="log", yscale="log")
    for axes in (left, right):
        _legend(axes, 1)
    caption = (
        "Left: the energy error over the nodes of a fixed rule. Right: the distance from the same step map in long "
        "double."
    )
    return Picture(style.save(figure, folder, "knobs-floors.png"), "nodes, sums and precision", caption)


def draw(data, folder) -> list[Picture]:
    """The figures of the tables that were measured."""
    names = (lambdas.ERRORS, lambdas.COSTS, ladders.TABLE, nodes.TABLE, arithmetic.ERRORS, solvers.TABLE)
    read = {n: data(n) for n in names}
    has = {name for name, table in read.items() if table is not None and len(table)}
    out = []
    if {lambdas.ERRORS, lambdas.COSTS} <= has:
        out.append(over_lambda(read[lambdas.ERRORS], read[lambdas.COSTS], folder))
    if ladders.TABLE in has:
        out += [orders(read[ladders.TABLE], folder), keepers(read[ladders.TABLE], folder)]
    if {nodes.TABLE, arithmetic.ERRORS} <= has:
        out.append(floors(read[nodes.TABLE], read[arithmetic.ERRORS], folder))
    if solvers.TABLE in has:
        out.append(solving(read[solvers.TABLE], folder))
    return [picture for picture in out if picture is not None]
