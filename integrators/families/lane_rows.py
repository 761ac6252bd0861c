r"""Functions shared by the kernels `stage_lanes` and `path_lanes`, which have stages or quadrature nodes in SIMD lanes.

The equations of a kernel are a NamedTuple with a ``memory``, a table whose columns are the lanes, as many as the tuple
``like`` has items.  The unknowns are increments of q and p or, where the step's ``inverse_mass`` is not None, of p
alone (kicks); the equations' field ``stages`` is the number of components of an increment.  The rows of the memory are:

- from 0 on: the points, called places, at which the step's function f(memory) evaluates the vector field or -grad V;
  each component of (q, p), or of q alone, has a row;
- after them: the values of the field or of -grad V that f writes, as many rows;
- from ``base`` on: the rows `ORIGIN` to `DP`, with the state before the step, h M^-1 p, and the increments of q and p
  over the step; from ``base + FREE`` on what the kernel itself keeps.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from phasebench.integrators.values.lanes import combine, put, take, total
from phasebench.integrators.values.vector import dispatch_on_none, inline, load, store, update

if TYPE_CHECKING:
    from phasebench.integrators.values.kinds import Function, Number, Value
    from phasebench.integrators.values.vector import State

#: Rows from ``base`` on: the state that the places begin at, h M^-1 p, and the increments of q and of p over a step;
#: before there are increments the row of DQ holds, for kicks, p.
ORIGIN, DRIFT, DQ, DP, FREE = range(5)
MOMENTA = DQ

# -- the two forms ----------------------------------------------------------------------------------------------------


def _begin_both(inverse_mass, e, y):
    store(e.memory, e.base + ORIGIN, y.q)
    for k in range(len(y.p)):
        e.memory[e.base + ORIGIN, len(y.q) + k] = y.p[k]


def _begin_kicks(inverse_mass, e, y):
    memory = e.memory
    store(memory, e.base + ORIGIN, y.q)
    store(memory, e.base + MOMENTA, y.p)
    for k in range(e.stages):
        memory[e.base + DRIFT, k] = e.h * inverse_mass[0, k] * memory[e.base + MOMENTA, k]


def _lengths_of_both(inverse_mass, e, at):
    d = e.stages // 2
    return length(e, at, e.base + ORIGIN, 0, d), length(e, at, e.base + ORIGIN, d, e.stages)


def _lengths_of_kicks(inverse_mass, e, at):
    momenta = length(e, at, e.base + MOMENTA, 0, e.stages)
    return momenta, momenta


#: Number of components of an increment, for d degrees of freedom.
components = dispatch_on_none(lambda inverse_mass, d: 2 * d, lambda inverse_mass, d: d)
#: Write the state at the begin of the step, for its equations.
begin = dispatch_on_none(_begin_both, _begin_kicks)
#: Sizes of the variables that the first and the second half of the rows ``at``, ... belong to.
_lengths = dispatch_on_none(_lengths_of_both, _lengths_of_kicks)


@inline
def lengths(e: Any, at: int) -> tuple[Number, Number]:
    """Sizes of the variables that the first and the second half of the rows ``at``, ... belong to (`row_solver`)."""
    return _lengths(e.step.inverse_mass, e, at)


@inline
def shape(e: Any, n: int) -> tuple[int, int]:
    """The shape of unknowns in the first n lanes (`row_solver`): half of the rows is of q, half of p."""
    return n, max(1, e.stages * n // 2)


@inline
def length(e: Any, at: int, row: int, first: int, last: int) -> Number:
    """Size (1-norm) of the components first, ..., last - 1 of q or p in a step, by which finite differences are scaled.

    It is the sum of three 1-norms: of the state before the step, in row ``row`` of ``e.memory``; of the unknown
    increments x, in the rows from ``at`` on, a row for each component; and of the right-hand sides G(x) of the
    equations x = G(x), in the ``e.stages`` rows after x.
    """
    numbers, unknowns = 0.0, 0.0
    for k in range(first, last):
        numbers = numbers + abs(e.memory[row, k])
        x, g = take(e.memory, at + k, e.like), take(e.memory, at + e.stages + k, e.like)
        unknowns = unknowns + total(abs(x) + abs(g))
    return numbers + unknowns


# -- from step to step ------------------------------------------------------------------------------------------------


@inline
def extrapolate(e: Any, ring: int, known: int, at: int) -> None:
    """Write a start of the iteration to the rows ``at``, ...: the last steps' increments, extrapolated to this step.

    The increments of the last steps are in a ring buffer, in the rows of ``e.memory`` from ``ring`` on; ``known`` is
    the number of steps taken so far.
    """
    step, memory, rows = e.step, e.memory, e.stages
    steps = min(known, step.steps)
    row = steps * (steps - 1) // 2 * len(e.like)
    for k in range(rows):
        x = 0.0 * take(step.extrapolation, 0, e.like)
        for back in range(steps, 0, -1):
            y = take(memory, ring + (known - back) % step.steps * rows + k, e.like)
            x = combine(x, y, 1.0, step.extrapolation, row + (back - 1) * len(e.like), e.like)
        put(memory, at + k, x, e.like)


@inline
def enter(e: Any, ring: int, known: int, at: int) -> None:
    """Store the increments of step number ``known`` in the ring buffer that `extrapolate` reads.

    The increments are in the rows of ``e.memory`` from ``at`` on, the buffer is in those from ``ring`` on.
    """
    newest = ring + known % e.step.steps * e.stages
    for k in range(e.stages):
        put(e.memory, newest + k, take(e.memory, at + k, e.like), e.like)


def ender(sums: Function) -> Function:
    """Make the function (e, at, y, zero) -> the state after a step from the state y, whose equations e are solved.

    ``sums(inverse_mass, e, at)`` writes the increments of q and p to the memory of e, from the stage increments in the
    rows from ``at`` on; the function adds them to y.  ``zero`` is a zero of the shape of q.
    """

    @inline
    def end(e: Any, at: int, y: State, zero: Value) -> State:
        sums(e.step.inverse_mass, e, at)
        return update(y, load(e.memory, e.base + DQ, zero), load(e.memory, e.base + DP, zero))

    return end
