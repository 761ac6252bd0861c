"""The figure of the audit: measured minus claimed orders, one line for each package."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from phasebench.benchmarks import style
from phasebench.benchmarks.judge.evidence import GATE
from phasebench.benchmarks.judge.verdict import CONTRADICTED, UNJUDGED

#: What a claim is called in the figure, by its verdict.
HELD, OTHERS = "claim holds", {CONTRADICTED: "claim contradicted", UNJUDGED: "claim not judged"}
#: Differences beyond this are drawn at the edge.
SHOWN = 3.2


def orders(rows: list[dict], claims: list[dict], directory: Path, name: str = "audit.png") -> str | None:
    """Draw measured minus claimed orders, from the rows and claims of an audit, and save the figure in ``directory``.

    Returns its file name, or None if there are no orders.
    """
    claimed = {c["peer"]: c for c in claims if c["property"] == "order"}
    seen = [
        r | {"apart": r["value"] - float(claimed[r["peer"]]["claim"].split()[-1])}
        for r in rows
        if r["measure"] == "order" and r["status"] == "ok" and r.get("value") is not None and r["peer"] in claimed
    ]
    if not seen:
        return None
    packages = list(dict.fromkeys(r["package"] for r in seen))
    with style.settings():
        figure, ((axes,),) = style.panels(1, 1, 1.1 + 0.32 * len(packages))
        axes.axvspan(-GATE, GATE, color="0.9")
        for k, label in enumerate((HELD, *OTHERS.values())):
            part = [r for r in seen if OTHERS.get(claimed[r["peer"]]["verdict"], HELD) == label]
            index = {p: [r["peer"] for r in seen if r["package"] == p] for p in packages}
            y = [packages.index(r["package"]) + _offset(index[r["package"]], r["peer"]) for r in part]
            look = {"color": style.CURVES[k][0], "marker": style.CURVES[k][2], "linestyle": "none"}
            axes.plot(np.clip([r["apart"] for r in part], -SHOWN, SHOWN), y, label=label, markersize=4, **look)
        axes.set_yticks(range(len(packages)), packages)
        axes.set_ylim(len(packages) - 0.5, -0.5)
        axes.set_xlabel("measured − claimed order")
        axes.grid(axis="x", color="0.93", linewidth=0.5)
        style.legend_above(figure, axes, 3)
    return style.save(figure, directory, name)


def _offset(peers: list[str], peer: str) -> float:
    """Vertical offset of a peer's mark within its package's line of the figure; ``peers``: all of that package."""
    names = list(dict.fromkeys(peers))
    return 0.6 * (names.index(peer) / max(1, len(names) - 1) - 0.5)
