"""The style of figures: 7 inches wide, type of at least 8 pt, and for each curve a colour, a line style and a marker.

The colours can be told apart by the colour-blind: M. Okabe, K. Ito, "Color Universal Design" (2008).  matplotlib is
imported only when a figure is drawn.
"""

from __future__ import annotations

import functools
import io
import math
from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    import numpy as np
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure
    from matplotlib.legend import Legend

BLACK, ORANGE, SKY, GREEN, YELLOW, BLUE, VERMILION, PURPLE = (
    "#000000", "#e69f00", "#56b4e9", "#009e73", "#f0e442", "#0072b2", "#d55e00", "#cc79a7",
)  # fmt: skip
GREY, BROWN = "#8c8c8c", "#7a5c00"

#: (colour, line style, marker) of the curves of one panel, in order; any two differ in colour and marker.
CURVES = (
    (BLUE, "-", "o"),
    (VERMILION, "--", "s"),
    (GREEN, "-.", "^"),
    (BLACK, ":", "D"),
    (PURPLE, (0, (5, 1, 1, 1, 1, 1)), "v"),
    (ORANGE, (0, (8, 2)), "P"),
    (SKY, (0, (2, 1)), "X"),
    (GREY, (0, (3, 1)), "*"),
    (BROWN, "-", "h"),
)
WIDTH = 7.0
DPI = 130
COLOURS = 256
#: Least inches between the labels of two ticks.
ROOM = 0.45
#: Vector formats by file ending, with the metadata to leave out so that files are reproducible.
VECTORS = {".svg": {"Date": None, "Creator": None}, ".pdf": {"CreationDate": None, "Creator": None, "Producer": None}}

RC = {
    "font.size": 8.0,
    "axes.titlesize": 8.5,
    "axes.labelsize": 8.5,
    "legend.fontsize": 8.0,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "lines.linewidth": 1.1,
    "lines.markersize": 3.5,
    "axes.linewidth": 0.6,
    "legend.frameon": False,
    "agg.path.chunksize": 10_000,
}


def settings() -> AbstractContextManager[None]:
    """Return a context in which matplotlib uses its defaults and this module's settings `RC`, not the user's own."""
    import matplotlib

    return matplotlib.rc_context(dict(matplotlib.rcParamsDefault) | RC | {"backend": "agg"})


def styled(draw: Callable[..., Any]) -> Callable[..., Any]:
    """Decorator: call the drawing function ``draw`` with the plot settings of this module."""

    @functools.wraps(draw)
    def draw_in_style(*given: Any) -> Any:
        with settings():
            return draw(*given)

    return draw_in_style


def panels(rows: int, columns: int, height: float, **options: Any) -> tuple[Figure, Any]:
    """Make a figure of the report's width and a height in inches; return (figure, array (rows, columns) of its axes).

    ``options`` are passed on to matplotlib's ``Figure.subplots``.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure = _figure_class()(figsize=(WIDTH, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


@functools.cache
def _figure_class() -> type[Figure]:
    """Return a subclass of matplotlib's Figure that a notebook displays even if pyplot is not loaded."""
    from matplotlib.figure import Figure

    class NotebookFigure(Figure):
        """A figure that renders itself as PNG for a notebook."""

        def _repr_png_(self) -> bytes:
            picture = io.BytesIO()
            with settings():
                _plain(self)
                self.savefig(picture, format="png", dpi=DPI)
            return picture.getvalue()

    return NotebookFigure


def curve(index: int, points: int = 0, marks: int = 12) -> dict:
    """Return the plot keywords of the ``index``-th curve of a panel: its colour, line style and marker.

    Curves after those of `CURVES` have their colours again, with the line style of another and the marker of a third.
    ``points`` is the number of points of the curve.  About ``marks`` of them get a marker, not the same ones on each
    curve; if ``points`` is 0, all of them do.
    """
    again, k = divmod(index, len(CURVES))
    colour = CURVES[k][0]
    line, marker = CURVES[(k + 3 * again) % len(CURVES)][1], CURVES[(k + 5 * again) % len(CURVES)][2]
    every = max(1, points // marks)
    return {
        "color": colour,
        "linestyle": line,
        "marker": marker,
        "markevery": (every * k // len(CURVES), every) if points else None,
    }


def looks() -> list[dict]:
    """Return a list of plot keywords for up to nine curves of one panel, each with its own colour, line and marker."""
    return [curve(k) for k in range(len(CURVES))]


def legend_above(figure: Figure, axes: Axes, columns: int) -> None:
    """Put one legend of the curves of ``axes``, for all panels, above them, so that it covers no data.

    ``columns`` is the number of entries in a line of the legend; fewer stand there if it were wider than the figure.
    """
    curves = axes.get_legend_handles_labels()
    make = functools.partial(figure.legend, *curves, loc="outside upper center", handlelength=3.4)
    fit_legend(make, columns, figure.bbox.width)


def fit_legend(make: Callable[..., Legend], columns: int, width: float) -> None:
    """Make a legend in at most ``columns`` columns, fewer if it were wider than ``width`` pixels.

    ``make`` makes it, ``figure.legend`` or ``axes.legend`` with its arguments; it takes the number of columns as
    ``ncols``.
    """
    for wide in range(columns, 0, -1):
        legend = make(ncols=wide)
        if wide == 1 or legend.get_window_extent().width <= width:
            return
        legend.remove()


def row(
    parts: Iterable[tuple[object, Any]], draw: Callable[[Axes, Any], object], height: float, xlabel: str, ylabel: str,
    *, legend: int = 0, grid: bool = True, **options: Any,
) -> Figure:  # fmt: skip
    """A row of panels, each with a title and what ``draw(axes, part)`` draws of its part: ``parts`` are (title, part).

    ``legend`` are the columns of a legend of all panels above them; 0 for one of its own below each panel.  ``options``
    are those of `panels`.
    """
    parts = [*parts]
    figure, (beside,) = panels(1, len(parts), height, **options)
    for axes, (title, part) in zip(beside, parts, strict=True):
        draw(axes, part)
        axes.set(title=title, xlabel=xlabel)
        if grid:
            axes.grid(color="0.93", linewidth=0.5)
        if not legend:
            below = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.2)}
            make = functools.partial(axes.legend, *axes.get_legend_handles_labels(), **below)
            fit_legend(make, 2, figure.bbox.width / len(parts))
    beside[0].set_ylabel(ylabel)
    if legend:
        legend_above(figure, beside[0], legend)
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
            axes.loglog(own[x], own[y].clip(*span), label=name, **curve(k))
        if level is not None:
            axes.axhline(level, color=GREY, linewidth=0.8)

    return draw


def grid(
    titles: Sequence[str], columns: int, height: float, xlabel: str, ylabel: str, **options: Any
) -> tuple[Figure, dict[str, Axes]]:
    """A figure with a panel for each title, in so many columns, and its axes by title."""
    figure, made = panels(-(-len(titles) // columns), columns, height, **options)
    for axes in made.flat[len(titles) :]:
        axes.set_axis_off()
    for axes in made[-1]:
        axes.set_xlabel(xlabel)
    for axes in made[:, 0]:
        axes.set_ylabel(ylabel)
    return figure, dict(zip(titles, made.flat, strict=False))


def decades(axes: Axes) -> None:
    """Extend a logarithmic y axis of errors to whole powers of ten, so that small variations look small.

    Call it after every panel that shares the axis is drawn, since it fixes the limits.
    """
    low, high = (math.log10(y) for y in axes.get_ylim())
    axes.set_ylim(10.0 ** math.floor(low), 10.0 ** math.ceil(high))


def plain_ticks(axis: Axis, inches: float) -> None:
    """Label a logarithmic axis that is ``inches`` long so that no labels overlap; an axis with ticks of its own stays.

    If it spans less than a factor 100, there are labels between the powers of ten, too: as many as have `ROOM` inches
    each.  Minor ticks have none.
    """
    from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter

    if not isinstance(axis.get_major_locator(), LogLocator):
        return
    low, high = sorted(axis.get_view_interval())
    if high < 100 * low:
        decade = inches / math.log10(high / low)
        for factors in ((1, 2, 3, 5, 7), (1, 2, 5), (1, 3)):
            if min(math.log10(b / a) for a, b in pairwise((*factors, 10))) * decade > ROOM:
                break
        powers = [10.0**k for k in range(math.floor(math.log10(low)), math.ceil(math.log10(high)))]
        axis.set_major_locator(FixedLocator([x * power for power in powers for x in factors]))
        axis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def _plain(figure: Figure) -> None:
    """Label the logarithmic axes of a figure by `plain_ticks`, for the layout that it has when it is drawn."""
    figure.draw_without_rendering()
    for axes in figure.axes:
        box = axes.get_window_extent()
        for axis, pixels in ((axes.xaxis, box.width), (axes.yaxis, box.height)):
            plain_ticks(axis, pixels / figure.dpi)


def slope(axes: Axes, h: np.ndarray, values: Iterable[np.ndarray], order: int, line: str = "-") -> None:
    """Draw a grey line of slope ``order`` in log-log axes, below given curves of errors, in the line style ``line``.

    ``h`` is the array (n,) of the steps; ``values`` has one array (n,) of errors at these steps for each curve.
    """
    constant = 0.35 * min(((v[v > 0] / h[v > 0] ** order).min() for v in values if (v > 0).any()), default=math.nan)
    axes.plot(h, constant * h**order, color=GREY, linestyle=line, linewidth=0.9, label=f"slope {order}")


def number(x: float, digits: int = 3) -> str:
    """Return a number as text for captions, with ``digits`` significant digits."""
    return f"{x:.{digits}g}" if math.isfinite(x) else str(x)


def write(figure: Figure, path: Path) -> None:
    """Write a figure as PNG with few colours, or as SVG or PDF by the path's ending; without date or version.

    Equal figures give equal bytes.
    """
    kind = path.suffix.lower()
    with settings():
        _plain(figure)
        if kind in VECTORS:
            import matplotlib

            with matplotlib.rc_context({"svg.hashsalt": "phasebench", "svg.fonttype": "none", "pdf.fonttype": 42}):
                figure.savefig(path, format=kind[1:], metadata=VECTORS[kind])
            return
        figure.set_dpi(DPI)
        figure.canvas.draw()
    _write_png(figure, path)


def _write_png(figure: Figure, path: Path) -> None:
    import numpy as np
    from PIL import Image

    pixels = np.asarray(figure.canvas.buffer_rgba())[..., :3]
    # Maximum coverage keeps the colour of a few markers; median cut, the default, turns it into that of a long curve.
    method, dither = Image.Quantize.MAXCOVERAGE, Image.Dither.NONE
    image = Image.fromarray(np.ascontiguousarray(pixels)).quantize(COLOURS, method=method, dither=dither)
    image.save(path, format="PNG", optimize=True)


def save(figure: Figure, directory: str | Path, name: str) -> str:
    """`write` a figure into a directory, created if missing; return its file name."""
    Path(directory).mkdir(parents=True, exist_ok=True)
    write(figure, Path(directory) / name)
    return name
