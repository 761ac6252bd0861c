r"""The time of an integrator on fronts of the trade, told through a method that ran there and is run again here.

.. math::
    \frac{T}{T_\text{fastest}} = \frac{T}{T_\text{ref}}\Big|_\text{here} \cdot
    \frac{T_\text{ref}}{T_\text{fastest}}\Big|_\text{in the trade}

The first factor is of runs in turns, in seconds of the processor for this process: who shares the machine is not in
them, and what a step lets others compute is not either (a peer tells its own seconds).  T is taken to grow with the
evaluations, of which `place` tells how many an error needs.  The second factor is stored in `times.csv`, made from the
rows of the trade: a ratio on one machine, where runs of microseconds have a call's cost in them.
Told in this way, the reference's own times were 0.58 to 1.01 times what its runs in the trade say (on kepler-orbit and
double-pendulum-chaotic), the least for errors of 1e-2: so a factor of 2 is left open.

A step that Python calls carries what Python costs: how much that is of an evaluation tells a Runge-Kutta step that is
called in the same way, beside the compiled reference.
"""

from __future__ import annotations

import csv
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from math import inf, isfinite
from pathlib import Path
from typing import Any, NamedTuple

from phasebench.benchmarks.measure import timing
from phasebench.benchmarks.measure.compilation import Failed, NotCompiled, failure_summary, naming
from phasebench.integrators.driver import OK
from phasebench.integrators.prepared import prepare
from phasebench.integrators.record import Method

from . import fronts
from .battery import Entry
from .place import own
from .subject import Subject, subject

PATH = Path(__file__).with_name("times.csv")
#: It ran in every scene, takes any H, and has as many evaluations in every step.
REFERENCE = "dop853"
#: Rounds, and how often the reference, which takes microseconds, is run in each.
ROUNDS, INNER = 9, 50
#: The run that is timed has at most so many evaluations where Python calls it, if there is one.
SHORT = 1000
#: Steps of Runge-Kutta's method in Python: four evaluations each, by q and by p.
STEPS = 50
#: A ratio whose interval is wider than this factor is not told.
WIDE = 2.0


class Fastest(NamedTuple):
    """Who meets an error in the least time, and which share that is of the time of the reference's run."""

    integrator: str
    share: float


@dataclass(frozen=True)
class Stored:
    """What is known of a scene: the steps and evaluations of the reference's run, and who was the fastest by error."""

    steps: int
    evaluations: float
    fastest: Mapping[float, Fastest]


def made(choices: Iterable[Mapping[str, Any]], rungs: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The lines of `times.csv` from tables of the trade: who was the fastest of either side, and the reference's runs.

    Its longest run stands for it, in which what a call costs is the least.
    """
    runs = [r for r in rungs if r["integrator"] == REFERENCE and r.get("status") == OK]
    lines = []
    for choice in choices:
        mine = [r for r in runs if r["scene"] == choice["scene"]]
        fastest = min(_cheapest(choice, side) for side in (timing.OURS, timing.PEERS))
        error = float(choice["accuracy"])
        if choice["scene"] in fronts.SCENES and error in fronts.ERRORS and mine and isfinite(fastest[0]):
            long = max(mine, key=lambda r: float(r["seconds"]))
            share = float(f"{fastest[0] / float(long['seconds']):.3g}")
            line = {"scene": choice["scene"], "error": error, "integrator": fastest[1], "share": share}
            lines.append(line | {"steps": int(long["steps"]), "evaluations": round(float(long["evaluations"]))})
    return sorted(lines, key=lambda line: (fronts.SCENES.index(line["scene"]), -line["error"]))


def _cheapest(choice: Mapping[str, Any], side: str) -> tuple[float, str]:
    """(the seconds of a side's cheapest, who); infinite where the side does not get there."""
    seconds = choice.get(f"{side} seconds")
    if seconds in ("", None) or seconds != seconds:
        return inf, ""
    return float(seconds), choice[f"{side} integrator"]


@cache
def stored() -> dict[str, Stored]:
    """Scene -> what is known of its times; empty where nothing is stored."""
    lines: dict[str, list[dict[str, str]]] = {}
    if PATH.exists():
        with PATH.open(newline="", encoding="utf-8") as stream:
            for row in csv.DictReader(stream):
                lines.setdefault(row["scene"], []).append(row)
    return {
        scene: Stored(
            int(part[0]["steps"]),
            float(part[0]["evaluations"]),
            {float(r["error"]): Fastest(r["integrator"], float(r["share"])) for r in part},
        )
        for scene, part in lines.items()
    }


def keep(lines: list[dict[str, Any]]) -> None:
    """Store the lines, whole or not at all."""
    from phasebench.benchmarks.rows.tables import write_lines

    write_lines(PATH, lines)
    stored.cache_clear()


def runge_kutta(system, q, p, h):
    """Kutta's classical step, as a stranger would write it."""

    def slopes(q, p):
        return system.dH_dp(q, p), -system.dH_dq(q, p)

    a, b = slopes(q, p)
    c, d = slopes(q + h / 2 * a, p + h / 2 * b)
    e, f = slopes(q + h / 2 * c, p + h / 2 * d)
    g, k = slopes(q + h * e, p + h * f)
    return q + h / 6 * (a + 2 * c + 2 * e + g), p + h / 6 * (b + 2 * d + 2 * f + k)


def timed(chosen: Subject, row: Mapping[str, Any], run: Callable) -> dict[str, Any] | None:
    """The times of an integrator on the scene of its `place.place`; None where nothing is stored or it met nothing.

    Parameters
    ----------
    run : (subject, entry, problem, t_end, size) -> anything, a run of the integrator as `place` makes it
    """
    known, met = stored().get(row["on"]), [e for e in row["errors"] if e["evaluations"] is not None]
    if known is None or not met or not min(x for x, _ in row["curve"]) > 0:
        return None
    question = fronts.question(row["on"])
    problem = question.made()
    entry = Entry(row["on"], problem.system, (*problem.q0, *problem.p0))
    called = chosen.integrator is None
    short = [k for k, (x, _) in enumerate(row["curve"]) if x <= SHORT or not called]
    k = max(short, key=lambda k: row["curve"][k][0]) if short else 0
    evaluations, size = row["curve"][k][0], row["sizes"][k]
    reference = _often(problem, REFERENCE, question.t_end, known.steps)
    if called:
        python = subject(runge_kutta)
        work = {
            "mine": _clocked(lambda: run(chosen, entry, problem, question.t_end, size)),
            "python": _clocked(lambda: own(python, entry, problem, STEPS * problem.pace.step, STEPS)),
        }
    elif isinstance(chosen.integrator.record, Method):
        work = {"mine": _often(problem, chosen.integrator.record, question.t_end, size)}
    else:
        work = {"mine": lambda: _seconds(chosen, problem, question.t_end, size)}
    return told(row, known, evaluations, timing.in_turns(work | {"reference": reference}, ROUNDS))


def timed_or_failed(chosen: Subject, row: Mapping[str, Any], run: Callable) -> dict[str, Any] | None:
    """The times, or where a compiled run of the comparison does not compile a row without times that says so."""
    try:
        return timed(chosen, row, run)
    except NotCompiled as error:
        return {
            "on": row["on"],
            "reference": REFERENCE,
            "errors": [],
            "python": None,
            "failed": [error.failed._asdict()],
        }


def _clocked(run: Callable[[], object]) -> Callable[[], float]:
    """The run as one that tells its seconds, those of the processor."""

    def seconds() -> float:
        began = time.process_time()
        run()
        return time.process_time() - began

    return seconds


def _often(problem, method, t_end: float, steps: int) -> Callable[[], float]:
    """The seconds of one of `INNER` compiled runs of a method of ours."""
    name = getattr(method, "id", method)
    with naming(name):
        compiled = prepare(problem, method)

    def runs() -> None:
        with naming(name):
            for _ in range(INNER):
                compiled(t_end / steps, steps)

    clocked = _clocked(runs)
    return lambda: clocked() / INNER


def _seconds(chosen: Subject, problem, t_end: float, size: float) -> float:
    """The seconds that a peer tells of a run."""
    wanted = {"tol": max(size, chosen.integrator.record.least)} if chosen.adaptive else {"steps": size}
    return chosen.integrator.run(problem, t_end=t_end, save_every=0, **wanted).seconds


def told(row: Mapping[str, Any], known: Stored, evaluations: float, seconds: Mapping[str, Any]) -> dict[str, Any]:
    """How many times the fastest stored it takes at each error that it meets, from the seconds of runs in turns."""
    here = timing.ratio(seconds["mine"], seconds["reference"])
    errors = []
    for e in row["errors"]:
        best = known.fastest.get(e["error"])
        if e["evaluations"] is not None and best is not None:
            more = e["evaluations"] / evaluations / best.share
            found = {"error": e["error"], "fastest": best.integrator, "factor": here.value * more}
            errors.append(found | {"low": here.low * more, "high": here.high * more})
    out: dict[str, Any] = {"on": row["on"], "reference": REFERENCE, "errors": errors, "python": None}
    if "python" in seconds:
        price = timing.ratio(seconds["python"] / (4 * STEPS), seconds["reference"] / known.evaluations)
        out["python"] = price._asdict()
    return out


def failures(times: Iterable[Mapping[str, Any]]) -> str:
    """A sentence on what the comparison could not compile; empty where it compiled everything."""
    found = [Failed(**f) for t in times for f in t.get("failed", ())]
    summary = failure_summary(found, all_own=True)
    return f"The comparison of times is missing. {summary}" if summary else ""


def said(times: Iterable[Mapping[str, Any]]) -> list[str]:
    """A line a scene: how many times the fastest stored it takes, and what Python's calls have in it."""
    return [f"time on {t['on']}: {_line(t)}" for t in times if t["errors"]]


def _line(t: Mapping[str, Any]) -> str:
    first, *others = t["errors"]
    if first["high"] > WIDE * first["low"]:
        spread = f"{count(first['low'])} to {count(first['high'])} times the fastest stored"
        return f"not told, the runs differ too much ({spread} for an error of {first['error']:.0e})"
    parts = [f"about {count(first['factor'])} times the fastest stored for an error of {first['error']:.0e}"]
    parts += [f"{count(e['factor'])} times for an error of {e['error']:.0e}" for e in others]
    text = f"{', '.join(parts)} (to a factor of 2; told through {t['reference']}, run in turns here and stored there)"
    price = t["python"]
    if price is None:
        return text
    if price["high"] > WIDE * price["low"]:
        return f"{text}, with what Python's calls cost"
    return (
        f"{text}, with what Python's calls cost: an evaluation takes about {count(price['value'])} times the compiled "
        "one in a Runge-Kutta step that is called in the same way"
    )


def count(x: float) -> str:
    """Two digits, without a power of ten."""
    return f"{float(f'{x:.2g}'):.0f}" if x >= 100 else f"{x:.2g}"
