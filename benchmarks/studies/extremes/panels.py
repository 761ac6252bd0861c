"""Figures of these studies: panels in a row or a grid, and a decorator that makes pictures of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from phasebench.benchmarks import style
from phasebench.benchmarks.page.page import Data, Picture, of

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Draw = Callable[["pd.DataFrame"], "Figure"]


def picture(
    table: str | Callable, name: str, title: str, caption: str
) -> Callable[[Draw], Callable[..., list[Picture] | None]]:
    """Decorator: turn a function that draws a figure of a table's rows into one of (data, folder), for a `Study`."""

    def decorate(draw: Draw) -> Callable[[Data, Path], list[Picture] | None]:
        @of(table)
        @style.styled
        def pictures(rows: pd.DataFrame, folder: Path) -> list[Picture]:
            return [Picture(style.save(draw(rows), folder, f"extremes-{name}.png"), title, caption)]

        return pictures

    return decorate


def row(
    parts: Mapping[str, pd.DataFrame], curve: str, x: str, y: str, xlabel: str, ylabel: str, height: float,
    *, by: str = "", span: tuple[float | None, float | None] = (None, None), level: float | None = None,
    legend: int = 0, **options: Any,
) -> Figure:  # fmt: skip
    """A row of log-log panels, title -> rows, with a curve for each value of the column ``curve``.

    At most as many curves are drawn as there are line styles.

    Parameters
    ----------
    by : curves are in the order of their least ("min") or largest ("max") y; by default in that of the rows
    span : values of y beyond these (low, high) are drawn at its ends
    level : the y of a grey line
    legend : the columns of a legend of all panels above them; 0 for one of its own below each panel
    options : those of `style.panels`
    """
    figure, (panels,) = style.panels(1, len(parts), height, **options)
    width = figure.bbox.width / len(parts)
    for axes, (title, rows) in zip(panels, parts.items(), strict=True):
        names = rows.groupby(curve)[y].agg(by).sort_values().index if by else rows[curve].unique()
        for look, name in zip(style.looks(), names, strict=False):
            own = rows[rows[curve] == name].sort_values(x)
            axes.loglog(own[x], own[y].clip(*span), label=name, **look)
        if level is not None:
            axes.axhline(level, color=style.GREY, linewidth=0.8)
        axes.set(title=title, xlabel=xlabel)
        if not legend:
            below = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.2)}
            style.fit_legend(partial(axes.legend, *axes.get_legend_handles_labels(), **below), 2, width)
    panels[0].set_ylabel(ylabel)
    if legend:
        style.legend_above(figure, panels[0], legend)
    return figure


def grid(methods: Sequence[str], xlabel: str, ylabel: str) -> tuple[Figure, dict[str, Axes]]:
    """A figure with two rows of panels, and its axes by method."""
    figure, panels = style.panels(2, -(-len(methods) // 2), 4.9)
    for axes in panels[-1]:
        axes.set_xlabel(xlabel)
    for axes in panels[:, 0]:
        axes.set_ylabel(ylabel)
    return figure, dict(zip(methods, panels.flat, strict=False))
