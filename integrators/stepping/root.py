r"""Choose the parameter x of an energy-preserving step: the root nearest to zero of the step's energy error E(x).

If the quadratic model of E from the last steps can be trusted, its root is followed (`energy_model`).  Otherwise E(0)
is computed: if it is at the round-off of H already, x = 0.  If not, Muller's method goes on from the smaller root of
the model; the other sign of x and the other root of the model are tried if they may be nearer.  If that fails, or ends
far from zero, the solution of the stage equations is continued outwards from x = 0 to the ``radius``, or to the end of
its branch, up to the nearest change of sign of E; where E only jumps there is no root.

Source: D. E. Muller, Math. Tables Aids Comput. 10 (1956) 208-215; M. Dowell, P. Jarratt, BIT 11 (1971) 168-174
(Illinois); for E(x): L. Brugnano, F. Iavernaro, D. Trigiante, SIAM J. Numer. Anal. 50 (2012) 2897-2916.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numba import types

from phasebench.integrators.values.pointers import call, probe
from phasebench.integrators.values.vector import inline, load_state, part, store_state

from .codes import SOLVED
from .energy_model import (
    ALONG,
    BEND,
    CHECKED,
    CURVATURE,
    FIRST,
    FOLLOWED,
    LATEST,
    MISSED,
    RATE,
    SLACK,
    SLOPE,
    START,
    STREAK,
    UNIT,
    Attempt,
    Search,
    extrapolate_slope,
    follower,
    is_trusted,
    muller,
    renew,
    residual_factor,
    smaller_root,
)
from .newton import TABLE
from .solve import LEVELS

if TYPE_CHECKING:
    from phasebench.integrators.values.kinds import Number

MULLER_LIMIT, REFINE_LIMIT = 14, 100
#: Where the states of two attempts are kept in a table: in its last rows.
SLOTS, ROWS = 2, 4


class Probe(NamedTuple):
    """How to try a step: a function and its last argument, or the addresses of both (`pointers.probe`)."""

    f: Any
    e: Any


class Tried(NamedTuple):
    """What is known of an `Attempt` to one who does not know the method: E, the round-off of H, status, and the slot.

    The state is in the rows of this slot.
    """

    E: float
    unit: float
    status: int
    slot: int


@inline
def attempt(x: Number, start: int, ease: Number, step: Probe, slot: int = 0) -> Tried:
    """Try the step with the parameter x, keeping its state in this slot.

    ``start`` says where the iteration for the stage equations starts from, ``ease`` how many times round-off their
    error may be.
    """
    E, unit, status = call(step.f, x, start, ease, slot, step.e)
    return Tried(E, unit, status, slot)


@part
def refine(a: Number, Ea: Number, b: Number, Eb: Number, step: Probe) -> tuple[Number, bool]:
    """Find the root of E between a and b, where its signs differ, by the secant method with bisection (Illinois)."""
    x = b
    side = 0
    for k in range(REFINE_LIMIT):
        x = 0.5 * (a + b) if k % 3 == 2 else b - Eb * (b - a) / (Eb - Ea)
        if not (min(a, b) < x < max(a, b)):
            x = 0.5 * (a + b)
        new = attempt(x, LATEST, 1.0, step)
        if new.status != SOLVED:
            return x, False
        if abs(new.E) <= new.unit or x in (a, b):
            return x, abs(new.E) <= 64 * new.unit
        if (new.E > 0) == (Eb > 0):
            b, Eb = x, new.E
            if side == 1:
                Ea = 0.5 * Ea
            side = 1
        else:
            a, Ea = x, new.E
            if side == 2:
                Eb = 0.5 * Eb
            side = 2
    return x, False


@part
def continue_outwards(side: Number, bound: Number, search: Search, step: Probe) -> tuple[Number, bool]:
    """Continue the solution in x from 0 to ``side * bound`` at most, up to the nearest root of E; (x, found)."""
    E0 = attempt(0.0, FIRST, 1.0, step).E
    inner, Einner, outer, Eouter = 0.0, np.inf, 0.0, E0
    a, Ea, b, Eb, between = 0.0, 0.0, 0.0, 0.0, False
    for k in range(search.points):
        x = side * min(search.radius / search.ratio ** (search.points - 1 - k), bound)
        if x == outer:
            break
        new = attempt(x, LATEST, 1.0, step)
        E = new.E
        if new.status != SOLVED:
            break
        if (E > 0) != (Eouter > 0):
            a, Ea, b, Eb, between = outer, Eouter, x, E, True
            break
        if abs(Einner) < np.inf and abs(Eouter) < abs(Einner) and abs(Eouter) < abs(E):
            # A least |E| between three points of one sign: is there a pair of roots about it?
            c1, c2 = muller(x, inner, outer, E, Einner, Eouter)
            middle = outer - 0.5 * c1 / c2
            new = attempt(middle, LATEST, 1.0, step)
            if new.status == SOLVED and (new.E > 0) != (Eouter > 0):
                a, Ea = (inner, Einner) if abs(middle) < abs(outer) else (outer, Eouter)
                b, Eb, between = middle, new.E, True
                break
            attempt(x, LATEST, 1.0, step)
        inner, Einner, outer, Eouter = outer, Eouter, x, E
    return refine(a, Ea, b, Eb, step) if between else (0.0, False)


@inline
def scan(search: Search, step: Probe) -> tuple[Number, bool]:
    """Continue the solution to both sides of 0; (the root nearest to 0, True if found)."""
    nearest, found = 0.0, False
    for side in (1.0, -1.0):
        x, good = continue_outwards(side, abs(nearest) if found else search.radius, search, step)
        if good and not (found and abs(nearest) <= abs(x)):
            nearest, found = x, True
    return nearest, found


@part
def chase(
    x: Number, E0: Number, unit: Number, search: Search, models: np.ndarray, row: int, step: Probe, slot: int
) -> tuple[Number, bool, Tried]:
    """Find a root of E by Muller's method from the guess x, with E0 = E(0); (x, True if found, the last attempt).

    The slope and curvature of E that are found are written to ``models[row]``; states are kept in ``slot``.
    """
    xa, Ea, xb, Eb = 0.0, E0, 0.0, E0
    c1, c2 = 0.0, models[row, CURVATURE]  # that of the last step's model serves until there is a third point
    new = Tried(np.inf, unit, SOLVED, slot)
    for k in range(MULLER_LIMIT):
        ease = residual_factor(Eb, unit)
        new = attempt(x, ALONG, ease, step, slot)
        if ease > 1 and abs(new.E) < ease * unit:  # too near for so easy a solution
            ease = 1.0
            new = attempt(x, LATEST, 1.0, step, slot)
        E = new.E
        if new.status != SOLVED:
            break
        if k == 0:
            c1 = (E - E0) / x + c2 * x
        elif x != xb and x != xa and xa != xb:
            c1, c2 = muller(xa, xb, x, Ea, Eb, E)
        if k == 1 and abs(Eb) > 1e4 * unit:
            models[row, SLOPE], models[row, CURVATURE] = c1 - 2 * c2 * x, c2
        elif k < 2:
            models[row, SLOPE] = (E - E0) / x - models[row, CURVATURE] * x
        if ease == 1 and (abs(E) <= unit or (k > 1 and abs(E) <= SLACK * unit and abs(E) >= 0.5 * abs(Eb))):
            return x, True, new
        move = smaller_root(E, c1, c2)
        if not abs(x + move) <= search.radius and Eb != E:
            move = -E * (x - xb) / (E - Eb)  # the parabola has no root: the secant
        xa, Ea, xb, Eb = xb, Eb, x, E
        x = x + move
        if not abs(x) <= search.radius or x == xb:
            break
    return x, False, new


@part
def nearer_side(x: Number, E0: Number, ease: Number, models: np.ndarray, row: int, step: Probe) -> Number:
    """Guess a root nearer than x on the other side of 0, from a trial step with -x; x if there is none.

    Slope and curvature of the parabola through E(0) = E0, E(x) = 0 (as guessed) and E(-x) are written to
    ``models[row]``.
    """
    beyond = attempt(-x, ALONG, ease, step)
    if beyond.status != SOLVED:
        return x
    c2 = 0.5 * (beyond.E - 2 * E0) / (x * x)
    c1 = -(E0 + c2 * x * x) / x
    models[row, SLOPE], models[row, CURVATURE] = c1, c2
    if (beyond.E > 0) == (E0 > 0):
        return x
    nearer = smaller_root(E0, c1, c2)
    return nearer if abs(nearer) < abs(x) and nearer * x < 0 else -0.5 * x


@inline
def search_out(
    search: Search, models: np.ndarray, row: int, predicted: Number, step: Probe
) -> tuple[Number, bool, Tried]:
    """Search for the root: compute E(0), iterate, and where that fails, `scan`; (x, found, the attempt at x)."""
    radius = search.radius
    ease = residual_factor(models[row, START], models[row, UNIT])
    result = attempt(0.0, FIRST, ease, step)
    if ease > 1 and abs(result.E) < ease * result.unit:
        result = attempt(0.0, LATEST, 1.0, step)
    E0, unit = result.E, result.unit
    models[row, START], models[row, UNIT] = E0, unit
    if result.status != SOLVED or abs(E0) <= unit:
        return 0.0, True, result
    x = smaller_root(E0, models[row, SLOPE], models[row, CURVATURE])
    if not 0 < abs(x) <= radius:
        x = search.first
    elif abs(predicted - x) <= 0.25 * abs(x) and models[row, STREAK] < FOLLOWED:
        x = predicted  # the model picks the branch, the last roots say more exactly where it is now
    if abs(x) > CHECKED:
        x = nearer_side(x, E0, residual_factor(E0, unit), models, row, step)
    found, guess = False, x
    for slot in range(SLOTS):
        end, good, last = chase(guess, E0, unit, search, models, row, step, slot)
        if slot == 0 or (good and abs(end) < abs(x)):
            x, found, result = end, good, last
        if not (found and abs(E0) < 1.2 * abs(models[row, CURVATURE]) * x * x):
            break
        guess = E0 / (models[row, CURVATURE] * x)  # the product of the model's two roots is E0 / c2: the other one
    if found and abs(x) <= search.near:
        return x, True, result
    if abs(E0) <= search.slack * unit:
        x, found = 0.0, True
    else:
        x, found = scan(search, step)
        if not found:
            x = 0.0  # the place where E jumps is no place to take the step at
    if found and x != 0:
        models[row, SLOPE], models[row, CURVATURE] = -E0 / x, 0.0
    return x, found, attempt(x, LATEST if found and x != 0 else FIRST, 1.0, step)


def search_anew(
    search: Search, models: np.ndarray, row: int, predicted: Number, c1: Number, f: Any, e: Any
) -> tuple[Number, bool, Tried]:
    """Find the root x of E where it is not followed from the last step; (x, True if found, the attempt at x).

    ``models[row]``, the quadratic model of E with its changes from step to step, is updated; c1 is its slope at x = 0,
    extrapolated to this step, and ``predicted`` is x extrapolated from earlier steps.  f and e try a step (`Probe`).
    """
    known, old = models[row, STREAK] > 0, models[row, SLOPE]
    if known:
        models[row, SLOPE] = c1
    x, found, result = search_out(search, models, row, predicted, Probe(f, e))
    models[row, MISSED] = abs(x - predicted)
    if not found or x == 0:
        models[row, STREAK] = -LEVELS
        return x, found, result
    new, models[row, SLOPE] = models[row, SLOPE], old
    renew(models, row, new)
    if not known:
        models[row, RATE], models[row, BEND] = 0.0, 0.0
    models[row, STREAK] = 1.0 if known else models[row, STREAK] + 1
    return x, found, result


_TRIED = types.NamedTuple((types.float64, types.float64, types.int64, types.int64), Tried)
_SEARCH = types.NamedTuple((*4 * (types.float64,), types.int64, types.float64), Search)
SIGNATURE = types.Tuple((types.float64, types.boolean, _TRIED))(
    _SEARCH, TABLE, types.int64, types.float64, types.float64, types.intp, types.intp
)


def finder(attempt: Callable, table: Callable, followed: bool = True) -> Callable:
    """Make the function that finds the parameter x at which a step's energy error E(x) is zero, nearest to x = 0.

    The function is (search, models, row, predicted, arguments, work) -> (x, True if found, the `Attempt` at x); x = 0
    if there is no root, or if E jumps from one sign to the other.  ``search`` is a `Search`, ``models[row]`` keeps the
    quadratic model of E from step to step, ``predicted`` is the root extrapolated from earlier steps, ``arguments``,
    with the field y, is passed to ``attempt``, and ``work`` has the field search, which is `search_anew`.

    ``attempt(x, start, ease, arguments)`` tries a step with the parameter x and returns an `Attempt`.  ``start`` says
    where its stage equations start from, ``ease`` how many times round-off their error may be.
    ``table(arguments)`` is an array, the last `SLOTS` x `ROWS` rows of which keep states of attempts.

    With ``followed=False`` roots are not followed from step to step: ``predicted`` is NaN, every step searches, and the
    code that follows roots is not compiled.
    """

    def keep(x, start, ease, slot, e):
        new, rows = attempt(x, start, ease, e), table(e)
        store_state(rows, len(rows) - ROWS * (slot + 1), new.y)
        return new.E, new.unit, new.status

    pointers, follow = probe(keep), follower(attempt)

    @inline
    def find(
        search: Search, models: np.ndarray, row: int, predicted: Number, arguments: Any, work: Any
    ) -> tuple[Number, bool, Attempt]:
        c1 = extrapolate_slope(models, row)
        if followed and is_trusted(search, models, row, predicted, c1, c1 + 2 * models[row, CURVATURE] * predicted):
            x, found, result = follow(search, models, row, predicted, c1, arguments)
            if found:
                return x, True, result
        f, e = pointers(arguments)
        x, found, tried = work.search(search, models, row, predicted, c1, f, e)
        rows = table(arguments)
        y = load_state(rows, len(rows) - ROWS * (tried.slot + 1), arguments.y.q)
        return x, found, Attempt(y, tried.E, tried.unit, tried.status)

    return find
