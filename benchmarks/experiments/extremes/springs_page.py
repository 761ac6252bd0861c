"""The report page on step-size resonances: do maxima of the energy drift lie on the resonance lines of theory?"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.experiments.extremes import springs
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import Page, Picture, Table, of
from phasebench.benchmarks.page.verdict import Range, Verdict, at_least

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike

#: Largest order |k1| + |k2| of a line; the distance, in grid units, within which a node is on a line; a crest is not
#: below its neighbours on both sides and at least `HIGH` times the nodes beyond them.
ORDER, NEAR, HIGH = 4, 0.75, 5.0
#: Wanted share of a method's crests on lines, and its wanted ratio to the share of all nodes.
MOST, TIMES = 0.9, 1.5
#: Larger drifts are cut to this.
TOP = 10.0
#: Largest order of the lines in the figure.
DRAWN = 3
#: Nodes of each method in the table of the HTML page.
SHOWN = 200


def lines(order: int, last: float) -> list[tuple[int, int, int]]:
    """List (k1, k2, n) of the resonance lines k1 x + k2 y = 2 n, n != 0, that meet the square 0 < x, y <= ``last``.

    x and y are the rotation angles of the two springs in units of pi; |k1| + |k2| is at most ``order``.
    """
    found = []
    for k1 in range(order + 1):
        for k2 in range(-order, order + 1):
            if 0 < k1 + abs(k2) <= order and (k1 or k2 > 0):
                ends = [k1 * x + k2 * y for x in (0, last) for y in (0, last)]
                found += [(k1, k2, n) for n in range(-order, 2 * order) if n and min(ends) < 2 * n <= max(ends)]
    return found


def distance(x: ArrayLike, y: ArrayLike, order: int = ORDER) -> np.ndarray:
    """Compute the distance of points (x, y), angles in units of pi, from the nearest resonance line; an array as x."""
    x, y = np.asarray(x, float), np.asarray(y, float)
    all_ = [np.abs(a * x + b * y - 2 * n) / np.hypot(a, b) for a, b, n in lines(order, max(x.max(), y.max()) + 0.1)]
    return np.min(all_, axis=0) if all_ else np.full(x.shape, np.inf)


def square(rows: pd.DataFrame) -> np.ndarray:
    """Arrange a method's energy drift over both rotation angles as an array (n, n), symmetric in the two springs."""
    i, j = (rows[f"node {k}"].to_numpy(int) - rows["node 1"].min() for k in (1, 2))
    out = np.full((j.max() + 1, j.max() + 1), np.nan)
    out[i, j] = out[j, i] = rows["drift"].clip(upper=TOP)
    return out


def crests(drift: np.ndarray) -> np.ndarray:
    """Find the crests (local maxima) of ``drift`` (n, n) along a row, a column or a diagonal: a boolean array.

    At a crest the drift is no less than at both neighbours, and at least `HIGH` times that at the nodes beyond them.
    """
    n = len(drift)
    wide = np.pad(drift, 2, constant_values=np.inf)  # nodes at the border are no crests

    def at(a: int, b: int) -> np.ndarray:
        return wide[2 + a : 2 + a + n, 2 + b : 2 + b + n]

    out = np.zeros(drift.shape, bool)
    for a, b in ((1, 0), (0, 1), (1, 1), (1, -1)):
        next_ = np.maximum(at(a, b), at(-a, -b))
        after = np.maximum(at(2 * a, 2 * b), at(-2 * a, -2 * b))
        out |= (drift >= next_) & (drift >= HIGH * after)
    return out


def summary_table(table: pd.DataFrame) -> pd.DataFrame:
    """Make a row for each method: how many grid nodes and crests (local maxima) of the drift lie on resonance lines."""
    out = []
    for method, rows in table.groupby("method", sort=False):
        drift, nodes = square(rows), int(rows["nodes"].iloc[0])
        angle = (rows["node 1"].min() + np.arange(len(drift))) / nodes
        x, y = np.meshgrid(angle, angle, indexing="ij")
        upper = x <= y
        on, crest = (distance(x, y) <= NEAR / nodes)[upper], crests(drift)[upper]
        best = int(np.argmax(np.where(crest, drift[upper], -1)))
        row = {"method": method, "nodes": int(upper.sum()), "on lines": float(on.mean()), "crests": int(crest.sum())}
        row |= {"crests on lines": int(on[crest].sum()), "median drift": float(np.median(drift[upper]))}
        row |= {"highest crest": float(drift[upper][best]) if crest.any() else np.nan}
        z = dict(zip(rows["node 2"], rows["h omega 2"], strict=True))
        where = [z.get(round(c[upper][best] * nodes), np.nan) for c in (x, y)]
        out.append(row | {"at": f"({where[0]:.3g}, {where[1]:.3g})" if crest.any() else ""})
    return pd.DataFrame(out)


def _shares(table: pd.DataFrame) -> pd.DataFrame:
    """Compute the share of crests (maxima of the drift) on resonance lines, and its ratio to that of all nodes.

    The table has a row for each method with crests.
    """
    rows = summary_table(table)
    rows = rows[rows["crests"] > 0].set_index("method")
    share = rows["crests on lines"] / rows["crests"]
    return rows.assign(share=share, times=share / rows["on lines"])


@of("extremes_springs")
def on_lines(table: pd.DataFrame) -> Verdict | None:
    """Judge whether every method's maxima of the energy drift, over both frequencies, lie on the lines of resonance."""
    share = _shares(table)["share"]
    if share.empty:
        return None
    return Verdict(
        "The crests of the energy drift lie on the resonance lines of theory",
        Range(share.min(), share.max()),
        at_least(MOST),
        "of a method's crests",
        share.idxmin(),
    )


@of("extremes_springs")
def above_chance(table: pd.DataFrame) -> Verdict | None:
    """Judge whether maxima of the energy drift lie on resonance lines more often than grid points in general."""
    times = _shares(table)["times"]
    if times.empty:
        return None
    least = Range(times.min(), times.max())
    return Verdict(
        "Crests of the energy drift lie on resonance lines more often than by chance",
        least,
        at_least(TIMES),
        "times as often",
        times.idxmin(),
    )


@of("extremes_springs")
def answer(table: pd.DataFrame) -> str | None:
    """Write the page's answer: how many maxima of the drift and what share of all nodes lie on resonance lines."""
    rows = _shares(table)
    if rows.empty:
        return None
    text = f"On a chain with two stiff springs {rows['crests on lines'].sum()} of {rows['crests'].sum()} crests of the"
    text += f" energy drift lie on resonance lines of order ≤ {ORDER}; of all steps"
    return f"{text} {rows['on lines'].min():.0%} to {rows['on lines'].max():.0%} do."


@style.styled
def draw(table: pd.DataFrame, folder: Path) -> Picture:
    """Draw maps of the energy drift over (h omega_1, h omega_2), with resonance lines below the diagonal."""
    methods = list(dict.fromkeys(table["method"]))
    figure, panels = style.panels(2, -(-len(methods) // 2), 4.9)
    for axes, id in zip(panels.flat, methods, strict=False):
        rows = table[table["method"] == id]
        last = rows.drop_duplicates("node 2").sort_values("node 2")
        z, angle = last["h omega 2"].to_numpy(), (last["node 2"] / last["nodes"]).to_numpy()
        drift = np.log10(square(rows))
        axes.set(title=id, aspect="equal")
        if len(z) != len(drift):  # rows are missing: there is no map
            continue
        axes.pcolormesh(
            z, z, drift, cmap="Greys", vmin=np.nanquantile(drift, 0.3), vmax=np.nanmax(drift), shading="nearest"
        )
        _lines(axes, z, angle)
        axes.set(xlim=(z[0], z[-1]), ylim=(z[0], z[-1]))
    for axes in panels[-1]:
        axes.set_xlabel("h ω₁")
    for axes in panels[:, 0]:
        axes.set_ylabel("h ω₂")
    caption = (
        "FPU with two stiff springs: the drift of the energy that a step keeps between resonances, the darker the larger "
        f"(each method on a scale of its own); below the diagonal the resonance lines of theory, red of order {DRAWN}, blue of lower order."
    )
    return Picture(style.save(figure, folder, "extremes-springs.png"), "two stiff springs", caption)


def _lines(axes: Axes, z: np.ndarray, angle: np.ndarray) -> None:
    """Draw the resonance lines below the diagonal; z (h omega) and angle (in pi), arrays (n,), are of the nodes."""
    fine = np.linspace(angle[0], angle[-1], 400)
    colours = {1: style.BLUE, 2: style.BLUE, 3: style.VERMILION, 4: style.GREEN}
    for k1, k2, n in lines(DRAWN, angle[-1]):
        x, y = (fine, (2 * n - k1 * fine) / k2) if k2 else (np.full(len(fine), 2 * n / k1), fine)
        shown = (y <= x) & (y >= angle[0]) & (x <= angle[-1])
        x, y = (np.interp(v[shown], angle, z) for v in (x, y))
        axes.plot(x, y, color=colours[abs(k1) + abs(k2)], linewidth=0.7, linestyle=(0, (4, 3)))


@of("extremes_springs")
def table(rows: pd.DataFrame) -> Table:
    """Make the page's table: for each method how many nodes and maxima of the drift are on resonance lines."""
    shown = summary_table(rows)
    shown["on lines"] = shown["on lines"].map("{:.0%}".format)
    shown["highest crest"] = shown["highest crest"].map(lambda x: "" if pd.isna(x) else number(x, 2))
    caption = (
        f"Nodes of the grid and the share of them on lines; crests, at least {HIGH:g} times as high as two nodes aside; "
        f"the median drift, and the highest crest with its (h ω₁, h ω₂), of the energy ({TOP:g}: as much, or more)."
    )
    return Table(shown, caption)


@of("extremes_springs")
def full_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Select for each method the grid nodes with the largest energy drift."""
    return rows.sort_values("drift", ascending=False).groupby("method", sort=False).head(SHOWN)


@of("extremes_springs")
def figures(rows: pd.DataFrame, folder: Path) -> list[Picture]:
    """Draw the maps of the energy drift, as a list of one picture."""
    return [draw(rows, folder)]


PAGE = Page(
    id="extremes-springs",
    question="Do step-size resonances lie where theory has them?",
    tables=("extremes_springs",),
    setting=(
        "[FPU](problems.md) with two stiff springs of frequencies ω₁ and ω₂, each with the energy 1 at first: "
        f"H = |p|² / 2 + (ω₁² q₁₁² + ω₂² q₁₂²) / 2 + quartic soft springs, h = {springs.H:g}.",
        f"On a spring alone a step turns by θ(h ω), 2 cos θ = tr M. On the lines k₁ θ₁ + k₂ θ₂ = 2πn, n ≠ 0, of order |k₁| + |k₂| ≤ {ORDER} errors add up from step to step.",
        f"Grid: θ at multiples of π / N, N = {' or '.join(map(str, sorted({*springs.NODES.values()})))}, which lines of low order meet exactly; h ω up to {springs.LAST:g} or the stability limit.",
        f"Drift: the largest change of the mean energy over {springs.WINDOWS} windows, with J θ / h for the springs, J the action that M keeps; the problem's own exchange (n = 0) keeps it.",
        f"A crest is at least {HIGH:g} times as high as the nodes two aside, along a row, a column or a diagonal; it is on a line within {NEAR:g} of a node.",
    ),
    verdicts=(on_lines, above_chance),
    answer=answer,
    figures=figures,
    table=table,
    whole=full_table,
    limits=(
        "Nodes are on lines of low order exactly: a narrow resonance of a higher order that meets no node is not seen.",
        "The slow motion shifts and splits a resonance by h times its frequency, here less than a node.",
        "A method without a crest shows no resonance over so many steps, and is not judged.",
        "What a crest is, and how near a line it must lie, were chosen on an earlier run of these maps: therefore nodes by chance are counted too.",
        "Where the drift of a method is large everywhere, as for order 1, weak resonances drown in it.",
    ),
    command="pytest benchmarks/experiments/extremes",
    listed=False,
)
