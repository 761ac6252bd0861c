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
from typing import TYPE_CHECKING, Any

import numpy as np

from phasebench.integrators.values.vector import forbid_inlining, inline, jit

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
    extrapolate_slope,
    follower,
    is_trusted,
    muller,
    renew,
    residual_factor,
    smaller_root,
)
from .solve import LEVELS

if TYPE_CHECKING:
    from phasebench.integrators.stepping.energy_model import Search
    from phasebench.integrators.values.kinds import Number

MULLER_LIMIT, REFINE_LIMIT = 14, 100


def finder(attempt: Callable, followed: bool = True) -> Callable:
    """Make the function that finds the parameter x at which a step's energy error E(x) is zero, nearest to x = 0.

    The function is (search, models, row, predicted, arguments) -> (x, True if found, the `Attempt` at x); x = 0 if
    there is no root, or if E jumps from one sign to the other.  ``search`` is a `Search`, ``models[row]`` keeps the
    quadratic model of E from step to step, ``predicted`` is the root extrapolated from earlier steps, and
    ``arguments``, with the field y, is passed to ``attempt``.

    ``attempt(x, start, ease, arguments)`` tries a step with the parameter x and returns an `Attempt`.  ``start`` says
    where its stage equations start from, ``ease`` how many times round-off their error may be.

    With ``followed=False`` roots are not followed from step to step: ``predicted`` is NaN, every step searches, and the
    code that follows roots is not compiled.
    """

    @jit
    def eased_attempt(x: Number, start: int, ease: Number, arguments: Any) -> Attempt:
        """Call ``attempt(x, start, ease, arguments)``, a trial step, as a function that is compiled only once.

        It is not inlined, unlike `attempt` itself.
        """
        forbid_inlining()
        return attempt(x, start, ease, arguments)

    @inline
    def apart_attempt(x: Number, start: int, arguments: Any) -> Attempt:
        """Try the step with parameter x by `eased_attempt`, with its stage equations solved to round-off.

        ``start`` says where the iteration for these starts from.
        """
        return eased_attempt(x, start, 1.0, arguments)

    @jit
    def refine(a: Number, Ea: Number, b: Number, Eb: Number, arguments: Any) -> tuple[Number, bool]:
        """Find the root of the energy error E(x) between a and b, where Ea = E(a) and Eb = E(b) differ in sign.

        Uses the secant method with bisection (Illinois).  Returns (x, True if found).
        """
        x = b
        side = 0
        for k in range(REFINE_LIMIT):
            x = 0.5 * (a + b) if k % 3 == 2 else b - Eb * (b - a) / (Eb - Ea)
            if not (min(a, b) < x < max(a, b)):
                x = 0.5 * (a + b)
            new = apart_attempt(x, LATEST, arguments)
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

    @jit
    def continue_outwards(side: Number, bound: Number, search: Search, arguments: Any) -> tuple[Number, bool]:
        """Search outwards from x = 0, on one side, for the nearest root of a step's energy error E(x).

        The solution of the stage equations is continued in x, from 0 to ``side * bound`` at most; ``side`` is 1 or -1.
        Returns (x, True if a root was found).
        """
        E0 = apart_attempt(0.0, FIRST, arguments).E
        inner, Einner, outer, Eouter = 0.0, np.inf, 0.0, E0
        for k in range(search.points):
            x = side * min(search.radius / search.ratio ** (search.points - 1 - k), bound)
            if x == outer:
                break
            new = apart_attempt(x, LATEST, arguments)
            E = new.E
            if new.status != SOLVED:
                break
            if (E > 0) != (Eouter > 0):
                return refine(outer, Eouter, x, E, arguments)
            if abs(Einner) < np.inf and abs(Eouter) < abs(Einner) and abs(Eouter) < abs(E):
                # A least |E| between three points of one sign: is there a pair of roots about it?
                c1, c2 = muller(x, inner, outer, E, Einner, Eouter)
                middle = outer - 0.5 * c1 / c2
                new = apart_attempt(middle, LATEST, arguments)
                if new.status == SOLVED and (new.E > 0) != (Eouter > 0):
                    if abs(middle) < abs(outer):
                        return refine(inner, Einner, middle, new.E, arguments)
                    return refine(outer, Eouter, middle, new.E, arguments)
                apart_attempt(x, LATEST, arguments)
            inner, Einner, outer, Eouter = outer, Eouter, x, E
        return 0.0, False

    @inline
    def scan(search: Search, arguments: Any) -> tuple[Number, bool]:
        """Find the parameter x nearest zero at which the step's energy error E(x) vanishes: (x, True if found).

        The solution of the stage equations is continued from x = 0 to both sides.
        """
        above, found = continue_outwards(1.0, search.radius, search, arguments)
        below, second = continue_outwards(-1.0, abs(above) if found else search.radius, search, arguments)
        if second and not (found and abs(above) <= abs(below)):
            return below, True
        return above, found

    @jit
    def chase(
        x: Number, E0: Number, unit: Number, search: Search, models: np.ndarray, row: int, arguments: Any
    ) -> tuple[Number, bool, Attempt]:
        """Find a root of the energy error E(x) by Muller's method, from the guess x and the known value E0 = E(0).

        ``unit`` is the round-off of H; the slope and curvature of E that are found are written to ``models[row]``.
        Returns (x, True if found, the last `Attempt`).
        """
        forbid_inlining()
        xa, Ea, xb, Eb = 0.0, E0, 0.0, E0
        c1, c2 = 0.0, models[row, CURVATURE]  # that of the last step's model serves until there is a third point
        new = Attempt(arguments.y, np.inf, unit, SOLVED)
        for k in range(MULLER_LIMIT):
            ease = residual_factor(Eb, unit)
            new = eased_attempt(x, ALONG, ease, arguments)
            if ease > 1 and abs(new.E) < ease * unit:  # too near for so easy a solution
                ease = 1.0
                new = apart_attempt(x, LATEST, arguments)
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

    @jit
    def nearer_side(x: Number, E0: Number, ease: Number, models: np.ndarray, row: int, arguments: Any) -> Number:
        """Check by a trial step with -x whether the energy error E has a root of the other sign, nearer than guess x.

        Returns a guess of that root, or x if none is found.  E0 is E(0); the trial's stage equations may be solved with
        an error of ``ease`` times round-off.  Slope and curvature of the parabola through E(0) = E0, E(x) = 0 (as
        guessed) and E(-x) are written to ``models[row]``.
        """
        forbid_inlining()
        beyond = eased_attempt(-x, ALONG, ease, arguments)
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
        search: Search, models: np.ndarray, row: int, predicted: Number, arguments: Any
    ) -> tuple[Number, bool, Attempt]:
        """Search for the root x of the energy error E(x): compute E(0), iterate, and where that fails, `scan`.

        ``models[row]`` is the quadratic model of E, which gives the first guess and is updated; ``predicted`` is x
        extrapolated from earlier steps.  Returns (x, True if found, the `Attempt` at x).
        """
        radius = search.radius
        ease = residual_factor(models[row, START], models[row, UNIT])
        result = eased_attempt(0.0, FIRST, ease, arguments)
        if ease > 1 and abs(result.E) < ease * result.unit:
            result = apart_attempt(0.0, LATEST, arguments)
        E0, unit = result.E, result.unit
        models[row, START], models[row, UNIT] = E0, unit
        if result.status != SOLVED or abs(E0) <= unit:
            return 0.0, True, result
        x = smaller_root(E0, models[row, SLOPE], models[row, CURVATURE])
        if not 0 < abs(x) <= radius:
            x = search.first
        elif followed and abs(predicted - x) <= 0.25 * abs(x) and models[row, STREAK] < FOLLOWED:
            x = predicted  # the model picks the branch, the last roots say more exactly where it is now
        if abs(x) > CHECKED:
            x = nearer_side(x, E0, residual_factor(E0, unit), models, row, arguments)
        x, found, result = chase(x, E0, unit, search, models, row, arguments)
        if found and abs(E0) < 1.2 * abs(models[row, CURVATURE]) * x * x:
            # The product of the model's two roots is E0 / c2: the other one may be nearer.
            other = E0 / (models[row, CURVATURE] * x)
            nearer, better, second = chase(other, E0, unit, search, models, row, arguments)
            if better and abs(nearer) < abs(x):
                x, result = nearer, second
        if found and abs(x) <= search.near:
            return x, True, result
        if abs(E0) <= search.slack * unit:
            x, found = 0.0, True
        else:
            x, found = scan(search, arguments)
            if not found:
                x = 0.0  # the place where E jumps is no place to take the step at
        if found and x != 0:
            models[row, SLOPE], models[row, CURVATURE] = -E0 / x, 0.0
        return x, found, apart_attempt(x, LATEST if found and x != 0 else FIRST, arguments)

    @jit
    def search_anew(
        search: Search, models: np.ndarray, row: int, predicted: Number, c1: Number, arguments: Any
    ) -> tuple[Number, bool, Attempt]:
        """Find the root x of the energy error E(x) by `search_out`, where it is not followed from the last step.

        ``models[row]``, the quadratic model of E with its changes from step to step, is updated; c1 is its slope at
        x = 0, extrapolated to this step, and ``predicted`` is x extrapolated from earlier steps.  Returns (x, True if
        found, the `Attempt` at x).
        """
        forbid_inlining()
        known, old = models[row, STREAK] > 0, models[row, SLOPE]
        if known:
            models[row, SLOPE] = c1
        x, found, result = search_out(search, models, row, predicted, arguments)
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

    follow = follower(attempt)

    @inline
    def find(
        search: Search, models: np.ndarray, row: int, predicted: Number, arguments: Any
    ) -> tuple[Number, bool, Attempt]:
        """Find the root x of the energy error E(x): follow it from earlier steps, or search for it.

        ``models[row]`` is the quadratic model of E, ``predicted`` is x extrapolated from earlier steps.  Returns (x,
        True if found, the `Attempt` at x).
        """
        c1 = extrapolate_slope(models, row)
        if followed and is_trusted(search, models, row, predicted, c1, c1 + 2 * models[row, CURVATURE] * predicted):
            x, found, result = follow(search, models, row, predicted, c1, arguments)
            if found:
                return x, True, result
        return search_anew(search, models, row, predicted, c1, arguments)

    return find
