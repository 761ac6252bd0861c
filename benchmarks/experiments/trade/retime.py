"""Time the stored finalists of a scene again, later and in another process.

Finalists are the few fastest integrators at an accuracy.  The runs repeat their stored steps and tolerances, without a
search.  The pages join the first and the second timing (`settled`); the third shows how often the intervals from these
two contain a new time.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

from phasebench.benchmarks.ladder.final import rounds
from phasebench.benchmarks.ladder.rung import Task
from phasebench.benchmarks.measure import clock, timing
from phasebench.benchmarks.measure.named_quantities import quantity
from phasebench.benchmarks.problems.questions import BY_ID
from phasebench.benchmarks.store import tables
from phasebench.benchmarks.store.cells import Rows

from .field import competitors
from .front import FINAL, FINALS

TABLE = "front_times"
#: The sweeps after the first; the last one checks the intervals from the others.
SWEEPS = (2, 3)
#: Folder of the stored finals of the first sweep.
DATA = Path(__file__).resolve().parents[3] / "reports" / "data"
#: A final: accuracy, side, label, steps or None, tolerance or None, seconds in the first sweep.
Final = tuple[float, str, str, int | None, float | None, float]


@cache
def _stored_finals(folder: Path) -> dict[str, tuple[Final, ...]]:
    out: dict[str, list[Final]] = {}
    for row in tables.Table(folder, FINALS).rows:
        steps = round(BY_ID[row["scene"]].t_end / float(row["h"])) if row["h"] else None
        tol = float(row["tol"]) if row["tol"] else None
        line = (float(row["accuracy"]), row["side"], row["integrator"], steps, tol, float(row["seconds"]))
        out.setdefault(row["scene"], []).append(line)
    return {scene: tuple(lines) for scene, lines in out.items()}


def finals(scene: str, folder: Path = DATA) -> tuple[Final, ...]:
    """Read the stored finalists of a scene: its fastest integrators at each accuracy; empty if it was not measured.

    Each is (accuracy, side, label, number of steps or None, tolerance or None, seconds).
    """
    return _stored_finals(folder).get(scene, ())


def measure_rows(scene: str, sweep: int, stored: tuple[Final, ...]) -> Rows:
    """Time the stored finalists of a scene again, in turns at each accuracy; ``sweep`` is the number of this timing.

    ``stored`` are the `finals` of the scene: its few fastest integrators with their steps and tolerances.  Returns
    {`TABLE`: rows}, for each finalist the median seconds with their interval.
    """
    question, by_label = BY_ID[scene], {c.label: c for c in competitors()}
    made = question.build_problem()
    task = Task(made, question.t_end, quantity(made, question.quantity))
    rows = []
    for accuracy in dict.fromkeys(line[0] for line in stored):
        members = [line for line in stored if line[0] == accuracy]
        task.clocks.sharing = sharing = clock.Sharing()
        sizes = ({"tol": tol} if steps is None else {"steps": steps} for *_, steps, tol, _ in members)
        work = {k: task.timer(by_label[m[2]], size) for k, (m, size) in enumerate(zip(members, sizes, strict=True))}
        found = timing.in_turns(work, rounds((line[-1] for line in members), *FINAL))
        for k, (_, side, label, *_) in enumerate(members):
            told = timing.median(found[k])
            row = {"scene": scene, "sweep": sweep, "accuracy": accuracy, "side": side, "integrator": label}
            row |= {"seconds": told.value, "low": told.low, "high": told.high, "disturbed": sharing.disturbed}
            rows.append(row)
    return {TABLE: rows}
