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
from typing import NamedTuple

from phasebench.benchmarks.measure.timing import median, time_in_turns
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import ALONE, Cell, ProblemKey, Rows, content
from phasebench.integrators.registry import method

COLD, WARM = "start_cold", "start_warm"
#: Number of steps, few enough to take no time; the step size.
STEPS, H = 10, 0.01
ROUNDS = 5


class First(NamedTuple):
    """A first integration to be timed: the method's id, the problem's name, and the problem's parameters as pairs."""

    method: str
    problem: str
    parameters: tuple[tuple[str, float], ...] = ()


FOUR = ("toda", (("N", 4),))
#: A method for each kernel, the slowest to compile, at d = 4 if it runs there; some at d = 2 for comparison; the
#: slowest on a system that is not separable.
FIRSTS = (
    *(
        First(id, *FOUR)
        for id in (
            "rk4",
            "stormer-verlet",
            "chin-4a",
            "blanes-p7-6",
            "blanes-moan-srkn14a",
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
            "tao-6",
            "jayawardana-ohsawa-4",
            "quinlan-tremaine-14",
        )
    ),
    First("gautschi", "fpu", (("m", 2),)),
    First("gauss-8-adaptive", "perturbed-kepler"),
    First("gauss-8-field", "perturbed-kepler"),
    First("wisdom-holman-corrector", "perturbed-kepler"),
    First("fcirk", "perturbed-kepler"),
    First("he-splitting-4", "magnetic-mirror"),
    First("rattle-yoshida-4", "double-pendulum-cartesian"),
    First("lobatto-iiia-iiib-constrained-6", "double-pendulum-cartesian"),
    First("rigid-reich-suzuki-4", "heavy-top"),
    First("moser-veselov", "heavy-top"),
    First("abc-6", "kerr"),
    First("stormer-verlet", "henon-heiles"),
    First("gauss-equip-4", "henon-heiles"),
    First("gauss-equip-4", "schwarzschild"),
    First("implicit-midpoint-symmetric-projection", "schwarzschild"),
)
#: Arguments of the commands that are started warm.  `FLOOR` is a process that only imports Numba.
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
    """List the measurements: a `Cell` for each cold start, and one for all warm starts, which are timed in turns.

    A `Cell` is a function, its arguments and the tables that its rows go to.  The list does not depend on ``quick``:
    each `Cell` is marked by a flag of its own as part of a quick run or not.
    """
    return [*map(_cold, FIRSTS), _warm()]


def _cold(first: First) -> Cell:
    chosen, made = method(first.method), ProblemKey(first.problem, first.parameters)
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
    needs = content(
        "warm", [c[1:] for c in COMMANDS], ROUNDS, *parts, code=[__name__, "phasebench.benchmarks.cli.integrate"]
    )
    return Cell("start", (WARM,), {}, warm, (), needs, frozenset(words), ALONE, own=True)


def _label(first: First) -> str:
    more = ", ".join(f"{name} = {value:g}" for name, value in first.parameters)
    return f"{first.problem}{f', {more}' if more else ''}"


def cold(id: str, name: str, parameters: tuple = (), cache: str | None = None) -> Rows:
    """Time the first integration of a method on a problem in a new Python process.

    ``id`` is the method's, ``name`` the problem's, ``parameters`` are pairs (name, value) of the problem.  Compiled
    code is cached in the folder ``cache``, or in an empty temporary one.  Returns {`COLD`: [row]}, with the processor
    time of the integration in seconds and its status.
    """
    with tempfile.TemporaryDirectory() as empty:
        told = json.dumps([id, name, parameters, H, STEPS])
        found = json.loads(_run(["-c", SCRIPT, told], PHASEBENCH_CACHE=cache or empty).splitlines()[-1])
    d = problem(name, **dict(parameters)).system.d
    row = {"method": id, "problem": _label(First(id, name, parameters)), "family": method(id).family, "d": d}
    return {COLD: [row | {"seconds": found["seconds"], "seconds before": found["before"], "status": found["status"]}]}


def warm() -> Rows:
    """Time each command of `COMMANDS` as a whole process, with all code compiled before, and the import of Numba.

    Returns {`WARM`: rows}: for each the median seconds by the clock, with its interval.
    """
    work: dict[str, Callable[[], object]] = {FLOOR: partial(_run, ["-c", FLOOR])}
    for command in COMMANDS:
        words = ["-m", "phasebench", *command, "--h", str(H), "--steps", str(STEPS), "--json"]
        work[" ".join(command)] = partial(_run, words)
    rows = []
    for what, rounds in time_in_turns(work, ROUNDS).items():
        found = median(rounds)
        rows.append({"what": what, "seconds": found.value, "low": found.low, "high": found.high})
    return {WARM: rows}


def _run(words: list[str], **environment: str) -> str:
    """Run Python with the arguments ``words`` and further environment variables; return its standard output.

    Raises RuntimeError if the process fails.
    """
    done = subprocess.run([sys.executable, *words], capture_output=True, text=True, env=os.environ | environment)
    if done.returncode:
        raise RuntimeError(f"{' '.join(words[:4])}: {done.stderr.strip().splitlines()[-1:]}")
    return done.stdout
