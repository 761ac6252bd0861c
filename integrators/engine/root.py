r"""The root nearest to zero of the energy's error E(x) of a step that is taken with the parameter x.

If E(0) is at the round-off of H already, x = 0.  Else Muller's method goes on from the smaller root of the quadratic
model that the last step left; where E has two roots near zero (``branches``) the other side and the other root of the
model are tried where they may be nearer.  Where that fails, or ends far out, the stage equations are followed outwards
from x = 0 to the ``radius``, or to the end of their branch, for the nearest change of sign.

Source: D. E. Muller, Math. Tables Aids Comput. 10 (1956) 208-215; M. Dowell, P. Jarratt, BIT 11 (1971) 168-174
(Illinois); for E(x): L. Brugnano, F. Iavernaro, D. Trigiante, SIAM J. Numer. Anal. 50 (2012) 2897-2916.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .solve import SOLVED
from .vector import State, apart, inlined, jit

#: Where an attempt's stage equations start from: earlier steps at their roots, earlier steps at x = 0, the last
#: attempt.
AT_ROOTS, AT_ZERO, LATEST = 0, 1, 2
MULLER_LIMIT, REFINE_LIMIT = 14, 100
#: For a root farther than this the other side is looked at first.
CHECKED = 0.1
#: H is known to its round-off times this where Muller's method can do no better.
SLACK = 8.0


class Search(NamedTuple):
    """Where a root is looked for.

    Attributes
    ----------
    radius : the largest size of a root
    first : the first guess where there is no model
    near : a root farther than this is looked for by continuation: Muller's method might leave the branch of x = 0
    ratio, points : the continuation's points on either side are radius / ratio^k, k = points - 1, ..., 0
    branches : whether E may have two roots near zero
    slack : E(0) at the round-off of H times this will do where Muller's method fails
    """

    radius: float
    first: float
    near: float
    ratio: float
    points: int
    branches: bool
    slack: float


class Attempt(NamedTuple):
    """The state after a step, the error of its energy, the round-off of H, the status of its stage equations."""

    y: State
    E: float
    unit: float
    status: int


@inlined
def smaller_root(c0, c1, c2):
    """The root of c0 + c1 x + c2 x^2 nearest zero; infinite where it has none."""
    D = c1 * c1 - 4 * c0 * c2
    if not D >= 0:
        return np.inf
    root = D**0.5
    denominator = c1 + root if c1 >= 0 else c1 - root
    if denominator == 0:
        return np.inf
    return -2 * c0 / denominator


@inlined
def muller(x0, x1, x2, E0, E1, E2):
    """The quadratic through three points, about x2: (slope, curvature)."""
    d1 = (E2 - E1) / (x2 - x1)
    d0 = (E1 - E0) / (x1 - x0)
    c2 = (d1 - d0) / (x2 - x0)
    return d1 + c2 * (x2 - x1), c2


def finder(attempt):
    """The finder for attempt(x, start, arguments) -> `Attempt`.

    It is a function (search, models, row, predicted, arguments) -> (x, found, the attempt at x, or at 0 where there is
    no root).  The row of ``models`` keeps the slope and curvature of the quadratic model from step to step;
    ``predicted`` is the root extrapolated from earlier steps, or 0.
    """

    @jit
    def apart_attempt(x, start, arguments):
        """`attempt` where it is rare."""
        apart()
        return attempt(x, start, arguments)

    @jit
    def refine(a, Ea, b, Eb, arguments):
        """The root between a and b, where E changes sign: bisection quickened by the secant (Illinois); (x, found)."""
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
    def outwards(side, bound, search, arguments):
        """The root nearest zero on one side, by continuation from x = 0 to the bound or the branch's end; (x,
        found)."""
        E0 = apart_attempt(0.0, AT_ZERO, arguments).E
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

    @jit
    def scan(search, arguments):
        """The root nearest zero on the branch of the stage equations that starts at x = 0; (x, found)."""
        above, found = outwards(1.0, search.radius, search, arguments)
        below, second = outwards(-1.0, abs(above) if found else search.radius, search, arguments)
        if second and not (found and abs(above) <= abs(below)):
            return below, True
        return above, found

    @inlined
    def chase(x, E0, radius, models, row, arguments):
        """Muller's method from x, with (0, E0) as its other point; returns (x, found, the last attempt)."""
        xa, Ea, xb, Eb = 0.0, E0, 0.0, E0
        c1, c2 = 0.0, models[row, 1]  # the curvature of the last step's model serves until there is a third point
        new = attempt(x, AT_ROOTS, arguments)
        for k in range(MULLER_LIMIT):
            E, unit = new.E, new.unit
            if new.status != SOLVED:
                break
            if k == 0:
                c1 = (E - E0) / x + c2 * x
            elif x != xb and x != xa and xa != xb:
                c1, c2 = muller(xa, xb, x, Ea, Eb, E)
            if k == 1 and abs(Eb) > 1e4 * unit:
                models[row, 0], models[row, 1] = c1 - 2 * c2 * x, c2
            elif k < 2:
                models[row, 0] = (E - E0) / x - models[row, 1] * x
            if abs(E) <= unit or (k > 1 and abs(E) <= SLACK * unit and abs(E) >= 0.5 * abs(Eb)):
                return x, True, new
            move = smaller_root(E, c1, c2)
            if not abs(x + move) <= radius and Eb != E:
                move = -E * (x - xb) / (E - Eb)  # the parabola has no root: the secant
            xa, Ea, xb, Eb = xb, Eb, x, E
            x = x + move
            if not abs(x) <= radius or x == xb:
                break
            new = attempt(x, LATEST, arguments)
        return x, False, new

    @jit
    def apart_chase(x, E0, radius, models, row, arguments):
        """`chase` where it is rare."""
        apart()
        return chase(x, E0, radius, models, row, arguments)

    @inlined
    def nearer_side(x, E0, models, row, arguments):
        """x, or a guess on the other side where E has a nearer root; E(-x) also says what the model is now."""
        beyond = apart_attempt(-x, AT_ROOTS, arguments)
        if beyond.status != SOLVED:
            return x
        c2 = 0.5 * (beyond.E - 2 * E0) / (x * x)
        c1 = -(E0 + c2 * x * x) / x
        models[row, 0], models[row, 1] = c1, c2
        if (beyond.E > 0) == (E0 > 0):
            return x
        nearer = smaller_root(E0, c1, c2)
        return nearer if abs(nearer) < abs(x) and nearer * x < 0 else -0.5 * x

    @inlined
    def find(search, models, row, predicted, arguments):
        """Find the root."""
        radius = search.radius
        result = attempt(0.0, AT_ZERO, arguments)
        E0, unit = result.E, result.unit
        if result.status != SOLVED or abs(E0) <= unit:
            return 0.0, True, result
        x = smaller_root(E0, models[row, 0], models[row, 1])
        if not 0 < abs(x) <= radius:
            x = search.first
        elif abs(predicted - x) <= 0.25 * abs(x):
            x = predicted  # the model picks the branch, the last roots say more exactly where it is now
        if search.branches and abs(x) > CHECKED:
            x = nearer_side(x, E0, models, row, arguments)
        x, found, result = chase(x, E0, radius, models, row, arguments)
        if search.branches and found and abs(E0) < 1.2 * abs(models[row, 1]) * x * x:
            # The product of the model's two roots is E0 / c2: the other one may be nearer.
            other = E0 / (models[row, 1] * x)
            nearer, better, second = apart_chase(other, E0, radius, models, row, arguments)
            if better and abs(nearer) < abs(x):
                x, result = nearer, second
        if found and abs(x) <= search.near:
            return x, True, result
        if abs(E0) <= search.slack * unit:
            x, found = 0.0, True
        else:
            x, found = scan(search, arguments)
        if found and x != 0:
            models[row, 0], models[row, 1] = -E0 / x, 0.0
        return x, found, apart_attempt(x, LATEST if found and x != 0 else AT_ZERO, arguments)

    return find
