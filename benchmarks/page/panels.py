"""Figures of studies: panels in a row or a grid with their curves, and a decorator that makes pictures of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from phasebench.benchmarks import style

from .page import Data, Picture, of

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: What makes the pictures of a page: (data, folder) -> pictures; what draws one of rows; a table, by name or made.
Pictures = Callable[[Data, Path], list[Picture] | None]
Draw = Callable[..., "Figure | tuple[Figure, str] | None"]
Source = str | Callable[[Data], "pd.DataFrame | None"]


def picture(
    tables: Source | tuple[Source, ...], file: str, title: str, caption: str = ""
) -> Callable[[Draw], Pictures]:
    """Decorator: turn a function that draws a figure of the rows of tables into one of (data, folder), for a `Study`.

    It returns the figure, or (figure, caption) where the caption depends on the rows, or None for no picture.
    """

    def decorate(draw: Draw) -> Pictures:
        @of(*(tables if isinstance(tables, tuple) else (tables,)))
        @style.styled
        def pictures(*given: Any) -> list[Picture] | None:
            *rows, folder = given
            if (drawn := draw(*rows)) is None:
                return None
            figure, words = drawn if isinstance(drawn, tuple) else (drawn, caption)
            return [Picture(style.save(figure, folder, f"{file}.png"), title, words)]

        return pictures

    return decorate


def together(*figures: Pictures) -> Pictures:
    """All pictures of several such functions."""
    return lambda data, folder: [picture for draw in figures for picture in draw(data, folder) or ()]


def row(
    parts: Iterable[tuple[object, Any]], draw: Callable[[Axes, Any], object], height: float, xlabel: str, ylabel: str,
    *, legend: int = 0, grid: bool = True, **options: Any,
) -> Figure:  # fmt: skip
    """A row of panels, each with a title and what ``draw(axes, part)`` draws of its part: ``parts`` are (title, part).

    ``legend`` are the columns of a legend of all panels above them; 0 for one of its own below each panel.  ``options``
    are those of `style.panels`.
    """
    parts = [*parts]
    figure, (panels,) = style.panels(1, len(parts), height, **options)
    for axes, (title, part) in zip(panels, parts, strict=True):
        draw(axes, part)
        axes.set(title=title, xlabel=xlabel)
        if grid:
            axes.grid(color="0.93", linewidth=0.5)
        if not legend:
            below = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.2)}
            make = partial(axes.legend, *axes.get_legend_handles_labels(), **below)
            style.fit_legend(make, 2, figure.bbox.width / len(parts))
    panels[0].set_ylabel(ylabel)
    if legend:
        style.legend_above(figure, panels[0], legend)
    return figure


def curves(
    by: str, x: str, y: str, names: Sequence[str] = (), *, order: str = "", sort: bool = True, most: int | None = None,
    span: tuple[float | None, float | None] = (None, None), level: float | None = None,
) -> Callable[[Axes, pd.DataFrame], None]:  # fmt: skip
    """What draws a log-log curve y over x for each value of the column ``by``, at most ``most`` of them.

    ``names`` are these values; by default they are those of the rows, in the order of their least ("min") or largest
    ("max") y if ``order`` says so.  Without ``sort`` a curve joins its rows as they stand.  Values of y beyond ``span``
    (low, high) are drawn at its ends; ``level`` is the y of a grey line.
    """

    def draw(axes: Axes, rows: pd.DataFrame) -> None:
        found = rows.groupby(by)[y].agg(order).sort_values().index if order else rows[by].unique()
        for k, name in enumerate([*(names or found)][:most]):
            own = rows[rows[by] == name]
            own = own.sort_values(x) if sort else own
            axes.loglog(own[x], own[y].clip(*span), label=name, **style.curve(k))
        if level is not None:
            axes.axhline(level, color=style.GREY, linewidth=0.8)

    return draw


def grid(
    titles: Sequence[str], columns: int, height: float, xlabel: str, ylabel: str, **options: Any
) -> tuple[Figure, dict[str, Axes]]:
    """A figure with a panel for each title, in so many columns, and its axes by title."""
    figure, panels = style.panels(-(-len(titles) // columns), columns, height, **options)
    for axes in panels.flat[len(titles) :]:
        axes.set_axis_off()
    for axes in panels[-1]:
        axes.set_xlabel(xlabel)
    for axes in panels[:, 0]:
        axes.set_ylabel(ylabel)
    return figure, dict(zip(titles, panels.flat, strict=False))
