"""The loop over the steps of a run: it calls a method's ``step``, and stores every so many steps a row of output.

A *family* is a module for one kind of method (`kernel`).  `loop` makes its compiled loop, the *kernel* ``run``, from

- ``step(method, y, carry, counts)`` -> (y, status): one step from y; ``method`` is the family's NamedTuple with h and
  eps, the status `solve.SOLVED` or why the step could not be taken.  It adds its evaluations, solves by Newton's method
  and fallbacks to ``counts``; ``counts.steps`` is the number of steps before it.
- ``begin(method, carry, counts)`` -> y: what a step starts from, read from ``carry``, where the last call of the kernel
  left it; by default the `vector.State` (q, p, what rounding lost of q, of p).  Another y has these fields and more.
- ``start(method, y)`` -> y and ``finish(method, y)`` -> y: called before the first step after a row, and before the
  next row is stored.  If successive steps share a substep, as the last kick of one is the first of the next, ``finish``
  completes the last step and ``start`` begins the next one.

A step that chooses a parameter writes it to ``counts.parameter``, NaN if it found none; with ``parameter=True`` the
loop stores that of the last step before each row.

`time_loop` makes the loop of methods that choose the length of their steps: ``reach`` integrates to the time of a row.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from phasebench.integrators.compile import machine
from phasebench.integrators.values import vector
from phasebench.integrators.values.vector import State, inline

from .codes import SOLVED
from .kernel import OWN, Carry, Samples


def _read_state(method: NamedTuple, carry: Carry, counts: np.record) -> State:
    return vector.read_state(carry)


def _keep_state(method: NamedTuple, y: State) -> State:
    return y


def _ignore_parameter(samples: Samples, row: int, counts: np.record) -> None:
    pass


def _enter_parameter(samples: Samples, row: int, counts: np.record) -> None:
    samples.parameter[row, 0] = counts.parameter


def _run(method: NamedTuple, carry: Carry, samples: Samples, counts: np.record) -> tuple[int, int]:
    y = begin(method, carry, counts)  # noqa: F821 (`loop` sets the functions)
    for row in range(len(samples.q)):
        y = start(method, y)  # noqa: F821
        for _ in range(samples.every):
            y, status = step(method, y, carry, counts)  # noqa: F821
            if status != SOLVED:
                vector.write_state(carry, y)
                return row, status
            counts.steps += 1
        y = finish(method, y)  # noqa: F821
        vector.write_sample(samples, row, y)
        enter(samples, row, counts)  # noqa: F821
    vector.write_state(carry, y)
    return len(samples.q), SOLVED


def loop(
    step: Callable,
    begin: Callable = _read_state,
    start: Callable = _keep_state,
    finish: Callable = _keep_state,
    parameter: bool = False,
) -> Callable:
    """Make the kernel, the loop over steps, of a family from its functions, which this module's docstring describes.

    The kernel is (method, carry, samples, counts) -> (number of rows filled, status).  It starts from the state in
    ``carry`` (`kernel.Carry`), fills ``samples`` (`kernel.Samples`) with a row every ``samples.every`` steps, and
    writes the last state to ``carry``.
    """
    enter = _enter_parameter if parameter else _ignore_parameter
    functions = {"begin": begin, "start": start, "step": step, "finish": finish, "enter": enter}
    return _bind(_run, step.__module__, {name: inline(f) for name, f in functions.items()})


def _bind(run: Callable, family: str, functions: dict[str, Callable]) -> Callable:
    """Return a copy of ``run`` in which the names in ``functions`` stand for these functions.

    It is called ``run`` in the module ``family``, the name under which it is cached.
    """
    made = machine.with_functions(run, functions)
    made.__module__, made.__name__, made.__qualname__ = family, "run", "run"
    return made


#: Entry of ``carry.state`` with the time of the last row of output in units of h, for methods that choose their steps.
ASKED = OWN + 2, 0


def time_loop(resume: Callable, reach: Callable, leave: Callable) -> Callable:
    """Make the kernel (method, carry, samples, counts) -> (rows filled, status) of methods with variable steps.

    Its rows are the states at multiples of ``samples.every`` h.  It is made from the functions

    - ``resume(method, carry, y)`` -> clock: the time and what else the step control needs, as ``leave`` stored it in
      the last call of the kernel, or at the start of a run.
    - ``reach(method, carry, y, clock, until, every, counts)`` -> (y, clock, there, status): makes steps as long as they
      end before ``until``, the time of the next row, which is ``every`` h after the row before.  y and ``clock`` are
      those after the last of these steps; ``there`` is the state at ``until``, by one more step from y that serves the
      output alone and does not belong to the orbit.
    - ``leave(carry, clock)`` stores the clock for the next call.
    """

    functions = {"resume": resume, "reach": reach, "leave": leave}
    return _bind(_run_by_time, reach.py_func.__module__ if hasattr(reach, "py_func") else reach.__module__, functions)


def _run_by_time(method: NamedTuple, carry: Carry, samples: Samples, counts: np.record) -> tuple[int, int]:
    y = vector.read_state(carry)
    clock = resume(method, carry, y)  # noqa: F821 (`time_loop` sets the functions)
    row, status = 0, SOLVED
    while row < len(samples.q) and status == SOLVED:
        until = (carry.state[ASKED] + samples.every) * method.h
        y, clock, there, status = reach(method, carry, y, clock, until, samples.every, counts)  # noqa: F821
        if status == SOLVED:
            vector.write_sample(samples, row, there)
            carry.state[ASKED] += samples.every
            row += 1
    leave(carry, clock)  # noqa: F821
    vector.write_state(carry, y)
    return row, status
