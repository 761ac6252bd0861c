"""Figures drawn from measured rows: the work-precision diagrams of a report's pages."""

from __future__ import annotations

from pathlib import Path

from . import style

#: The curves of one panel, each of its own colour, line and marker.
LOOKS = (*style.CURVES, (style.GREY, (0, (3, 1)), "*"))
FLOOR = 1e-16


def work_precision(rows, problem: str, directory: Path) -> str:
    """Error at the end against warm seconds, this project's methods on the left and its peers on the right.

    ``rows`` is a DataFrame with the columns method, kind, seconds and error; returns the file's name in ``directory``.
    """
    import matplotlib

    with matplotlib.rc_context(dict(matplotlib.rcParamsDefault) | style.RC | {"backend": "agg"}):
        figure, axes = style.panels(1, 3, 3.6, sharex=True, sharey=True)
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
                look = dict(zip(("color", "linestyle", "marker"), LOOKS[i % len(LOOKS)], strict=True))
                ax.loglog(curve["seconds"], curve["error"].clip(lower=FLOOR), label=name, **look)
            ax.set_title(title)
            ax.set_xlabel("warm integration (s)")
            ax.grid(color="0.9", linewidth=0.5)
            ax.legend(fontsize=6.5, loc="upper center", bbox_to_anchor=(0.5, -0.2), handlelength=2.6)
        axes[0][0].set_ylabel("error at the end, maximum norm")
        name = f"work-precision-{problem.replace(':', '-')}.png"
        Path(directory).mkdir(parents=True, exist_ok=True)
        style.write(figure, Path(directory) / name)
    return name
