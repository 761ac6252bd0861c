"""Cold starts, where everything has to be compiled, and warm ones, where nothing has.

Cold: a fresh process with an empty cache imports what it needs and makes the problem; then the seconds of its processor
over the first `integrate` are counted, in which the functions of the system are generated and, with the kernel,
compiled.  (Another process beside it would stretch the time by the clock.)

Warm: whole processes from start to end by the clock, of the command line with a filled cache, in turns with one that
does nothing but import Numba.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from phasebench.benchmarks.measure.timing import interleaved, median
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.rows.cells import ALONE, Cell, Problem, Rows, content
from phasebench.integrators.registry import method

COLD, WARM = "start_cold", "start_warm"
#: Steps that are taken, each of this length: too few to take time.
STEPS, H = 10, 0.01
ROUNDS = 5


class First(NamedTuple):
    """A first integration: a method on a problem with its parameters."""

    method: str
    problem: str
    parameters: tuple[tuple[str, float], ...] = ()


FOUR = ("toda", (("N", 4),))
#: A method of each kernel, of those that take longest where they differ, at d = 4 where the method can do it; at d = 2
#: for comparison; and the longest on a system that is not separable.
FIRSTS = (
    *(
        First(id, *FOUR)
        for id in (
            "rk4",
            "stormer-verlet",
            "generating-function",
            "scheme-v",
            "gauss-8",
            "hbvm-8-4",
            "gauss-equip-4",
            "variational-lobatto-4",
            "itoh-abe-c",
            "gonzalez",
            "stormer-verlet-symmetric-projection",
            "rk4-relaxation",
            "cohen-hairer-3",
        )
    ),
    First("gautschi", "fpu", (("m", 2),)),
    First("gauss-8-adaptive", "perturbed-kepler"),
    First("wisdom-holman-corrector", "perturbed-kepler"),
    First("stormer-verlet", "henon-heiles"),
    First("gauss-equip-4", "henon-heiles"),
    First("gauss-equip-4", "schwarzschild"),
    First("implicit-midpoint-symmetric-projection", "schwarzschild"),
)
#: What is started warm: the words after the command's name; `FLOOR` is the import of Numba alone.
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


def cells(quick: bool = False) -> list[Cell]:
    """A cell for each cold start, and one for the warm ones, which are taken in turns."""
    return [*map(_cold, FIRSTS), _warm()]


def _cold(first: First) -> Cell:
    chosen, made = method(first.method), Problem(first.problem, first.parameters)
    return Cell(
        "start",
        (COLD,),
        {"method": first.method, "problem": _label(first)},
        cold,
        tuple(first),
        content("cold", chosen, made, STEPS, code=[__name__]),
        frozenset({first.method, first.problem}),
        ALONE,
        own=True,
        quick=first == First("stormer-verlet", "henon-heiles"),
    )


def _warm() -> Cell:
    words = sorted({word for command in COMMANDS for word in command[1:]})
    parts = [method(command[2]) for command in COMMANDS]
    needs = content("warm", COMMANDS, ROUNDS, *parts, code=[__name__, "phasebench.benchmarks.cli.integrate"])
    return Cell("start", (WARM,), {}, warm, (), needs, frozenset(words), ALONE, own=True)


def _label(first: First) -> str:
    more = ", ".join(f"{name} = {value:g}" for name, value in first.parameters)
    return f"{first.problem}{f', {more}' if more else ''}"


def cold(id: str, name: str, parameters: tuple = (), cache: str | None = None) -> Rows:
    """The row of a first integration, with an empty cache unless the folder of one is given."""
    with tempfile.TemporaryDirectory() as empty:
        told = json.dumps([id, name, parameters, H, STEPS])
        found = json.loads(_run(["-c", SCRIPT, told], PHASEBENCH_CACHE=cache or empty).splitlines()[-1])
    d = problem(name, **dict(parameters)).system.d
    row = {"method": id, "problem": _label(First(id, name, parameters)), "family": method(id).family, "d": d}
    return {COLD: [row | {"seconds": found["seconds"], "seconds before": found["before"], "status": found["status"]}]}


def warm() -> Rows:
    """A row for each command, and one for the import of Numba."""
    work: dict[str, Callable[[], object]] = {FLOOR: partial(_run, ["-c", FLOOR])}
    for command in COMMANDS:
        words = ["-m", "phasebench.benchmarks", *command, "--h", str(H), "--steps", str(STEPS), "--json"]
        work[" ".join(command)] = partial(_run, words)
    rows = []
    for what, rounds in interleaved(work, ROUNDS).items():
        found = median(rounds)
        rows.append({"what": what, "seconds": found.value, "low": found.low, "high": found.high})
    return {WARM: rows}


def _run(words: list[str], **environment: str) -> str:
    """What a process prints; raises RuntimeError where it fails."""
    done = subprocess.run([sys.executable, *words], capture_output=True, text=True, env=os.environ | environment)
    if done.returncode:
        raise RuntimeError(f"{' '.join(words[:4])}: {done.stderr.strip().splitlines()[-1:]}")
    return done.stdout
