"""The figures on the fastest integrators: ratios of times over all scenes, and a scene's work-precision diagram."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.measure.timing import OURS, PEERS
from phasebench.benchmarks.page.page import Picture
from phasebench.benchmarks.problems.questions import Question

from .choice import SAME, SHOWN, at, counts, integrators_to_draw

if TYPE_CHECKING:
    from pathlib import Path

#: Largest number of curves of each side in a work-precision diagram.
CURVES = {OURS: 5, PEERS: 4}
#: Ratio at which colours are saturated; smaller errors than `FLOOR` are drawn at `FLOOR`.
SATURATED, FLOOR = 8.0, 1e-16


@style.styled
def ratios(found: pd.DataFrame, folder: Path) -> Picture:
    """Draw a coloured square for each scene and accuracy: this project's best time over the best peer's.

    ``found`` has a row for each scene and accuracy; peers are other packages' integrators.
    """
    from matplotlib.colors import LinearSegmentedColormap

    scenes = list(dict.fromkeys(found["scene"]))
    decades = [10.0**-k for k in range(1, 14)]
    field = np.full((len(scenes), len(decades)), np.nan)
    for row in found.to_dict("records"):
        k = int(np.argmin([abs(np.log10(a / row["accuracy"])) for a in decades]))
        if abs(decades[k] / row["accuracy"] - 1) < SAME:
            field[scenes.index(row["scene"]), k] = _ratio(row)
    figure, ((axes,),) = style.panels(1, 1, 1.2 + 0.2 * len(scenes))
    colours = LinearSegmentedColormap.from_list("sides", [style.BLUE, "#ffffff", style.VERMILION])
    most = np.log2(SATURATED)
    axes.imshow(np.log2(field.clip(1 / SATURATED, SATURATED)), cmap=colours, vmin=-most, vmax=most, aspect="auto")
    for (i, k), x in np.ndenumerate(field):
        if not np.isnan(x):
            label = {0.0: "ours", np.inf: "peer"}.get(x, style.number(x, 2))
            dark = abs(np.log2(x)) > 0.6 * most if 0 < x < np.inf else True
            axes.text(k, i, label, ha="center", va="center", fontsize=8, color="white" if dark else "black")
    axes.set_yticks(range(len(scenes)), scenes)
    axes.set_xticks(range(len(decades)), [f"1e-{k}" for k in range(1, 14)])
    axes.xaxis.tick_top()
    axes.set_xlabel("error up to")
    axes.xaxis.set_label_position("top")
    scores = {accuracy: counts(at(found, accuracy)) for accuracy in SHOWN}
    told = "; ".join(f"{ours}, {peers} and {tied} at {a:g}" for a, (ours, peers, tied, _) in scores.items())
    caption = (
        "Our best time over the best peer's. Blue: ours is faster; red: a peer; ours or peer: only that side "
        f"reaches the error. Scenes won by ours, by a peer, tied: {told}."
    )
    return Picture(style.save(figure, folder, "trade.png"), "time of ours over the best peer's", caption)


def _ratio(row: dict) -> float:
    there = [isinstance(row.get(f"{side} integrator"), str) for side in (OURS, PEERS)]
    if all(there):
        return row["ratio"]
    return 0.0 if there[0] else np.inf if there[1] else np.nan


@style.styled
def work_precision(question: Question, finals: pd.DataFrame, rungs: pd.DataFrame, folder: Path) -> Picture:
    """Draw a scene's work-precision diagram: errors over seconds and over steps, a curve for each integrator.

    ``finals`` has the integrators timed at each accuracy; on each side, this project's and other packages', those that
    are the fastest most often are drawn.  ``rungs`` has their runs, at ever smaller steps or tolerances.
    """
    figure, (panels,) = style.panels(1, 2, 3.6, sharey=True)
    looks = iter(style.looks())
    for side, most in CURVES.items():
        for name in integrators_to_draw(finals, side, most):
            curve = rungs[(rungs["integrator"] == name) & (rungs["error"] > 0)]
            fill = {} if side == OURS else {"markerfacecolor": "white"}
            look = next(looks) | fill
            label = name if side == OURS else f"{name} (peer)"
            for axes, column in zip(panels, ("seconds", "steps"), strict=True):
                axes.loglog(curve[column], curve["error"].clip(lower=FLOOR), label=label, **look)
    front = finals.loc[finals.groupby("accuracy")["seconds"].idxmin()].sort_values("accuracy")
    panels[0].loglog(front["seconds"], front["accuracy"], color="black", linewidth=4, alpha=0.15, label="the front")
    panels[0].set(xlabel="warm integration (s)", ylabel=f"error ({question.quantity})")
    panels[1].set(xlabel="steps")
    for axes in panels:
        axes.grid(color="0.93", linewidth=0.5)
        axes.set_ylim(FLOOR, 10 * max(question.accuracies))
    style.legend_above(figure, panels[0], 3)
    caption = (
        f"Error of {question.id} over the seconds of a warm run without output, and over its steps: the integrators of "
        "each side that are its fastest at most errors. Filled marks: ours; white: peers; grey: the fastest of all."
    )
    return Picture(style.save(figure, folder, f"trade-{question.id}.png"), question.about, caption)
