"""Error against time: which integrator for which accuracy."""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks.measure.timing import NONE, OPEN, OURS, PEERS, TIED
from phasebench.benchmarks.page import style
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, Verdict

from . import ladders, sweep
from .choice import TIE, choices, frontier, long_rows, of_all
from .ladders import ACCURACIES

#: The scene of the work-precision diagram, where it was measured, and its curves at most: ours, the peers'.
SCENE = "perturbed-kepler-t1000"
CURVES = {True: 5, False: 4}
#: Errors are drawn no smaller.
FLOOR = 1e-16


@of_all
def wins(rows: pd.DataFrame) -> Verdict | None:
    """Who is the cheaper how often."""
    found = choices(rows)
    if found.empty:
        return None
    count = found["cheaper"].value_counts()
    ours, peers, tied, open_, none = (int(count.get(w, 0)) for w in (OURS, PEERS, TIED, OPEN, NONE))
    text = (
        f"Of {len(found)} pairs of a long scene and an accuracy one of this project's methods is cheapest in {ours}, "
    )
    text += f"a peer in {peers}, {tied} {'is a tie' if tied == 1 else 'are ties'}"
    text += f", {open_} {'is' if open_ == 1 else 'are'} not decided" if open_ else ""
    text += f", and {none} {'is' if none == 1 else 'are'} reached by none" if none else ""
    return Verdict(
        f"{text}.",
        ours >= peers,
        f"Cheapest on long scenes: ours {ours}, a peer {peers}, ties {tied}, not decided {open_} of {len(found)}.",
    )


@of_all
def largest(rows: pd.DataFrame) -> Verdict | None:
    """Where the two sides are farthest apart."""
    found = choices(rows)
    if found.empty:
        return None
    both = found[
        (found["cheaper"] != OPEN) & np.isfinite(found[f"{OURS} seconds"]) & np.isfinite(found[f"{PEERS} seconds"])
    ]
    if both.empty:
        return None
    ratio = both[f"{PEERS} seconds"] / both[f"{OURS} seconds"]
    parts = []
    for who, k, factor in ((OURS, ratio.idxmax(), ratio.max()), (PEERS, ratio.idxmin(), 1 / ratio.min())):
        if factor > TIE:
            r = both.loc[k]
            other = PEERS if who == OURS else OURS
            at = f"{r['scene']} to {r['error up to']:g}"
            parts.append(f"on {at} {r[who]} takes {number(1 / factor, 2)} of the time of {r[other]}")
    if not parts:
        return None
    text = f"Farthest apart: {'; '.join(parts)}."
    return Verdict(text, True, text)


def _work_precision(rows: pd.DataFrame, folder) -> Picture | None:
    """Error at the end against seconds on one scene, all curves on the same axes."""
    part = long_rows(rows)
    if part.empty:
        return None
    scene = SCENE if SCENE in set(part["scene"]) else part["scene"].iloc[0]
    part = part[part["scene"] == scene]
    own = part["kind"] == sweep.KIND if "kind" in part else pd.Series(True, part.index)
    with style.settings():
        figure, ((axes,),) = style.panels(1, 1, 4.2)
        looks = iter(style.looks())
        for side, most in CURVES.items():
            members = part[own == side]
            for method in frontier(members, most):
                curve = members[members["method"] == method].sort_values("seconds")
                fill = {} if side else {"markerfacecolor": "white"}
                label = method if side else f"{method} (peer)"
                axes.loglog(
                    curve["seconds"], curve["global_error"].clip(lower=FLOOR), label=label, **next(looks) | fill
                )
        style.plain_ticks(axes.xaxis)
        axes.set(xlabel="warm integration (s)", ylabel="error at the end, maximum norm over (q, p)", title=scene)
        axes.grid(color="0.93", linewidth=0.5)
        style.legend_above(figure, axes, 3)
    caption = (
        f"Error at the end of {scene} against seconds: of each side the methods that are cheapest for some error; filled "
        "marks ours, white marks peers."
    )
    return Picture(style.save(figure, folder, "trade.png"), "error against time", caption)


def _dumbbells(rows: pd.DataFrame, folder) -> Picture | None:
    """The seconds of the cheapest of each side, a line for each scene and accuracy."""
    found = choices(rows)
    if found.empty:
        return None
    y = np.arange(len(found)) + 0.6 * found["scene"].ne(found["scene"].shift()).cumsum()
    with style.settings():
        figure, ((axes,),) = style.panels(1, 1, 1.1 + 0.19 * len(found))
        pairs = found[[f"{OURS} seconds", f"{PEERS} seconds"]].replace(np.inf, np.nan)
        axes.hlines(y, pairs.min(axis=1), pairs.max(axis=1), color=style.GREY, linewidth=1)
        for who, k, label in ((OURS, 0, "cheapest of phasebench"), (PEERS, 1, "cheapest peer")):
            colour, _, marker = style.CURVES[k]
            axes.semilogx(pairs[f"{who} seconds"], y, marker, color=colour, label=label, markersize=5)
        open_ = found["cheaper"] == OPEN
        white = {"color": "white", "markeredgecolor": style.CURVES[1][0], "markersize": 5, "label": "peer, not decided"}
        axes.semilogx(pairs[f"{PEERS} seconds"][open_], y[open_], style.CURVES[1][2], **white)
        axes.set_yticks(
            y, [f"{r.scene}, {r.accuracy:g}" for r in found.rename(columns={"error up to": "accuracy"}).itertuples()]
        )
        axes.invert_yaxis()
        axes.set_xlabel("warm integration (s)")
        axes.grid(axis="x", color="0.93", linewidth=0.5)
        style.legend_above(figure, axes, 3)
    caption = (
        "Seconds of the cheapest integration whose end state has at most the error named on the left. White: a faster peer "
        "was not run tightly enough to tell."
    )
    return Picture(style.save(figure, folder, "cheapest.png"), "the cheapest for an accuracy", caption)


@of_all
def draw(rows: pd.DataFrame, folder) -> list[Picture]:
    """The cheapest of each side, and the work-precision diagram."""
    return [p for p in (_dumbbells(rows, folder), _work_precision(rows, folder)) if p is not None]


@of_all
def table(rows: pd.DataFrame) -> Table | None:
    """The cheapest of each side for every scene and accuracy."""
    found = choices(rows)
    if found.empty:
        return None
    shown = pd.DataFrame(
        {
            "scene": found["scene"],
            "error up to": [f"{x:.0e}" for x in found["error up to"]],
            "cheapest of phasebench": found[OURS],
            "ms": [number(1e3 * x) if np.isfinite(x) else "" for x in found[f"{OURS} seconds"]],
            "cheapest peer": found[PEERS],
            "its ms": [number(1e3 * x) if np.isfinite(x) else "" for x in found[f"{PEERS} seconds"]],
            "cheaper": found["cheaper"],
        }
    )
    caption = (
        "The cheapest integration on each long scene whose state at the end is in error by at most so much (maximum norm "
        f"over q and p): warm seconds, without output; times within a factor of {TIE} are a tie. Not decided: an adaptive peer that was not run tightly enough to reach "
        "the error took less time where it stopped."
    )
    return Table(shown.head(ROWS), caption)


@of_all
def _whole(rows: pd.DataFrame) -> pd.DataFrame | None:
    """Of every method and scene the row of the least error."""
    part = long_rows(rows)
    if part.empty:
        return None
    best = part.loc[part.groupby(["scene", "method"], sort=False)["global_error"].idxmin()]
    names = {"scene": "scene", "method": "method", "h": "h", "tol": "tolerance", "global_error": "error"}
    return best.reindex(columns=[*names, "seconds"]).rename(columns=names).sort_values(["scene", "seconds"])


PAGE = Page(
    id="trade",
    question="Which integrator is the cheapest for a given accuracy?",
    tables=("rows", ladders.TABLE),
    setting=(
        "Long scenes: pendulum, perturbed Kepler and Hénon–Heiles (box) to t = 1000, Kepler over 100 orbits, "
        "Lotka–Volterra to t = 120; the chaotic orbit is left out, whose end state no reference certifies.",
        "Error: max |y_h(t_end) − y(t_end)| over q and p, against a certified Taylor solution.",
        "Peers: heyoka (with high_accuracy and without), REBOUND's integrators and SciPy's (compiled with Numba where so "
        f"named): adaptive ones at tolerances from {ladders.TOLERANCES[0]:g} to {ladders.TOLERANCES[-1]:g}.",
        f"Steps: from a scene's widest on wider by factors of {ladders.FACTOR} while the error is of use, finer for methods "
        f"of order above {sweep.HIGH}; a ladder ends below {ACCURACIES[-1]:g} or with a run of {ladders.LONGEST:g} s.",
        "Times: warm, the integration alone, without output; medians of three runs, one integrator after another.",
    ),
    verdicts=(wins, largest),
    figures=draw,
    table=table,
    whole=_whole,
    limits=(
        f"Accuracies are {', '.join(f'{x:g}' for x in ACCURACIES)}; times within a factor TIE = {TIE} are a tie, since they "
        "are not taken in turns.",
        f"A step between two of a ladder, a factor of {ladders.FACTOR} apart, or a tolerance between two, a factor of ten "
        "apart, might just do.",
        "heyoka-batch carries the same orbit in every lane: its time is of all lanes, as long as one orbit takes that way.",
        "IAS15 runs in its default adaptive mode; the Kepler page compares the others.",
    ),
    command="pytest benchmarks/experiments/trade",
)
