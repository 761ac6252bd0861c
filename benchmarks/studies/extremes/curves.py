"""Curves of many methods in one panel, and the legend below it."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from typing import TYPE_CHECKING

from phasebench.benchmarks import style

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes


def curves(
    axes: Axes,
    table: pd.DataFrame,
    by: str,
    x: str,
    y: str,
    names: Iterable[str] | None = None,
    span: tuple[float | None, float | None] = (None, None),
) -> None:
    """Draw y over x on logarithmic axes, a curve for each name in the column ``by``, as many as there are line styles.

    ``names`` selects the names and their order; values of y beyond ``span`` (low, high) are drawn at its ends.
    """
    for look, name in zip(style.looks(), dict.fromkeys(table[by] if names is None else names), strict=False):
        rows = table[table[by] == name].sort_values(x)
        axes.loglog(rows[x], rows[y].clip(*span), label=name, **look)


def best(table: pd.DataFrame, worst: bool = False) -> list:
    """The methods, sorted by their least error (with ``worst`` by their largest)."""
    errors = table.groupby("method")["error"]
    return list((errors.max() if worst else errors.min()).sort_values().index)


def legend_below(axes: Axes) -> None:
    """Add a legend of a panel's own curves below it, as wide as the panel's share of the figure."""
    make = partial(axes.legend, *axes.get_legend_handles_labels(), loc="upper center", bbox_to_anchor=(0.5, -0.2))
    style.fit_legend(make, 2, axes.figure.bbox.width / axes.get_subplotspec().get_gridspec().ncols)
