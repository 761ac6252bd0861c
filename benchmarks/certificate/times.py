r"""An integrator's time over that of the fastest known one, by way of a reference measured both here and there.

.. math::
    \frac{T}{T_\text{fastest}} = \frac{T}{T_\text{ref}}\Big|_\text{here} \cdot
    \frac{T_\text{ref}}{T_\text{fastest}}\Big|_\text{in the trade}

"The trade" is the stored comparison of all integrators by error and time (`studies.trade`).  The first factor is
measured here: the integrator and the reference method run in alternation, and the processor seconds of this process
count, so that the work of other processes is left out, even of those that a step starts (a peer, an integrator of
another package, reports its own seconds).  T is scaled with the number of evaluations that an error needs (`place`).
The second factor is stored in `times.csv`, computed from the trade: a ratio on one machine, where runs of microseconds
include the overhead of a call.  The estimate is good to a factor of 2: this was found by estimating the reference's own
times in this way.

A step called from Python carries Python's overhead.  A Runge-Kutta step called in the same way, timed beside the
compiled reference, tells how much that is for an evaluation.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import groupby
from math import inf, isfinite
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from phasebench.benchmarks.judge.evidence import Tables
from phasebench.benchmarks.ladder.race import REFERENCE
from phasebench.benchmarks.measure import timing
from phasebench.benchmarks.measure.compilation import Failed, NotCompiled, failure_summary, naming
from phasebench.benchmarks.measure.own_step import System
from phasebench.benchmarks.problems.base import Problem
from phasebench.benchmarks.store.shipped import ShippedTable
from phasebench.integrators.driver import OK
from phasebench.integrators.prepared import prepare
from phasebench.integrators.record import Method

from . import fronts
from .place import own, scene_parts
from .subject import Subject, subject

#: Rounds of a timing, and how often the reference, which takes microseconds, is run in each.
ROUNDS, INNER = 9, 50
#: Of a step called from Python, a run of at most this many evaluations is timed, if there is one.
SHORT = 1000
#: Steps of Runge-Kutta's method in Python: four evaluations each, by q and by p.
STEPS = 50
#: A ratio whose interval is wider than this factor is not reported.
WIDE = 2.0
#: What a cell says if no run was accurate enough, and if runs that should be equal took too different times.
NOT_MET, VARIES = "not met", "varies"


class Fastest(NamedTuple):
    """The fastest integrator at an error; ``share`` is its time over that of the reference method's stored run."""

    integrator: str
    share: float


@dataclass(frozen=True)
class StoredTimes:
    """Steps and evaluations of the reference's stored run on a scene; at each error the fastest integrator."""

    steps: int
    evaluations: float
    fastest: Mapping[float, Fastest]


def build(choices: Iterable[Mapping[str, Any]], rungs: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Compute the lines of `times.csv`: at each error the fastest integrator, its time over that of a reference method.

    The reference method is represented by its longest run, in which the overhead of the call weighs least.
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
    """(seconds, id) of the cheapest integrator of a ``side`` in a stored row; (inf, "") if there is none."""
    seconds = choice.get(f"{side} seconds")
    if seconds in ("", None) or seconds != seconds:
        return inf, ""
    return float(seconds), choice[f"{side} integrator"]


def parse(lines: list[dict[str, str]]) -> dict[str, StoredTimes]:
    """Scene -> its stored times, from the lines of `times.csv`."""
    scenes: dict[str, list[dict[str, str]]] = {}
    for row in lines:
        scenes.setdefault(row["scene"], []).append(row)
    return {
        scene: StoredTimes(
            int(part[0]["steps"]),
            float(part[0]["evaluations"]),
            {float(r["error"]): Fastest(r["integrator"], float(r["share"])) for r in part},
        )
        for scene, part in scenes.items()
    }


TABLE = ShippedTable(Path(__file__).with_name("times.csv"), build, parse)


def runge_kutta(system: System, q: np.ndarray, p: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray]:
    """Kutta's classical fourth-order step, as a user would write it."""

    def slopes(q: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return system.dH_dp(q, p), -system.dH_dq(q, p)

    a, b = slopes(q, p)
    c, d = slopes(q + h / 2 * a, p + h / 2 * b)
    e, f = slopes(q + h / 2 * c, p + h / 2 * d)
    g, k = slopes(q + h * e, p + h * f)
    return q + h / 6 * (a + 2 * c + 2 * e + g), p + h / 6 * (b + 2 * d + 2 * f + k)


def time_subject(chosen: Subject, row: Mapping[str, Any], run: Callable) -> dict[str, Any] | None:
    """Time an integrator on a scene, beside the reference method: a row of `times_row`.

    ``row`` is from `place.place`, ``run`` as `place.run_subject`.  None if no time of the scene is stored, or no error
    of the row is met.
    """
    known, met = TABLE.load().get(row["on"]), [e for e in row["errors"] if e["evaluations"] is not None]
    if known is None or not met or not min(x for x, _ in row["curve"]) > 0:
        return None
    question, problem, entry = scene_parts(row["on"])
    called = chosen.integrator is None
    short = [k for k, (x, _) in enumerate(row["curve"]) if x <= SHORT or not called]
    k = max(short, key=lambda k: row["curve"][k][0]) if short else 0
    evaluations, size = row["curve"][k][0], row["sizes"][k]
    reference = _often(problem, REFERENCE, question.t_end, known.steps)
    if called:
        python = subject(runge_kutta)
        work = {
            "mine": _clock(lambda: run(chosen, entry, problem, question.t_end, size)),
            "python": _clock(lambda: own(python, entry, problem, STEPS * problem.pace.step, STEPS)),
        }
    elif isinstance(chosen.integrator.record, Method):
        work = {"mine": _often(problem, chosen.integrator.record, question.t_end, size)}
    else:
        work = {"mine": lambda: _seconds(chosen, problem, question.t_end, size)}
    return times_row(row, known, evaluations, timing.in_turns(work | {"reference": reference}, ROUNDS))


def timed_or_failed(chosen: Subject, row: Mapping[str, Any], run: Callable) -> dict[str, Any] | None:
    """Time an integrator by `time_subject`; if a run of the comparison does not compile, a row that says so."""
    try:
        return time_subject(chosen, row, run)
    except NotCompiled as error:
        return {
            "on": row["on"],
            "reference": REFERENCE,
            "errors": [],
            "python": None,
            "failed": [error.failed._asdict()],
        }


def _clock(run: Callable[[], object]) -> Callable[[], float]:
    def seconds() -> float:
        began = time.process_time()
        run()
        return time.process_time() - began

    return seconds


def _often(problem: Problem, method: str | Method, t_end: float, steps: int) -> Callable[[], float]:
    """A function that times a compiled method: the mean processor seconds of `INNER` runs in a row."""
    name = getattr(method, "id", method)
    with naming(name):
        compiled = prepare(problem, method)

    def runs() -> None:
        with naming(name):
            for _ in range(INNER):
                compiled(t_end / steps, steps)

    clocked = _clock(runs)
    return lambda: clocked() / INNER


def _seconds(chosen: Subject, problem: Problem, t_end: float, size: float) -> float:
    wanted = {"tol": max(size, chosen.integrator.record.least)} if chosen.adaptive else {"steps": size}
    return chosen.integrator.run(problem, t_end=t_end, save_every=0, **wanted).seconds


def times_row(
    row: Mapping[str, Any], known: StoredTimes, evaluations: float, seconds: Mapping[str, Any]
) -> dict[str, Any]:
    """Estimate, at each error that an integrator reaches, its time over that of the fastest stored one: a row.

    ``evaluations`` are those of the run that was timed; ``seconds`` has "mine", "reference" and perhaps "python", a
    Runge-Kutta step, timed in turns.  ``python`` is an evaluation called from Python over a compiled one, or None.
    """
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


# -- as text -----------------------------------------------------------------------------------------------------------


def cost_rows(tables: Tables, times: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return an integrator's costs over those of the cheapest stored one: a row per scene (problem and span) and error.

    ``times`` are rows of `times_row`.  A cost is None if the error is not met, or no time was measured;
    ``varies`` is True where the measured times do so by more than the factor `WIDE`.
    """
    timed = {t["on"]: t["errors"] for t in times if t["errors"]}
    rows = []
    for place in tables.of("place"):
        errors = timed.get(place["on"], [])
        factors = {e["error"]: e["factor"] for e in errors}
        varies = any(e["high"] > WIDE * e["low"] for e in errors[:1])
        for e in place["errors"]:
            time = None if varies else factors.get(e["error"])
            row = {"scene": place["on"], "error": e["error"], "evaluations": e["factor"], "time": time}
            rows.append(row | {"varies": varies and e["error"] in factors})
    return rows


def format_costs(tables: Tables, times: Iterable[Mapping[str, Any]]) -> list[str]:
    """Format `cost_rows` as lines of text; those of a scene end at the first error that is not met."""
    times, rows = list(times), []
    for _, scene in groupby(cost_rows(tables, times), key=lambda row: row["scene"]):
        of = list(scene)
        missed = next((k for k, row in enumerate(of) if row["evaluations"] is None), len(of))
        rows += of[: missed + 1]
    if not rows:
        return []
    wide = max(len(r["scene"]) for r in rows)
    lines = ["gradient evaluations and time, relative to the cheapest stored integrator at the same error:"]
    lines.append(f"  {'scene':{wide}}  error  evaluations  time".rstrip())
    for r in rows:
        time = VARIES if r["varies"] else "" if r["time"] is None else f"{count(r['time'])} times"
        evaluations = NOT_MET if r["evaluations"] is None else f"{r['evaluations']:.2g} times"
        lines.append(f"  {r['scene']:{wide}}  {r['error']:.0e}  {evaluations:11}  {time}".rstrip())
    if any(r["time"] is not None for r in rows):
        lines.append(f"time is known to a factor of 2, by way of {REFERENCE}, timed here and when the others were")
    prices = {t["on"]: t["python"] for t in times if t["python"] is not None and t["errors"]}
    for on, price in prices.items():
        if price["high"] > WIDE * price["low"]:
            lines.append(f"time on {on} includes Python's calls")
        else:
            cost = f"{count(price['value'])} times as long as compiled"
            lines.append(f"on {on} a gradient called from Python takes {cost}")
    return lines


def count(x: float) -> str:
    """Format a factor with two significant digits and without an exponent."""
    rounded = float(f"{x:.2g}")
    return f"{rounded:.0f}" if rounded >= 100 else f"{x:.2g}"


def failures(times: Iterable[Mapping[str, Any]]) -> str:
    """A sentence on what the comparison of times could not compile; "" if everything compiled."""
    found = [Failed(**f) for t in times for f in t.get("failed", ())]
    summary = failure_summary(found, all_own=True)
    return f"The comparison of times is missing. {summary}" if summary else ""
