"""The finals of a scene timed again, in another process and later: sweeps after the first.

The runs are those of the stored finals, at their steps and tolerances; nothing is searched for.  What stands on a page
joins the first sweep with the second (`settled`), and the third shows how often the intervals of these two hold it.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

from phasebench.benchmarks.measure import clock, timing
from phasebench.benchmarks.problems.questions import BY_ID
from phasebench.benchmarks.rows import tables
from phasebench.benchmarks.rows.cells import Rows

from .field import competitors
from .front import FINALS, rounds

TABLE = "front_times"
#: The sweeps besides the first; the last is the check of what is told of the others.
SWEEPS = (2, 3)
#: Where the finals of the first sweep are stored.
DATA = Path(__file__).resolve().parents[3] / "reports" / "data"
#: What a final is found by: accuracy, side, label, steps or None, tolerance or None, seconds in the first sweep.
Final = tuple[float, str, str, int | None, float | None, float]


@cache
def _stored(folder: Path) -> dict[str, tuple[Final, ...]]:
    out: dict[str, list[Final]] = {}
    for row in tables.Table(folder, FINALS).rows:
        steps = round(BY_ID[row["scene"]].t_end / float(row["h"])) if row["h"] else None
        tol = float(row["tol"]) if row["tol"] else None
        line = (float(row["accuracy"]), row["side"], row["integrator"], steps, tol, float(row["seconds"]))
        out.setdefault(row["scene"], []).append(line)
    return {scene: tuple(lines) for scene, lines in out.items()}


def finals(scene: str, folder: Path = DATA) -> tuple[Final, ...]:
    """The finals of a scene as they are stored; none where the scene was not measured."""
    return _stored(folder).get(scene, ())


def measured(scene: str, sweep: int, stored: tuple[Final, ...]) -> Rows:
    """The seconds of every final of a scene, each accuracy in turns."""
    question = BY_ID[scene]
    made, by_label = question.made(), {c.label: c for c in competitors()}
    prepared: dict[tuple, Any] = {}
    rows = []
    for accuracy in dict.fromkeys(line[0] for line in stored):
        members = [line for line in stored if line[0] == accuracy]
        sharing = clock.Sharing()
        work = {}
        for k, (_, _, label, steps, tol, _) in enumerate(members):
            if (label, tol) not in prepared:
                prepared[label, tol] = by_label[label].prepare(made, tol=tol)
            size = {"t_end": question.t_end, "steps": steps, "tol": tol}
            work[k] = clock.clock(by_label[label], made, **size, run=prepared[label, tol], sharing=sharing)
        found = timing.in_turns(work, rounds(sum(line[-1] for line in members)))
        for k, (_, side, label, *_) in enumerate(members):
            told = timing.median(found[k])
            row = {"scene": scene, "sweep": sweep, "accuracy": accuracy, "side": side, "integrator": label}
            row |= {"seconds": told.value, "low": told.low, "high": told.high, "disturbed": sharing.disturbed}
            rows.append(row)
    return {TABLE: rows}
