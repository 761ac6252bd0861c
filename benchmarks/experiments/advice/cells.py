"""Measurements (`Cell`) of the advice: requests are advised, rerun in a fresh process, compared with brute force."""

from __future__ import annotations

import time
from typing import Any

from phasebench.benchmarks.advice import prior
from phasebench.benchmarks.advice.advise import advise
from phasebench.benchmarks.advice.ask import Ask, ask
from phasebench.benchmarks.measure import truths
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.measure.timing import in_turns, median, ratio
from phasebench.benchmarks.store.cells import ALONE, Cell, Rows, content

from . import brute
from .asks import ASKS, QUICK, TypedRequest
from .rerun import error_of, rerun

TABLE = "advice"
#: Requests in a cell, which share one process for the rerun; every `EVERY`-th is compared with brute force.
GROUP, EVERY = 6, 3
#: Processor seconds that a search for advice may take; rounds in which the advised and the fastest run alternate.
LIMIT, ROUNDS = 6.0, 9


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements to make (`Cell`), one for each group of requests.

    If ``quick``, only one group, without the brute-force search for the fastest integrator.
    """
    if quick:
        return [_cell("quick", ASKS[:QUICK], False)]
    groups = [ASKS[i : i + GROUP] for i in range(0, len(ASKS), GROUP)]
    return [_cell(f"{g[0].name}-{g[-1].name}", g, True) for g in groups]


def _cell(name: str, group: tuple[TypedRequest, ...], against_all: bool) -> Cell:
    ids = frozenset(a.words[0].partition(":")[0] for a in group if not a.outside)
    return Cell(
        "advice",
        (TABLE,),
        {"group": name},
        measure_rows,
        (name, tuple(a.name for a in group), against_all),
        content("advice", name, group, against_all, prior.TABLE.path.read_bytes(), code=[__name__]),
        ids,
        ALONE,
        own=True,
        quick=not against_all,
    )


def measure_rows(group: str, names: tuple[str, ...], against_all: bool) -> Rows:
    """Advise on each request of a group and rerun the advised commands: a row for each, by table name.

    ``names`` selects the requests; with ``against_all`` some are also compared with the brute-force search.
    """
    members = [a for a in ASKS if a.name in names]
    rows = [row(a, against_all and int(a.name) % EVERY == 0) | {"group": group} for a in members]
    advised = [r for r in rows if r["command"]]
    for r, printed in zip(advised, rerun([r["command"] for r in advised]), strict=True):
        error = error_of(printed)
        r["rerun error"], r["met"] = error, error is not None and error <= r["accuracy"]
    return {TABLE: rows}


def asked_of(a: TypedRequest) -> Ask:
    """Build the `Ask` (problem, quantity, accuracy, limits) from a typed request, as the command line does."""
    from phasebench.benchmarks.problems import problem
    from phasebench.benchmarks.problems.user import from_formula

    if a.outside:
        q, p = ([float(x) for x in w.partition("=")[2].split(",")] for w in a.words[2:])
        made = from_formula(a.words[1], q, p, {})
    else:
        made = problem(a.words[0])
    return ask(made, t_end=a.t_end, accuracy=a.accuracy, quantity_name=a.quantity, conserve=a.conserve, limit=LIMIT)


def row(a: TypedRequest, against_all: bool) -> dict[str, Any]:
    """Search advice for one request and return its row of the table "advice".

    If ``against_all``, a brute-force search adds the fastest integrator and the ratio of times.  `measure_rows` adds
    the error of the rerun and ``met``, whether this error is within the accuracy.
    """
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
    """Compare the advised integration with the fastest one that a brute-force search over all integrators finds.

    ``choice`` is the advised integration, a dict of the answer.  Both are timed in alternation.  Returns columns for
    the row: the fastest integrator (``best``, None if none meets the accuracy), its size (steps or tolerance) and
    error, how many integrators and runs were tried, the seconds of both, and the time of the advised one over that of
    the fastest (``ratio``).
    """
    true = truths.truth(question.problem, question.quantity, question.t_end)
    found = brute.best(question, true)
    if found is None:
        return {"best": None}
    line = {"best": found.runs.integrator.label, "best size": found.run.size}
    line |= {"best error": found.run.error, "tried": found.tried, "runs": found.count}
    if not choice:
        return line
    advised = brute.Runs(integrator(choice["integrator"], parameters=choice["params"]), question, true)
    size = choice["steps"] if "steps" in choice else choice["tol"]
    turns = {"advised": lambda: advised.seconds(size), "best": lambda: found.runs.seconds(found.run.size)}
    turns = in_turns(turns, ROUNDS)
    over = ratio(turns["advised"], turns["best"])
    seconds = {f"{k} seconds": median(v).value for k, v in turns.items()}
    return line | seconds | {"ratio": over.value, "ratio low": over.low, "ratio high": over.high}
