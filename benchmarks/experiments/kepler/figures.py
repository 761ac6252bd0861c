"""Figures of the Kepler comparison: errors over the number of orbits, and work-precision diagrams."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from phasebench.benchmarks import style

#: Errors below this are drawn at it.
FLOOR = 1e-16
QUANTITIES = {
    "energy": "energy",
    "momentum": "ang. momentum",
    "phase": "phase (rad)",
    "perihelion": "perihelion (rad)",
}


def errors(rows: pd.DataFrame, names: list[str], directory: Path, name: str) -> str:
    """Draw errors in energy, angular momentum, phase and perihelion over the orbits; return the file's name.

    The figure has a row of panels for each quantity, a column for each eccentricity, and a curve for each method.

    Parameters
    ----------
    rows : DataFrame with the columns e, method, orbits, energy, momentum, phase, perihelion
    names : the methods to draw, in order
    directory, name : where the figure is written
    """
    columns = sorted(rows["e"].unique())
    with style.settings():
        figure, axes = style.panels(len(QUANTITIES), len(columns), 7.6, sharex=True, sharey="row")
        for k, (quantity, label) in enumerate(QUANTITIES.items()):
            row = axes[k]
            for ax, e in zip(row, columns, strict=True):
                part = rows[rows["e"] == e]
                for i, method in enumerate(names):
                    curve = part[part["method"] == method].sort_values("orbits")
                    y = curve[quantity].clip(lower=FLOOR)
                    ax.plot(curve["orbits"], y, label=method, **style.curve(i))
                ax.set(xscale="log", yscale="log")
                ax.grid(color="0.9", linewidth=0.5)
                if not np.isfinite(part[quantity]).any():
                    ax.text(0.5, 0.5, "undefined\non a circle", transform=ax.transAxes, ha="center", va="center")
                if k == 0:
                    ax.set_title(f"e = {e:g}")
                if k == len(QUANTITIES) - 1:
                    ax.set_xlabel("orbits")
            row[0].set_ylabel(label)
            low, high = (np.log10(y) for y in row[0].get_ylim())
            step = max(1, int(np.ceil((high - low) / 6)))
            row[0].set_yticks(10.0 ** np.arange(np.ceil(low), high + 1e-9, step))
            row[0].minorticks_off()
        handles = [axes[0][0].plot([], [], label=m, **style.curve(i))[0] for i, m in enumerate(names)]
        figure.legend(handles=handles, loc="outside upper center", ncols=3, handlelength=3.4)
        figure.align_ylabels()
    return style.save(figure, directory, name)


def work_precision(rows: pd.DataFrame, directory: Path, name: str = "kepler-cost.png") -> tuple[str, int]:
    """Draw the error at the end over the seconds of a warm run, for our methods and those of other packages.

    ``rows`` is a DataFrame with the columns problem, method, kind, seconds and error; there is a panel for each
    problem. Returns (file's name, number of curves).
    """
    ours = rows[rows["kind"] == "phasebench"]
    peers = rows[rows["kind"] != "phasebench"]
    shown = [*frontier(ours, 4), *frontier(peers, 3)]
    shown += [m for m in ("stormer-verlet", "scipy-dop853-numba") if m in set(rows["method"]) and m not in shown]
    problems = list(dict.fromkeys(rows["problem"]))
    with style.settings():
        figure, axes = style.panels(1, len(problems), 3.6, sharex=True, sharey=True)
        for ax, problem in zip(axes[0], problems, strict=True):
            for i, method in enumerate(shown):
                curve = rows[(rows["problem"] == problem) & (rows["method"] == method)].sort_values("seconds")
                ax.loglog(
                    curve["seconds"],
                    curve["error"].clip(lower=FLOOR),
                    label=method,
                    **style.curve(i),
                )
            ax.set(title=problem, xlabel="warm integration (s)")
            ax.grid(color="0.93", linewidth=0.5)
        axes[0][0].set_ylabel("error at the end, maximum norm")
        style.legend_above(figure, axes[0][0], 3)
    return style.save(figure, directory, name), len(shown)


def frontier(rows: pd.DataFrame, most: int) -> list[str]:
    """Return the methods that are the fastest at some error, at most ``most``: first the one with the most such errors.

    ``rows`` has the columns method, error and seconds; the errors compared are 25 values from 1e-13 to 0.1.
    """
    wins: dict[str, int] = {}
    for wanted in np.logspace(-13, -1, 25):
        enough = rows[rows["error"] <= wanted]
        if len(enough):
            best = enough.loc[enough["seconds"].idxmin(), "method"]
            wins[best] = wins.get(best, 0) + 1
    return sorted(wins, key=lambda name: -wins[name])[:most]
