"""The sixty asks: advised, run again by a process that knows nothing of it, and held against the best of everything."""

from __future__ import annotations

import time
from typing import Any

from phasebench.benchmarks.advice import prior
from phasebench.benchmarks.advice.advise import advise
from phasebench.benchmarks.advice.ask import Ask, ask
from phasebench.benchmarks.advice.trial import Trial
from phasebench.benchmarks.measure import truths
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.measure.timing import in_turns, median, ratio
from phasebench.benchmarks.rows.cells import ALONE, Cell, Rows, content

from . import brute
from .asks import ASKS, QUICK, Asked
from .rerun import error_of, rerun

TABLE = "advice"
#: Asks of a cell, which share a process for the rerun; each so many-th ask is held against everything.
GROUP, EVERY = 6, 3
#: Seconds of the processor that a search may take, and rounds in which the two best run in turns.
LIMIT, ROUNDS = 6.0, 9


def cells(quick: bool = False) -> list[Cell]:
    """A cell for each group of asks; of the quick tier one of a few, which nothing is held against."""
    if quick:
        return [_cell("quick", ASKS[:QUICK], False)]
    groups = [ASKS[i : i + GROUP] for i in range(0, len(ASKS), GROUP)]
    return [_cell(f"{g[0].name}-{g[-1].name}", g, True) for g in groups]


def _cell(name: str, group: tuple[Asked, ...], against_all: bool) -> Cell:
    ids = frozenset(a.words[0].partition(":")[0] for a in group if not a.outside)
    return Cell(
        "advice",
        (TABLE,),
        {"group": name},
        measured,
        (name, tuple(a.name for a in group), against_all),
        content("advice", name, group, against_all, prior.PATH.read_bytes(), code=[__name__]),
        ids,
        ALONE,
        own=True,
        quick=not against_all,
    )


def measured(group: str, names: tuple[str, ...], against_all: bool) -> Rows:
    """The rows of a group of asks."""
    members = [a for a in ASKS if a.name in names]
    rows = [row(a, against_all and int(a.name) % EVERY == 0) | {"group": group} for a in members]
    advised = [r for r in rows if r["command"]]
    for r, printed in zip(advised, rerun([r["command"] for r in advised]), strict=True):
        error = error_of(printed)
        r["rerun error"], r["met"] = error, error is not None and error <= r["accuracy"]
    return {TABLE: rows}


def asked_of(a: Asked) -> Ask:
    """The question of an ask, as the command line would make it."""
    from phasebench.benchmarks.problems import problem
    from phasebench.benchmarks.problems.user import from_formula

    if a.outside:
        q, p = ([float(x) for x in w.partition("=")[2].split(",")] for w in a.words[2:])
        made = from_formula(a.words[1], q, p, {})
    else:
        made = problem(a.words[0])
    return ask(made, t_end=a.t_end, accuracy=a.accuracy, quantity_name=a.quantity, conserve=a.conserve, limit=LIMIT)


def row(a: Asked, against_all: bool) -> dict[str, Any]:
    """The row of an ask; ``met`` and the rerun's error follow."""
    question = asked_of(a)
    began, processor = time.perf_counter(), time.process_time()
    answer = advise(question, list(a.words))
    took = {"took": time.perf_counter() - began, "took processor": time.process_time() - processor}
    choice = answer["choice"] or {}
    out = {
        "ask": a.name,
        "problem": question.problem.label,
        "outside": a.outside,
        "t_end": a.t_end,
        "quantity": a.quantity,
        "accuracy": a.accuracy,
        "conserve": ", ".join(a.conserve),
        "choice": choice.get("integrator"),
        "size": choice.get("steps", choice.get("tol")),
        "error": choice.get("error"),
        "seconds": choice.get("seconds"),
        "verified": answer["verified"],
        "command": choice.get("command", ""),
        "why": answer["why"],
    }
    return out | took | (_against(question, choice) if against_all else {})


def _against(question: Ask, choice: dict[str, Any]) -> dict[str, Any]:
    """What the best of everything is, and the advised one's time over its, round by round."""
    true = truths.truth(question.problem, question.quantity, question.t_end)
    found = brute.best(question, true)
    if found is None:
        return {"best": None}
    size = {"steps": choice["steps"]} if "steps" in choice else {"tol": choice.get("tol")}
    line = {"best": found.trial.integrator.label, "best size": next(iter(found.point.size.values()))}
    line |= {"best error": found.point.error, "tried": found.tried, "runs": found.runs}
    if not choice:
        return line
    advised = Trial(integrator(choice["integrator"], **choice["params"]), question, true, brute.LONGEST)
    turns = in_turns(
        {
            "advised": lambda: advised.seconds(size),
            "best": lambda: found.trial.seconds(found.point.size),
        },
        ROUNDS,
    )
    over = ratio(turns["advised"], turns["best"])
    seconds = {f"{k} seconds": median(v).value for k, v in turns.items()}
    return line | seconds | {"ratio": over.value, "ratio low": over.low, "ratio high": over.high}
