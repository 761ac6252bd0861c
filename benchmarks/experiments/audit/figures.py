"""The figure of the audit: the measured orders less the claimed ones (in parentheses), with their intervals."""

from __future__ import annotations

from pathlib import Path

from phasebench.benchmarks.page import style

from .judge import GATE

#: Differences beyond stand at the edge, with their value.
SHOWN = 3.2
#: Inches a line and around the lines.
LINE, AROUND = 0.14, 0.9
#: More integrators than this stand in two columns.
MOST = 40


def orders(rows: list[dict], claims: list[dict], directory: Path, name: str = "audit-orders.png") -> str | None:
    """Draw it from the rows and claims of an audit; returns the file's name in ``directory``, None without orders."""
    claimed = {c["peer"]: float(c["claim"].split()[-1]) for c in claims if c["property"] == "order"}
    seen = [
        r
        for r in rows
        if r["measure"] == "order" and r["status"] == "ok" and r.get("value") is not None and r["peer"] in claimed
    ]
    if not seen:
        return None
    peers = list(dict.fromkeys(r["peer"] for r in seen))
    problems = list(dict.fromkeys(r["problem"] for r in seen))
    with style.settings():
        columns = 1 if len(peers) <= MOST else 2
        lines = -(-len(peers) // columns)
        figure, axes = style.panels(1, columns, AROUND + LINE * lines, sharex=True)
        widest = min(SHOWN, max(0.3, *(abs(r["value"] - claimed[r["peer"]]) for r in seen))) + 0.3
        for column, ax in enumerate(axes[0]):
            here = peers[column * lines : (column + 1) * lines]
            ax.axvspan(-GATE, GATE, color="0.9")
            for k, problem in enumerate(problems):
                part = [r for r in seen if r["problem"] == problem and r["peer"] in here]
                y = [here.index(r["peer"]) + 0.2 * (k % 3 - 1) for r in part]
                apart = [r["value"] - claimed[r["peer"]] for r in part]
                x = [min(max(a, -SHOWN), SHOWN) for a in apart]
                for a, xx, yy in zip(apart, x, y, strict=True):
                    if a != xx:
                        side = "left" if a < 0 else "right"
                        ax.annotate(f"{a:+.1f}", (xx, yy), (0, 4), textcoords="offset points", ha=side, fontsize=5)
                bars = [[max(r["value"] - r["low"], 0) for r in part], [max(r["high"] - r["value"], 0) for r in part]]
                colour, _, marker = style.CURVES[k % len(style.CURVES)]
                ax.errorbar(x, y, xerr=bars, color=colour, marker=marker, linestyle="", markersize=3, label=problem)
            ax.set_yticks(range(len(here)), [f"{p} ({claimed[p]:g})" for p in here], fontsize=6)
            ax.set_ylim(lines - 0.4, -0.6)
            ax.set_xlim(-widest, widest)
            ax.set_xlabel("measured less claimed order")
            ax.grid(axis="x", color="0.9", linewidth=0.5)
        style.legend_above(figure, axes[0][0], 3)
    return style.save(figure, directory, name)
