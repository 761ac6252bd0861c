"""Made-up steps whose energy error E(x) is a given function of a parameter x, to test the search for its roots."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from phasebench.integrators.compile import codegen
from phasebench.integrators.stepping import energy_model as model
from phasebench.integrators.stepping.energy_model import Attempt, Search
from phasebench.integrators.stepping.root import ROWS, SIGNATURE, SLOTS, finder, search_anew
from phasebench.integrators.stepping.solve import NOT_FINITE, SOLVED
from phasebench.integrators.values.vector import State, inline, jit, scale

from .values import value

UNIT = 1e-12
#: A power of two, so that its multiples are exact.
EXACT = 2.0**-40
NEAR = Search(radius=2.0, first=0.05, near=1.0, ratio=1.12, points=70, slack=0.0)


class Curve(NamedTuple):
    """A made-up step for tests of the root finder, whose energy error E is a polynomial of its parameter x.

    E(x) = c_0 + c_1 x + ... + c_4 x^4 for ``below`` < x < ``above``; elsewhere the step has no solution.

    Attributes
    ----------
    y : the state at the start of the step
    c : the five coefficients of E
    unit : the unit of round-off of E
    below, above : the ends of the interval of x in which the step has a solution
    blur : an attempt whose equations need be solved only to ``ease`` units errs by the fraction ``blur`` of them
    jump : E is larger by this from x = 0.3 on
    tried : array, a row (x, start, ease, units added to E) for each attempt
    many : array (1, 1), the number of attempts so far
    states : array (8, 1), where the search keeps states of attempts
    """

    y: State
    c: tuple
    unit: float
    below: float
    above: float
    blur: float
    jump: float
    tried: Any
    many: Any
    states: Any


@jit
def attempt(x, start, ease, e):
    """Stand in for a step with the parameter x, whose energy error is the made-up curve of e, a `Curve`.

    Returns an `Attempt`: an end state with x times q, E, its unit of round-off and a status.  x, ``start`` and ``ease``
    are recorded in ``e.tried``.
    """
    n = int(e.many[0, 0])
    e.tried[n, 0], e.tried[n, 1], e.tried[n, 2] = x, start, ease
    e.many[0, 0] = n + 1
    y = State(scale(x, e.y.q), e.y.p, e.y.lost_q, e.y.lost_p)
    if not e.below < x < e.above:
        return Attempt(y, np.inf, e.unit, NOT_FINITE)
    E = e.tried[n, 3] * e.unit + e.c[0] + x * (e.c[1] + x * (e.c[2] + x * (e.c[3] + x * e.c[4])))
    if x >= 0.3:
        E = E + e.jump
    if ease > 1:
        E = E + e.blur * ease * e.unit
    return Attempt(y, E, e.unit, SOLVED)


class Searching(NamedTuple):
    """Stands in for a kernel's `newton.Work`, of which a finder takes the search alone."""

    search: Any


WORK = Searching(codegen.once(search_anew, SIGNATURE))
FIND = {followed: finder(attempt, inline(lambda e: e.states), followed) for followed in (True, False)}


class Found(NamedTuple):
    """Result of a search for a root of the energy error E(x).

    Attributes
    ----------
    x, found : the parameter, and whether it is a root
    at : first component of q at the end of the attempt with x, by which it is recognized
    E, status : energy error and status of that attempt
    tried : all attempts, a row (x, start, ease, units of round-off added to E) for each
    """

    x: float
    found: bool
    at: float
    E: float
    status: int
    tried: np.ndarray


def look(c, models=None, predicted=np.nan, followed=True, search=NEAR, errors=(), unit=UNIT, **curve):
    """Search for a root of the energy error E(x) with the coefficients c, lowest first; return the result, a `Found`.

    ``errors``, in units of round-off, are added to E in the first attempts, in turn.  ``models`` is the model of E that
    the last step left, ``predicted`` the root extrapolated from earlier steps; ``followed`` tells whether the root may
    be followed from step to step, ``search`` has the limits of the search.  ``curve`` may set "within" (the interval of
    x with solutions), "blur" and "jump" of `Curve`.
    """
    one, many, tried = value(1.0), np.zeros((1, 1)), np.zeros((1000, 4))
    tried[: len(errors), 3] = errors
    below, above = curve.get("within", (-np.inf, np.inf))
    c = (*map(float, c), *[0.0] * (5 - len(c)))
    blur, jump = curve.get("blur", 0.0), curve.get("jump", 0.0)
    e = Curve(State(one, one, one, one), c, unit, below, above, blur, jump, tried, many, np.zeros((SLOTS * ROWS, 1)))
    models = model_of() if models is None else models
    x, found, result = FIND[followed](search, models, 0, predicted, e, WORK)
    return Found(x, found, result.y.q[0], result.E, result.status, tried[: int(many[0, 0])])


def from_roots(*roots, factor=1.0):
    """Return the coefficients, lowest first, of ``factor`` times the monic polynomial with these roots."""
    return factor * np.poly(roots)[::-1]


def model_of(slope=0.0, curvature=0.0):
    """Return a quadratic model of E(x), as the previous step leaves it, with this slope and curvature: (1, n) array."""
    models = np.zeros((1, model.NUMBERS))
    models[0, [model.SLOPE, model.CURVATURE]] = slope, curvature
    return models
