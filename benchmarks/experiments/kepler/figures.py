"""Figures of the Kepler comparison, from measured rows: errors over orbits, and work-precision diagrams."""

from __future__ import annotations

from pathlib import Path

from phasebench.benchmarks.page import style

#: The curves of one panel, each of its own colour, line and marker.
LOOKS = (*style.CURVES, (style.GREY, (0, (3, 1)), "*"))
#: Errors below these are drawn on them: the round-off of the state, of an angle of some radians.
FLOOR = 1e-16
QUANTITIES = {
    "energy": "energy",
    "momentum": "ang. momentum",
    "phase": "phase (rad)",
    "perihelion": "perihelion (rad)",
}


def _look(i: int) -> dict:
    return dict(zip(("color", "linestyle", "marker"), LOOKS[i % len(LOOKS)], strict=True))


def errors(rows, names: dict[str, str], directory: Path, name: str) -> str:
    """The four errors against the number of orbits, a column for each eccentricity; returns the file's name.

    Parameters
    ----------
    rows : DataFrame with the columns e, method, orbits, energy, momentum, phase, perihelion
    names : the methods to draw, in order, and how the legend calls them
    directory, name : where the figure goes
    """
    import numpy as np

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
                    ax.plot(curve["orbits"], y, label=names[method], **_look(i))
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
        handles = [axes[0][0].plot([], [], label=names[m], **_look(i))[0] for i, m in enumerate(names)]
        figure.legend(handles=handles, loc="outside upper center", ncols=3, handlelength=3.4)
        figure.align_ylabels()
    return style.save(figure, directory, name)


def work_precision(rows, problem: str, directory: Path) -> str:
    """Error at the end against warm seconds, this project's methods on the left and its peers on the right.

    ``rows`` is a DataFrame with the columns method, kind, seconds and error; returns the file's name in ``directory``.
    """
    with style.settings():
        figure, axes = style.panels(1, 3, 3.8, sharex=True, sharey=True)
        ours = rows[rows["kind"] == "phasebench"]
        names = list(dict.fromkeys(ours["method"]))
        half = -(-len(names) // 2)
        parts = [
            ("phasebench", ours, names[:half]),
            ("phasebench, continued", ours, names[half:]),
            ("established", rows[rows["kind"] != "phasebench"], None),
        ]
        for ax, (title, part, chosen) in zip(axes[0], parts, strict=True):
            for i, name in enumerate(chosen if chosen is not None else list(dict.fromkeys(part["method"]))):
                curve = part[part["method"] == name].sort_values("seconds")
                ax.loglog(curve["seconds"], curve["error"].clip(lower=FLOOR), label=name, **_look(i))
            ax.set_title(title)
            ax.set_xlabel("warm integration (s)")
            ax.grid(color="0.9", linewidth=0.5)
            ax.legend(fontsize=6.5, loc="upper center", bbox_to_anchor=(0.5, -0.2), handlelength=2.6)
        axes[0][0].set_ylabel("error at the end, maximum norm")
    return style.save(figure, directory, f"work-precision-{problem.replace(':', '-')}.png")
