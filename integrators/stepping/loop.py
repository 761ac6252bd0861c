"""The loop over rows and steps: it calls a family's ``step`` (see `kernel`), fills rows, keeps the state between calls.

`loop` makes a family's ``run`` from the functions

- ``step(method, y, carry, counts)`` -> (y, status): one step from y; ``method`` is the family's NamedTuple with h and
  eps, the status `solve.SOLVED` or why the step could not be taken.  It adds its evaluations, solves by Newton's method
  and fallbacks to ``counts``; ``counts.steps`` is the number of steps before it.
- ``begin(method, carry, counts)`` -> y: what a step starts from, read where the last call left it; by default the
  `vector.State` (q, p, what rounding lost of q, of p).  A y of one's own has these fields and others.
- ``start(method, y)`` -> y and ``finish(method, y)`` -> y: before the first step after a row, and before the next row.
  A method whose steps share a substep, as the last kick of one is the first of the next, parts them there.

A step that chooses a parameter writes it to ``counts.parameter``, NaN if it found none; ``parameter=True`` tells the
loop to enter that of each row's last step in the samples.

`by_time` is the loop of methods that choose the length of their steps: ``reach`` integrates to the time of a row.
"""

from __future__ import annotations

from collections.abc import Callable

from phasebench.integrators.values import vector
from phasebench.integrators.values.vector import part_of_caller

from .solve import SOLVED


def _open(method, carry, counts):
    return vector.opened(carry)


def _unchanged(method, y):
    return y


def _no_parameter(samples, row, counts):
    pass


def _enter_parameter(samples, row, counts):
    samples.parameter[row, 0] = counts.parameter


def _named(run: Callable, family: str) -> Callable:
    """Return ``run`` under the name ``family.run``, by which kernels are kept and pickles find it."""
    run.__module__ = family
    run.__qualname__ = run.__name__
    return run


def loop(
    step: Callable,
    begin: Callable = _open,
    start: Callable = _unchanged,
    finish: Callable = _unchanged,
    parameter: bool = False,
) -> Callable:
    """The kernel (method, carry, samples, counts) -> (rows filled, status) of a family's functions (see above)."""
    begin, start, step_once, finish = map(part_of_caller, (begin, start, step, finish))
    enter = part_of_caller(_enter_parameter if parameter else _no_parameter)

    def run(method, carry, samples, counts):
        y = begin(method, carry, counts)
        for row in range(len(samples.q)):
            y = start(method, y)
            for _ in range(samples.every):
                y, status = step_once(method, y, carry, counts)
                if status != SOLVED:
                    vector.close(carry, y)
                    return row, status
                counts.steps += 1
            y = finish(method, y)
            vector.keep(samples, row, y)
            enter(samples, row, counts)
        vector.close(carry, y)
        return len(samples.q), SOLVED

    return _named(run, step.__module__)


#: Where the state's spare rows count the multiples of h up to which a method that chooses its steps has been asked.
ASKED = 6, 0


def by_time(resume: Callable, reach: Callable, leave: Callable) -> Callable:
    """The kernel of a method that chooses its steps.

    - ``resume(method, carry, y)`` -> clock: where the last call left it (`leave`); makes the first.
    - ``reach(method, carry, y, clock, until, every, counts)`` -> (y, clock, there, status): steps to the last state y
      before the time ``until``, and from there to the state ``there`` at that time, by a step that the orbit does not
      take.
    - ``leave(carry, clock)`` keeps the clock for the next call.
    """

    def run(method, carry, samples, counts):
        y = vector.opened(carry)
        clock = resume(method, carry, y)
        row, status = 0, SOLVED
        while row < len(samples.q) and status == SOLVED:
            until = (carry.state[ASKED] + samples.every) * method.h
            y, clock, there, status = reach(method, carry, y, clock, until, samples.every, counts)
            if status == SOLVED:
                vector.keep(samples, row, there)
                carry.state[ASKED] += samples.every
                row += 1
        leave(carry, clock)
        vector.close(carry, y)
        return row, status

    return _named(run, reach.py_func.__module__ if hasattr(reach, "py_func") else reach.__module__)
