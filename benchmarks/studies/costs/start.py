"""Times of cold starts, which compile everything, and of warm starts, which compile nothing.

Cold: a fresh process with an empty cache imports the packages and makes the problem.  Then the processor time of the
first `integrate` is measured, in which the system's functions are generated and compiled with the kernel.  (Wall-clock
time would grow with other processes.)

Warm: the wall-clock time of a whole process of the command line with a filled cache, measured in turns with a process
that only imports Numba.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import partial

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.measure.timing import median, time_in_turns
from phasebench.benchmarks.page.page import ROWS, Data, Table
from phasebench.benchmarks.page.shared import picture
from phasebench.benchmarks.page.study import Claim, Number, Runs, Study
from phasebench.benchmarks.page.verdict import at_most
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.benchmarks.store.cells import ALONE, ProblemKey
from phasebench.integrators.registry import BY_ID
from phasebench.integrators.statuses import OK

COLD, WARM = "start_cold", "start_warm"
#: Number of steps, few enough to take no time; the step size; rounds of the warm starts.
STEPS, H, ROUNDS = 10, 0.01, 5
#: Largest seconds wanted for a first integration, and for a warm command.
COLD_WANTED, WARM_WANTED = 5.0, 0.6
#: Problems of other than default size, by what they are called.
SIZED = {"toda, N = 4": ProblemKey("toda", (("N", 4),)), "fpu, m = 2": ProblemKey("fpu", (("m", 2),))}
#: Problem -> methods: one for each kernel, the slowest to compile, at d = 4 if it runs there; some at d = 2 for
#: comparison; the slowest on a system that is not separable.
FIRSTS = {
    "toda, N = 4": "rk4 stormer-verlet chin-4a blanes-p7-6 blanes-moan-srkn14a generating-function scheme-v gauss-8 "
    "hbvm-8-4 gauss-equip-4 variational-lobatto-4 itoh-abe-c gonzalez stormer-verlet-symmetric-projection "
    "rk4-relaxation cohen-hairer-3 tao-6 jayawardana-ohsawa-4 quinlan-tremaine-14",
    "fpu, m = 2": "gautschi",
    "perturbed-kepler": "gauss-8-adaptive gauss-8-field wisdom-holman-corrector fcirk",
    "magnetic-mirror": "he-splitting-4",
    "double-pendulum-cartesian": "rattle-yoshida-4 lobatto-iiia-iiib-constrained-6",
    "heavy-top": "rigid-reich-suzuki-4 moser-veselov",
    "kerr": "abc-6",
    "henon-heiles": "stormer-verlet gauss-equip-4",
    "schwarzschild": "gauss-equip-4 implicit-midpoint-symmetric-projection",
}
#: Arguments of the commands that are started warm; a process that only imports Numba.
COMMANDS = (
    ("integrate", "pendulum", "stormer-verlet"),
    ("integrate", "henon-heiles", "scheme-v"),
    ("integrate", "perturbed-kepler", "gauss-8"),
)
FLOOR = "import numba"
SCRIPT = """
import json, sys, time
import numba, sympy
from phasebench.benchmarks.problems import problem
from phasebench.integrators.driver import integrate
id, name, parameters, h, steps = json.loads(sys.argv[1])
made = problem(name, **dict(parameters))
started = time.process_time()
status = integrate(made, id, h=h, steps=steps).status
print(json.dumps({"before": started, "seconds": time.process_time() - started, "status": status}))
"""


def key_of(problem: str) -> ProblemKey:
    """The problem that is called this."""
    return SIZED.get(problem, ProblemKey(problem))


def cold(method: str, problem: str, cache: str | None = None) -> dict:
    """The first integration's processor time in a new process; with the folder ``cache``, or an empty one."""
    what = key_of(problem)
    with tempfile.TemporaryDirectory() as empty:
        told = json.dumps([method, what.name, what.parameters, H, STEPS])
        found = json.loads(_run(["-c", SCRIPT, told], PHASEBENCH_CACHE=cache or empty).splitlines()[-1])
    row = {"family": BY_ID[method].family, "d": problem_of(what.name, **dict(what.parameters)).system.d}
    return row | {"seconds": found["seconds"], "seconds before": found["before"], "status": found["status"]}


def warm() -> list[dict]:
    """The seconds of each command as a whole process, with all code compiled before, and of the import of Numba."""
    work: dict[str, Callable[[], object]] = {FLOOR: partial(_run, ["-c", FLOOR])}
    for command in COMMANDS:
        words = ["-m", "phasebench", *command, "--h", str(H), "--steps", str(STEPS), "--json"]
        work[" ".join(command)] = partial(_run, words)
    times = {what: median(seconds) for what, seconds in time_in_turns(work, ROUNDS).items()}
    return [{"what": what, "seconds": m.value, "low": m.low, "high": m.high} for what, m in times.items()]


def _run(words: list[str], **environment: str) -> str:
    """Run Python with these arguments and further environment variables; return its standard output."""
    done = subprocess.run([sys.executable, *words], capture_output=True, text=True, env=os.environ | environment)
    if done.returncode:
        raise RuntimeError(f"{' '.join(words[:4])}: {done.stderr.strip().splitlines()[-1:]}")
    return done.stdout


@picture(
    COLD, "start", "first integrations",
    f"First integrations with an empty cache; the line: the most that is wanted, {COLD_WANTED:g} s.",
)  # fmt: skip
def _draw(cold: pd.DataFrame) -> style.Figure:
    cold = cold.sort_values("seconds", ascending=False)
    y = np.arange(len(cold))
    figure, ((axes,),) = style.panels(1, 1, 1.0 + 0.2 * len(cold))
    axes.barh(y, cold["seconds"], height=0.6, color=style.BLUE)
    axes.axvline(COLD_WANTED, color=style.VERMILION, linewidth=1.2)
    axes.set_yticks(y, cold["method"] + ", d = " + cold["d"].astype(str))
    axes.set_ylim(len(cold) - 0.5, -0.5)
    axes.set_xlabel("seconds of the processor in the first integration")
    axes.set_axisbelow(True)
    axes.grid(axis="x", color="0.93", linewidth=0.5)
    return figure


def _table(data: Data) -> Table | None:
    parts = []
    if (warm := data(WARM)) is not None and len(warm):
        interval = [f"{low:.2f} to {high:.2f}" for low, high in zip(warm["low"], warm["high"], strict=True)]
        parts = [warm.assign(start="warm", d="", interval=interval)]
    if (cold := data(COLD)) is not None and len(cold):
        longest = cold.sort_values("seconds", ascending=False).head(ROWS - sum(map(len, parts)))
        parts.insert(0, longest.assign(start="cold", what=longest["method"] + " on " + longest["problem"]))
    if not parts:
        return None
    caption = (
        "Cold: seconds of the processor, measured once. Warm: seconds by the clock of a whole process, the median "
        "of rounds with its interval."
    )
    columns = ["start", "what", "d", "seconds", "interval"]
    return Table(pd.concat(parts).reindex(columns=columns).astype(object).fillna(""), caption)


STUDY = Study(
    id="start",
    place=400,
    question="How long until the first result?",
    answer="With an empty cache a first integration takes {cold} s of processor time (median); compiled, a command "
    "ends within {slowest} s, {floor} s of it importing Numba.",
    numbers={
        "cold": Number(COLD, "seconds", take=pd.Series.median, digits=2),
        "slowest": Number(WARM, "seconds", f"what != '{FLOOR}'"),
        "floor": Number(WARM, "seconds", f"what == '{FLOOR}'", digits=2),
    },
    setting=(
        f"A run of {STEPS} steps, so that nearly all of its time is to get ready.",
        "Cold: a fresh process with an empty cache, from the call of `integrate` on, after imports and the making "
        "of the problem; a method of each kernel, with 4 degrees of freedom where it can, and the slowest on other "
        "systems.",
        f"Warm: whole processes of `phasebench integrate` with a filled cache, {ROUNDS} rounds in turns with a "
        "process that imports Numba and does nothing.",
    ),
    runs=(
        Runs(COLD, cold, [{"method": id, "problem": p} for p, ids in FIRSTS.items() for id in ids.split()],
             needs=lambda method, problem: (BY_ID[method], key_of(problem), STEPS), where=ALONE, own=True,
             quick=({"method": "stormer-verlet", "problem": "henon-heiles"},)),
        Runs(WARM, warm, [{}], needs=(*COMMANDS, ROUNDS, *(BY_ID[method] for _, _, method in COMMANDS)),
             where=ALONE, own=True, code=("phasebench.benchmarks.cli.integrate",)),
    ),
    claims={
        "cold": Claim(
            "Every first integration arrives in the processor time wanted",
            COLD, lambda rows: rows["seconds"].where(rows["status"] == OK, np.inf), at_most(COLD_WANTED), unit="s",
            span=True,
        ),
        "warm": Claim(
            "Every command that finds its code compiled ends in the time wanted",
            WARM, "seconds", at_most(WARM_WANTED), rows=f"what != '{FLOOR}'", unit="s", where="{what}", span=True,
        ),
    },
    checks={
        "cold": Claim("Every first integration succeeds", COLD, "status == 'ok'"),
        "warm": Claim(
            "A command takes longer than the import of Numba, a part of it", WARM,
            lambda rows, warm: rows["seconds"] > warm.loc[warm["what"] == FLOOR, "seconds"].max(),
            rows=f"what != '{FLOOR}'", where="{what}", beside=(WARM,),
        ),
    },
    figure=_draw,
    shown=_table,
    limits=(
        "Times are the machine's own, and a busy machine lengthens them, those by the clock most.",
        "Methods of one kernel share its compiled code: a second method, or a second problem with the same degrees of "
        "freedom, starts faster than what is shown.",
        "For other degrees of freedom, up to 20, a kernel is compiled anew, and the longer the more there are.",
    ),
)  # fmt: skip
