"""Steps whose energy error E(x) is a prescribed function, to test the search for its roots."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from phasebench.integrators.stepping import energy_model as model
from phasebench.integrators.stepping.energy_model import Attempt, Search
from phasebench.integrators.stepping.root import finder
from phasebench.integrators.stepping.solve import NOT_FINITE, SOLVED
from phasebench.integrators.values.vector import State, jit, scale

from .values import value

UNIT = 1e-12
#: A power of two, so that its multiples are exact.
EXACT = 2.0**-40
NEAR = Search(radius=2.0, first=0.05, near=1.0, ratio=1.12, points=70, slack=0.0)


class Curve(NamedTuple):
    """A made-up step for tests of the root finder, whose energy error E is a polynomial of its parameter x.

    E(x) = c_0 + c_1 x + ... + c_4 x^4 for ``below`` < x < ``above``; elsewhere the step has no solution.

    E is larger by ``jump`` from x = 0.3 on. Its round-off is ``unit``; an attempt that is allowed a larger error by
    ``ease`` errs by the fraction ``blur`` of it. Attempts are recorded in ``tried`` as (x, start, ease, units added to
    E).
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


@jit
def attempt(x, start, ease, e):
    """Stand in for a step with the parameter x, whose energy error is the made-up curve that e describes.

    Its end state is x q; x, ``start`` and ``ease`` are recorded in ``e.tried``.
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


FIND = {followed: finder(attempt, followed) for followed in (True, False)}


class Found(NamedTuple):
    """Result of a root search: x, whether it is a root, the state, E and status of its attempt, and all attempts."""

    x: float
    found: bool
    at: float
    E: float
    status: int
    tried: np.ndarray


def look(c, models=None, predicted=np.nan, followed=True, search=NEAR, errors=(), unit=UNIT, **curve):
    """Search for a root of the polynomial c; ``errors`` (in units of round-off) are added to the attempts in turn."""
    one, many, tried = value(1.0), np.zeros((1, 1)), np.zeros((1000, 4))
    tried[: len(errors), 3] = errors
    below, above = curve.get("within", (-np.inf, np.inf))
    c = (*map(float, c), *[0.0] * (5 - len(c)))
    blur, jump = curve.get("blur", 0.0), curve.get("jump", 0.0)
    e = Curve(State(one, one, one, one), c, unit, below, above, blur, jump, tried, many)
    models = model_of() if models is None else models
    x, found, result = FIND[followed](search, models, 0, predicted, e)
    return Found(x, found, result.y.q[0], result.E, result.status, tried[: int(many[0, 0])])


def from_roots(*roots, factor=1.0):
    """The coefficients, lowest first, of the polynomial with these roots."""
    return factor * np.poly(roots)[::-1]


def model_of(slope=0.0, curvature=0.0):
    """The model of E that the previous step leaves: its slope and curvature."""
    models = np.zeros((1, model.NUMBERS))
    models[0, [model.SLOPE, model.CURVATURE]] = slope, curvature
    return models
