"""Peers whose integration is a compiled C or C++ program with the problem's equations: Boost.odeint's and GSL's.

A program exports one of two functions, which return 0 or an error code:

- ``steps(y, h, n, counts)`` takes n steps of h from the state y, which it overwrites with the new state;
- ``times(y, times, n, first step, tol, rows, counts)`` fills ``rows`` with the states at n times.

``counts`` are the numbers of steps, of evaluations, and of rows reached.
"""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from phasebench.reference.native import load_source, statements

from .record import SOLVED, STALLED, Calls, Run, Task
from .run import by_rows

if TYPE_CHECKING:
    import sympy as sp

    from phasebench.integrators.systems.hamiltonian import PartitionedSystem

#: Largest number of steps between two rows.
STEP_LIMIT = 10_000_000
#: First step of Boost.odeint's controlled steppers, that of its examples; GSL's peers choose another.
FIRST_STEP = 0.01
STEPS_TYPES = [ctypes.c_void_p, ctypes.c_double, ctypes.c_long, ctypes.c_void_p]
TIMES_TYPES = [*[ctypes.c_void_p] * 2, ctypes.c_long, *[ctypes.c_double] * 2, *[ctypes.c_void_p] * 2]


def assignments(
    places: Mapping[str, str], expressions: Sequence[sp.Expr], *variables: tuple[str, Sequence[sp.Symbol]]
) -> str:
    """Write statements that set slope[i] to expression i.

    ``variables`` are the pairs (letter, SymPy variables) of `native.statements`; ``places`` are, for each letter, the
    C expression in which {} stands for the index of its variables.
    """
    before, values = statements(expressions, *variables) if expressions else ("", [])
    read = [f"const double {a}_{i} = {places[a].format(i)};" for a, x in variables for i in range(len(x))]
    return " ".join([*read, before, *(f"slope[{i}] = {value};" for i, value in enumerate(values))])


def with_macros(program: str, **macros: object) -> str:
    """A program with macros defined before it, whose names begin with PEER_ so that no header has them."""
    return "".join(f"#define PEER_{name} {value}\n" for name, value in macros.items()) + program


def runs(
    source: Callable[[PartitionedSystem], str], language: str, adaptive: bool, libraries: Sequence[str] = ()
) -> dict[str, Callable]:
    """Make the fields ``run`` and ``prepare`` of a `Peer` from the source of its program for a system.

    The program has the function ``times`` if ``adaptive``, else ``steps``; it is linked with ``libraries``.
    """

    @lru_cache(maxsize=16)
    def function(system: PartitionedSystem) -> Any:
        library = load_source(source(system), language, libraries)
        found = library.times if adaptive else library.steps
        found.argtypes, found.restype = TIMES_TYPES if adaptive else STEPS_TYPES, ctypes.c_int
        return found

    def run_steps(task: Task) -> Run:
        call, y, counts, total = function(task.system), task.state, np.zeros(3, np.int64), np.zeros(3, np.int64)

        def advance(i: int, n: int) -> str | None:
            code = call(y.ctypes.data, task.h, n, counts.ctypes.data)
            total[:] += counts
            return f"it returned {code}" if code else None

        return by_rows(task, advance, y.copy)._replace(steps=int(total[0]), gradient=int(total[1]))

    def run_times(task: Task) -> Run:
        call, y, counts, times = function(task.system), task.state, np.zeros(3, np.int64), np.array(task.times)
        rows = np.zeros((len(times), len(y)))
        first = np.copysign(min(FIRST_STEP, abs(task.h)), task.h)
        pointers = rows.ctypes.data, counts.ctypes.data
        started = time.perf_counter()
        code = call(y.ctypes.data, times.ctypes.data, len(times), first, task.tol, *pointers)
        seconds = time.perf_counter() - started
        rows = rows[: max(int(counts[2]), 1)]
        rows[0] = task.state
        failure = f"it returned {code}: no step met the tolerance" if code else None
        return Run.of_states(rows, int(counts[0]), int(counts[1]), seconds, failure)

    def prepare(task: Task) -> Calls:
        call, tol, times, counts = function(task.system), task.tol, np.zeros(2), np.zeros(3, np.int64)
        begin, y, rows = task.state, task.state, np.zeros((2, 2 * len(task.q)))
        state, at, into, counted = (x.ctypes.data for x in (y, times, rows, counts))

        def restart(state: np.ndarray) -> None:
            begin[:] = state

        def to_time(t_end: float) -> int:
            y[:], times[1] = begin, t_end
            return STALLED if call(state, at, 2, np.copysign(FIRST_STEP, t_end), tol, into, counted) else SOLVED

        def by_steps(h: float, n: int) -> int:
            y[:] = begin
            return STALLED if call(state, h, n, counted) else SOLVED

        return Calls(restart, to_time if adaptive else by_steps, y.copy, (times, counts, rows))

    return {"run": run_times if adaptive else run_steps, "prepare": prepare}
