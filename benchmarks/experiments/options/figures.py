"""Figures on the methods' options: lambda, orders, energy-preserving methods, quadrature nodes, summation, solvers."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.page.page import Picture
from phasebench.integrators.driver import OK

from . import arithmetic, findings, ladders, lambdas, nodes, solvers

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from phasebench.benchmarks.page.page import Data

#: Smaller errors are drawn at this value.
SMALLEST = 1e-17


@style.styled
def over_lambda(errors: pd.DataFrame, costs: pd.DataFrame, folder: Path) -> Picture:
    """Draw error, gradients a step and largest step of schemes over their parameter lambda.

    There is a column of panels for each scheme and a curve for each orbit.  ``errors`` and ``costs`` are the two tables
    of the module `lambdas`; ``folder`` is where the file is written.
    """
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
        "From above: the largest error of the trajectory at fixed h, the gradients of a step, the longest step; "
        "errors and steps over those at λ = 1/2 (dotted). Where an error is below 1, that λ is better than 1/2."
    )
    return Picture(style.save(figure, folder, "options-lambda.png"), "error, cost and longest step over λ", caption)


def _relative(axes: Axes, lam: pd.Series, values: pd.Series, **look: Any) -> None:
    """Plot ``values`` over the parameter ``lam``, divided by the value at lam = 1/2.

    Nothing is plotted if the value at 1/2 is missing; ``look`` are keywords of the curve's style.
    """
    half = values[lam == findings.HALF]
    if len(half) and 0 < half.iloc[0] < np.inf:
        axes.plot(lam, (values / half.iloc[0]).replace([0, np.inf], np.nan), **look)


def _curves(axes: Axes, table: pd.DataFrame, by: list[str], x: str, y: str, name: Callable[..., str]) -> None:
    """Plot column ``y`` over column ``x``, a curve for each group of the table by the columns ``by``.

    ``name`` is a function of the values of these columns that returns the curve's label.
    """
    for look, (key, part) in zip(style.looks(), table.groupby(by, sort=False), strict=False):
        part = part.sort_values(x)
        axes.plot(part[x], part[y].clip(lower=SMALLEST), label=name(*key), **look)


def _ladder(axes: Axes, rungs: pd.DataFrame) -> None:
    """Plot the error of the end state against the time of the run, a curve for each setting of an option.

    ``rungs`` has a row for each run of a setting, with ever smaller steps.
    """
    arrived = rungs[(rungs["status"] == OK) & (rungs["error"] > 0)]
    _curves(axes, arrived, ["setting"], "us", "error", str)
    axes.set(xlabel="µs to the end", title=rungs["scene"].iloc[0], xscale="log", yscale="log", ylim=(1e-14, 10))


def _legend(axes: Axes, columns: int) -> None:
    handles, labels = axes.get_legend_handles_labels()
    axes.legend(handles, labels, loc="lower center", bbox_to_anchor=(0.5, 1.12), ncols=columns, handlelength=3.0)


def _first(rungs: pd.DataFrame, option: str) -> pd.DataFrame:
    """Select the runs of an option on the first of its scenes; a scene is an orbit with an end time."""
    part = rungs[rungs["knob"] == option]
    return part[part["scene"] == part["scene"].iloc[0]] if len(part) else part


def _side_by_side(
    parts: list[pd.DataFrame], drawn: Callable[[Axes, pd.DataFrame], None], label: str
) -> tuple[Figure, np.ndarray] | None:
    """Draw panels side by side, one for each non-empty part of a table: (figure, panels), or None if all are empty.

    ``drawn(axes, part)`` fills a panel; ``label`` is that of the vertical axis.
    """
    parts = [part for part in parts if len(part)]
    if not parts:
        return None
    figure, (panels,) = style.panels(1, len(parts), 3.9, sharey=True)
    for axes, part in zip(panels, parts, strict=True):
        drawn(axes, part)
    panels[0].set_ylabel(label)
    return figure, panels


@style.styled
def orders(rungs: pd.DataFrame, folder: Path) -> Picture | None:
    """Draw error against time for compositions by order, and for generating functions by their order r.

    ``rungs`` is the table of the module `ladders`, a row for each run; None if it has no such runs.
    """
    made = _side_by_side(
        [_first(rungs, option) for option in (ladders.COMPOSITION, ladders.GENERATING)], _ladder, "error at the end"
    )
    if made is None:
        return None
    for axes in made[1]:
        _legend(axes, 2)
    caption = (
        "Error against time: left compositions of Störmer–Verlet of order 2 to 10, right generating functions to the "
        "power r of h; the CSV has other scenes."
    )
    return Picture(style.save(made[0], folder, "options-orders.png"), "orders", caption)


def _scenes(table: pd.DataFrame) -> list[pd.DataFrame]:
    return [part for _, part in table.groupby("scene", sort=False)]


@style.styled
def keepers(rungs: pd.DataFrame, folder: Path) -> Picture | None:
    """Draw error against time for the methods that keep the energy: a panel for each orbit, a curve for each method.

    ``rungs`` is the table of the module `ladders`, a row for each run; None if it has no such runs.
    """
    made = _side_by_side(_scenes(findings.usable(rungs, ladders.ENERGY)), _ladder, "error at the end")
    if made is None:
        return None
    style.legend_above(made[0], made[1][0], 3)
    caption = f"Error of the end against time, of runs whose relative energy error is at most {findings.KEPT:g}."
    return Picture(style.save(made[0], folder, "options-energy.png"), "methods that keep the energy", caption)


@style.styled
def solving(table: pd.DataFrame, folder: Path) -> Picture | None:
    """Draw error against evaluations of runs that solve the stage equations to ever tighter tolerances, by solver.

    ``table`` is that of the module `solvers`; None if no run is completed.
    """

    def panel(axes: Axes, part: pd.DataFrame) -> None:
        part = part[
            (part["h"] == part["h"].min()) & (part["start"] == solvers.FIVE) & (part["solver"] != solvers.NEWTON)
        ]
        part = part[part["status"] == OK]
        own = {solvers.ENGINE: "the integrator's own"}
        _curves(axes, part, ["solver"], "evaluations", "error", lambda solver: own.get(solver, solver))
        axes.set(xlabel="evaluations a step", title=part["scene"].iloc[0], yscale="log")

    made = _side_by_side([p for p in _scenes(table) if (p["status"] == OK).any()], panel, "error at the end")
    if made is None:
        return None
    style.legend_above(made[0], made[1][0], 3)
    caption = (
        f"Error of {solvers.METHOD} against evaluations, its equations solved to tolerances from "
        f"{max(solvers.TOLERANCES):g} to round-off: where a curve is level, a looser tolerance loses nothing."
    )
    return Picture(style.save(made[0], folder, "options-solvers.png"), "solving to a tolerance", caption)


@style.styled
def floors(rules: pd.DataFrame, sums: pd.DataFrame, folder: Path) -> Picture:
    """Draw the energy error over quadrature nodes (left), and the round-off of Stormer-Verlet over the steps (right).

    The quadrature is that of AVF, the averaged vector field method.  ``rules`` is the table of the module `nodes`,
    ``sums`` the table of errors of `arithmetic`.
    """
    figure, ((left, right),) = style.panels(1, 2, 3.9)
    fixed = rules[rules["nodes"] != nodes.CONFIRMED]
    _curves(left, fixed, ["scene", "h"], "nodes", "energy error", lambda scene, h: f"{scene}, h = {h:g}")
    left.set(xlabel="nodes", ylabel="largest relative energy error", title="AVF", yscale="log")
    _curves(right, sums, ["scene", "arithmetic"], "steps", "round-off rms", lambda scene, kind: f"{scene}, {kind}")
    right.set(xlabel="steps", ylabel="rms round-off at the end", title=arithmetic.METHOD, xscale="log", yscale="log")
    for axes in (left, right):
        _legend(axes, 1)
    caption = (
        "Left: AVF's energy error over the nodes of its quadrature. Right: the round-off of Störmer–Verlet, as "
        "distance from the same steps in long double."
    )
    return Picture(style.save(figure, folder, "options-floors.png"), "nodes, sums and precision", caption)


def _tables(data: Data, *names: str) -> dict[str, pd.DataFrame]:
    """Read tables by name from ``data``, and return those that have rows: name -> table."""
    read = {name: data(name) for name in names}
    return {name: table for name, table in read.items() if table is not None and len(table)}


def draw(data: Data, folder: Path) -> list[Picture]:
    """Draw the figures of the schemes' parameter lambda, of orders and of energy-preserving methods.

    ``data`` maps a table's name to the table; a figure whose table is missing is left out.
    """
    has = _tables(data, lambdas.ERRORS, lambdas.COSTS, ladders.TABLE)
    out = []
    if {lambdas.ERRORS, lambdas.COSTS} <= set(has):
        out.append(over_lambda(has[lambdas.ERRORS], has[lambdas.COSTS], folder))
    if ladders.TABLE in has:
        out += [orders(has[ladders.TABLE], folder), keepers(has[ladders.TABLE], folder)]
    return [picture for picture in out if picture is not None]


def draw_numerics(data: Data, folder: Path) -> list[Picture]:
    """Draw the figures of quadrature nodes, summation, precision and solvers.

    ``data`` maps a table's name to the table; a figure whose table is missing is left out.
    """
    has = _tables(data, nodes.TABLE, arithmetic.ERRORS, solvers.TABLE)
    out = []
    if {nodes.TABLE, arithmetic.ERRORS} <= set(has):
        out.append(floors(has[nodes.TABLE], has[arithmetic.ERRORS], folder))
    if solvers.TABLE in has:
        out.append(solving(has[solvers.TABLE], folder))
    return [picture for picture in out if picture is not None]
