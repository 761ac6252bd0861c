"""Does the integrator that `phasebench advise` recommends meet the requested accuracy, and is it fast?"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from typing import Any

import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.advice import prior
from phasebench.benchmarks.advice.advise import advise
from phasebench.benchmarks.advice.ask import Ask, ask
from phasebench.benchmarks.measure import truths
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.measure.timing import in_turns, median, ratio
from phasebench.benchmarks.page.markdown import code
from phasebench.benchmarks.page.page import ROWS, Table, of
from phasebench.benchmarks.page.shared import picture, worst
from phasebench.benchmarks.page.study import Claim, Number, Runs, Study, over
from phasebench.benchmarks.page.verdict import NONE, at_least
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.user import from_formula
from phasebench.benchmarks.store.cells import ALONE, ProblemKey
from phasebench.integrators.record import ROUND_OFF
from phasebench.integrators.registry import BY_ID

from . import brute
from .asks import ASKS, FORMULAS, REGISTERED, SEED, TypedRequest

TABLE = "advice"
#: Requests in a cell, which share one process for the rerun; every `EVERY`-th is compared with brute force.
GROUP, EVERY = 6, 3
GROUPS = tuple(f"{n:02d}-{n + GROUP - 1:02d}" for n in range(1, len(ASKS) + 1, GROUP))
#: Processor seconds that a search for advice may take; rounds in which the advised and the fastest run alternate.
LIMIT, ROUNDS = 6.0, 9
#: Advice counts as near the fastest up to this ratio of times; the share of requests that has to be near.
NEAR, OFTEN = 1.2, 0.9
#: Source of the process of a rerun: it passes the arguments of each command line to the command-line application.
SCRIPT = """
import json, shlex, sys
from contextlib import suppress
from phasebench.benchmarks.cli import app

for line in json.loads(sys.stdin.read()):
    program, *arguments = shlex.split(line)
    assert program == "phasebench", line
    with suppress(SystemExit):
        app([*arguments, "--json"], standalone_mode=False)
    sys.stdout.flush()
"""


def requests(group: str) -> list[TypedRequest]:
    """The requests of a group, such as "07-12"."""
    first, last = map(int, group.split("-"))
    return [ASKS[f"{n:02d}"] for n in range(first, last + 1)]


def needs(group: str) -> list[object]:
    """What the rows of a group depend on: the requests, their problems, the order in which advice tries integrators."""
    members = requests(group)
    return [tuple(members), prior.TABLE.path.read_bytes(), *(ProblemKey(a.words[0]) for a in members if not a.outside)]


def measure(group: str) -> list[dict[str, Any]]:
    """Advise on each request of a group and rerun the advised commands: a row for each."""
    rows = [advised(a, int(a.name) % EVERY == 0) for a in requests(group)]
    with_command = [r for r in rows if r["command"]]
    for r, printed in zip(with_command, rerun([r["command"] for r in with_command]), strict=True):
        error = error_of(printed)
        r |= {"rerun error": error, "met": error is not None and error <= r["accuracy"]}
    return rows


def rerun(lines: list[str]) -> list[dict]:
    """The JSON objects that command lines print, run in one fresh process; RuntimeError if it fails."""
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT], input=json.dumps(lines), capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise RuntimeError(f"the rerun failed:\n{done.stderr}")
    return [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]


def error_of(printed: dict) -> float | None:
    """The error that ``integrate`` printed: of the requested quantity, else that of the end state, or None."""
    found = printed.get("quantity_error")
    return found["error"] if found else printed.get("global_error")


def asked_of(a: TypedRequest) -> Ask:
    """The `Ask` (problem, quantity, accuracy, limits) of a typed request, as the command line makes it."""
    if a.outside:
        q, p = ([float(x) for x in w.partition("=")[2].split(",")] for w in a.words[2:])
        made = from_formula(a.words[1], q, p, {})
    else:
        made = problem(a.words[0])
    return ask(made, t_end=a.t_end, accuracy=a.accuracy, quantity_name=a.quantity, conserve=a.conserve, limit=LIMIT)


def advised(a: TypedRequest, against_all: bool) -> dict[str, Any]:
    """The row of a request before the rerun; ``against_all`` adds the fastest integrator that brute force finds."""
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
    """Columns on the fastest run of any integrator, and on the advised one timed in turns with it.

    ``ratio`` is the advised one's time over that of the fastest, ``best``, which is None if none meets the accuracy.
    """
    true = truths.truth(question.problem, question.quantity, question.t_end)
    found = brute.best(question, true)
    if found is None:
        return {"best": None}
    line = {"best": found.runs.integrator.label, "best size": found.run.size}
    line |= {"best error": found.run.error, "tried": found.tried, "runs": found.count}
    if not choice:
        return line
    mine = brute.Runs(integrator(choice["integrator"], parameters=choice["params"]), question, true)
    size = choice["steps"] if "steps" in choice else choice["tol"]
    turns = {"advised": lambda: mine.seconds(size), "best": lambda: found.runs.seconds(found.run.size)}
    turns = in_turns(turns, ROUNDS)
    over = ratio(turns["advised"], turns["best"])
    seconds = {f"{k} seconds": median(v).value for k, v in turns.items()}
    return line | seconds | {"ratio": over.value, "ratio low": over.low, "ratio high": over.high}


@picture(TABLE, "advice", "advice against the fastest")
def draw(table: pd.DataFrame) -> tuple[style.Figure, str]:
    """The time of the advised integration over the fastest's, by requested accuracy."""
    told = table[table["ratio"].notna()]
    figure, ((axes,),) = style.panels(1, 1, 3.2)
    for k, (name, part) in enumerate((("registered", ~told["outside"]), ("formula", told["outside"]))):
        look = style.curve(k) | {"linestyle": "none"}
        axes.semilogx(told[part]["accuracy"], told[part]["ratio"], label=name, **look)
    axes.axhline(NEAR, color=style.GREY, linewidth=0.8, linestyle=":")
    axes.set(xlabel="requested accuracy", ylabel="time over the fastest's", ylim=(0, None))
    axes.invert_xaxis()
    style.legend_above(figure, axes, 2)
    return figure, (
        f"Time of the advised integration over that of the fastest that brute force found; dotted: {NEAR}. Below 1 the "
        "advice is faster than brute force: certainly so (whole interval of the ratio) in "
        f"{int((told['ratio high'] < 1).sum())} of {len(told)}."
    )


@of(TABLE)
def table(found: pd.DataFrame) -> Table:
    """Requests refused or not met, then those farthest from the fastest."""
    order = found.assign(wrong=found["met"] != True, far=found["ratio"].fillna(0.0))  # noqa: E712
    shown = order.sort_values(["wrong", "far"], ascending=False, kind="stable").head(ROWS)
    shown = shown.assign(problem=[code(r.problem) if r.outside else r.problem for r in shown.itertuples()])
    columns = ["ask", "problem", "t_end", "quantity", "accuracy", "conserve", "choice", "error", "seconds"]
    caption = (
        "Requests that were refused or not met, then those with the largest ratio of the time to that of the fastest "
        "(`best`), then others; `conserve`: the structure that was asked for."
    )
    energy = found.loc[(found["quantity"] == "energy") & found["choice"].notna(), "choice"]
    kept = sum(id in BY_ID and BY_ID[id].energy == ROUND_OFF for id in energy)
    if kept:
        caption += f" {kept} of the {len(energy)} about the energy get a method that keeps it on any orbit."
    return Table(shown[[*columns, "best", "ratio"]], caption)


STUDY = Study(
    id=TABLE,
    place=40,
    question="Does the advice meet the requested accuracy, and how close to the fastest is it?",
    answer="Advice met the requested accuracy in {met.n} of {asked} random requests; in {near} that were compared it "
    f"takes at most {NEAR} times the time of the fastest integrator.",
    setting=(
        f"Requests: {REGISTERED} on registered problems and {FORMULAS} on formulas that are in no registry; problem, "
        f"span, quantity, accuracy and what to conserve are drawn at random (seed {SEED}).",
        "Advice: `phasebench advise` tries integrators in the order of stored measurements, each at the widest step "
        "that meets the accuracy, and times the cheapest in turns.",
        "Met: another process, which knows nothing of the advice, runs the printed command, `phasebench integrate ... "
        "--error`; its error is at most the accuracy.",
        f"Fastest: brute force over every integrator on a fine ladder of steps or tolerances (factors {brute.COARSE} "
        f"and {brute.FINE}), for every {EVERY}rd request; then both run {ROUNDS} rounds in turns.",
    ),
    runs=(Runs(TABLE, measure, over(group=GROUPS), needs, ALONE, own=True),),
    claims={
        "met": Claim(
            "The printed command meets the accuracy when another process runs it",
            TABLE, "met == True", rows="choice == choice", unit="requests",
            where="{ask} ({problem})", names=3, fault=True,
        ),
        "near": Claim(
            "The advised integration is about as fast as the fastest that brute force finds",
            TABLE, f"ratio <= {NEAR}", at_least(OFTEN), rows="ratio == ratio", unit=f"requests within {NEAR} times",
            where=worst("ratio", "{choice} on {problem}: {ratio:.3g} times {best}"),
        ),
        "refusals": Claim(
            "No request is refused that brute force can meet",
            TABLE, "choice != choice", NONE, rows="best == best", unit="requests", where="{ask}",
            names=3,
        ),
    },
    numbers={"asked": Number(TABLE, len)},
    checks={
        "verified": Claim("Advice is verified", TABLE, "verified == True", rows="choice == choice"),
        "reasons": Claim("A request without advice has a reason", TABLE, "choice == choice or why == why"),
    },
    figure=draw,
    shown=table,
    limits=(
        f"A search gets {LIMIT:g} seconds of the processor; where kernels have to be compiled first it tries fewer.",
        "Errors are deterministic on one machine; on another the last digits round otherwise, and an error close to "
        "the accuracy may exceed it.",
        "The reference is heyoka's, in long double, and heyoka may be advised: an integrator of another kind has to "
        "come near the reference too.",
        f"Brute force leaves out packages that loop over steps in Python, and what costs more than {brute.DEAR:g} "
        f"times the cheapest so far. Its steps are a factor {brute.FINE} apart, so it may miss the best one: its time "
        "is no lower bound.",
    ),
)  # fmt: skip
