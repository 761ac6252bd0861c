"""The root of the energy error nearest 0: on functions with known roots, and of Schemes IV and V."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest

from phasebench.benchmarks.problems import problem
from phasebench.integrators.compile import codegen
from phasebench.integrators.driver import integrate
from phasebench.integrators.stepping import energy_model as model
from phasebench.integrators.stepping.energy_model import FIRST, LATEST, Attempt, Search
from phasebench.integrators.stepping.root import ROWS, SIGNATURE, SLOTS, finder, search_anew
from phasebench.integrators.stepping.solve import LEVELS, NOT_FINITE, SOLVED
from phasebench.integrators.values.vector import State, inline, jit, scale
from support.solutions import last

UNIT = 1e-12
NEAR = Search(radius=2.0, first=0.05, near=1.0, ratio=1.12, points=70, slack=0.0)


class Curve(NamedTuple):
    """A made-up step from y whose energy error E is a polynomial of x with the coefficients c, where it has a solution.

    From x = 0.3 on E is larger by ``jump``. ``tried`` has a row (x, start, ease) for each attempt.
    """

    y: State
    c: tuple
    unit: float
    below: float
    above: float
    jump: float
    tried: Any
    many: Any
    states: Any


@jit
def attempt(x, start, ease, e):
    """A step with the parameter x of a `Curve`: its end has x times q."""
    n = int(e.many[0, 0])
    e.tried[n, 0], e.tried[n, 1], e.tried[n, 2] = x, start, ease
    e.many[0, 0] = n + 1
    y = State(scale(x, e.y.q), e.y.p, e.y.lost_q, e.y.lost_p)
    if not e.below < x < e.above:
        return Attempt(y, np.inf, e.unit, NOT_FINITE)
    E = e.c[0] + x * (e.c[1] + x * (e.c[2] + x * (e.c[3] + x * e.c[4])))
    if x >= 0.3:
        E = E + e.jump
    return Attempt(y, E, e.unit, SOLVED)


class Searching(NamedTuple):
    """What a finder takes of a kernel's `newton.Work`."""

    search: Any


WORK = Searching(codegen.once(search_anew, SIGNATURE))
FIND = {followed: finder(attempt, inline(lambda e: e.states), followed) for followed in (True, False)}


class Found(NamedTuple):
    """The parameter, whether it is a root, q[0], E and status of its attempt, and all attempts."""

    x: float
    found: bool
    at: float
    E: float
    status: int
    tried: np.ndarray


def look(c, models=None, predicted=np.nan, followed=True, search=NEAR, **curve):
    """Search for a root of E(x), whose coefficients are c, lowest first."""
    one, many, tried = (1.0,), np.zeros((1, 1)), np.zeros((1000, 3))
    below, above = curve.get("within", (-np.inf, np.inf))
    c = (*map(float, c), *[0.0] * (5 - len(c)))
    states = np.zeros((SLOTS * ROWS, 1))
    e = Curve(State(one, one, one, one), c, UNIT, below, above, curve.get("jump", 0.0), tried, many, states)
    models = model_of() if models is None else models
    x, found, result = FIND[followed](search, models, 0, predicted, e, WORK)
    return Found(x, found, result.y.q[0], result.E, result.status, tried[: int(many[0, 0])])


def from_roots(*roots, factor=1.0):
    return factor * np.poly(roots)[::-1]


def model_of(slope=0.0, curvature=0.0):
    models = np.zeros((1, model.NUMBERS))
    models[0, [model.SLOPE, model.CURVATURE]] = slope, curvature
    return models


@pytest.mark.parametrize(("followed", "sign"), [(True, 1), (False, -1)])
@pytest.mark.parametrize("root", [1e-6, 0.03, 0.9])
@pytest.mark.parametrize("bend", [0.4, -0.4])
def test_a_single_root_is_found_to_round_off(followed, sign, root, bend):
    """E = (x - root)(1 + bend x), whose other root is beyond 2."""
    s = look(np.convolve([-sign * root, 1.0], [1.0, bend]), followed=followed)
    assert s.found
    assert s.status == SOLVED
    assert s.x == pytest.approx(sign * root, abs=10 * UNIT)
    assert s.at == s.x
    assert abs(s.E) <= model.SLACK * UNIT
    assert len(s.tried) <= 12


@pytest.mark.parametrize("E0", [0.0, 0.5, 1.0, -1.0])
def test_an_energy_conserved_at_zero_needs_no_root(E0):
    models = model_of()
    s = look([E0 * UNIT, 1.0], models)
    assert (s.x, s.found, s.at) == (0.0, True, 0.0)
    assert s.tried.tolist() == [[0.0, FIRST, 1.0]]
    assert models[0, model.START] == E0 * UNIT
    assert models[0, model.UNIT] == UNIT
    assert models[0, model.STREAK] == -LEVELS


def test_a_step_without_a_solution_at_zero_is_reported():
    s = look([1.0, 1.0], within=(0.5, 1.0))
    assert (s.x, s.at, s.status) == (0.0, 0.0, NOT_FINITE)
    assert len(s.tried) == 1


OUT = Search(radius=2.0, first=0.05, near=0.0, ratio=2.0, points=5, slack=0.0)


def outwards(c, search=OUT, **options):
    """(result, parameters tried above 0, parameters tried below 0) of a search outwards for a root of a polynomial."""
    s = look(c, search=search, **options)
    begins = np.flatnonzero(s.tried[:, 1] == FIRST)[1:3]
    above, below = np.split(s.tried, begins)[1:]
    assert (above[1:, 1] == LATEST).all()
    assert (above[:, 2] == 1).all()
    return s, above[:, 0], below[:, 0]


@pytest.mark.parametrize("sign", [1, -1])
def test_the_nearest_change_of_sign_on_either_side_is_found(sign):
    for roots, nearest in (
        ((0.3,), 0.3),
        ((0.3, -0.28), -0.28),
        ((0.3, -0.6), 0.3),
        ((-0.6,), -0.6),
        ((1.3, 0.4), 0.4),
    ):
        models = model_of()
        c = sign * from_roots(*roots)
        s, above, below = outwards(c, models=models)
        assert s.found
        assert s.x == s.at == pytest.approx(nearest, abs=10 * UNIT)
        assert abs(s.E) <= 64 * UNIT
        first = max(roots) if len(roots) < 2 or roots[1] < 0 else 0.4
        grid = (0.0, 0.125, 0.25, 0.5, 1.0, 2.0)
        expected = [x for k, x in enumerate(grid) if k == 0 or first < 0 or grid[k - 1] < first]
        assert above[: len(expected)] == pytest.approx(expected)
        assert below.min() >= -max(first, 0) - 1e-12 or first < 0
        assert models[0, [model.SLOPE, model.CURVATURE]] == pytest.approx([-c[0] / s.x, 0.0])


def test_a_jump_across_zero_is_not_a_root():
    for sign in (1, -1):
        s, above, _ = outwards([-sign * 1e-3], jump=2e-3 * sign)
        assert (s.x, s.found, s.at) == (0.0, False, 0.0)
        assert np.abs(above - 0.3).min() < 1e-15
        assert len(above) < 100


def test_a_minimum_without_a_root_is_passed():
    """E is (x - 0.7)^2 + 0.001, without a root, times 1.5 - x, with a root beyond."""
    c = np.convolve([0.491, -1.4, 1.0], [1.5, -1.0])
    s, above, _ = outwards(c)
    assert s.x == pytest.approx(1.5, abs=1e-9)
    assert above[4] == above[6] == 1.0, "it goes on from where it was"
    assert 0.5 < above[5] < 1.0
    assert above[7] == 2.0


def test_without_a_root_the_step_is_that_at_zero():
    models = model_of(1.0)
    models[0, model.STREAK] = 3.0
    s = look([1.0, 0.0, 1.0], models)
    assert (s.x, s.found, s.at, s.E, s.status) == (0.0, False, 0.0, 1.0, SOLVED)
    assert s.tried[-1].tolist() == [0.0, FIRST, 1.0]
    assert models[0, model.STREAK] == -LEVELS


@pytest.mark.parametrize(("units", "slack", "kept"), [(5, 8, True), (8, 8, True), (8.1, 8, False), (5, 0, False)])
def test_without_a_root_a_small_error_at_zero_is_accepted(units, slack, kept):
    models = model_of()
    s = look([units * UNIT, 0.0, 1.0], models, search=OUT._replace(slack=float(slack), near=1.0), within=(-0.01, 0.01))
    assert np.isfinite(models[0, model.SLOPE]) or not kept
    assert (s.x, s.found, s.at) == (0.0, kept, 0.0)
    assert (len(s.tried) == 3) == kept
    assert s.tried[-1, 1] == FIRST


# -- the model --------------------------------------------------------------------------------------------------------


def test_a_slope_is_extrapolated_quadratically_in_time():
    models = model_of(slope=5.0)
    for n in range(4):
        model.extrapolate_slope(models, 0)
        model.renew(models, 0, 2.0 + 0.3 * n - 0.07 * n * n)
        assert models[0, model.AGE] == 0
    for n in range(4, 8):
        assert model.extrapolate_slope(models, 0) == pytest.approx(2.0 + 0.3 * n - 0.07 * n * n, rel=1e-13)
        assert models[0, model.AGE] == n - 3


ROOM = model.LONE * 0.25  # for a slope of 1/4


@pytest.mark.parametrize(
    ("limit", "beyond"),
    [
        ({"streak": 1}, {"streak": 0}),
        ({"streak": model.FOLLOWED - 1}, {"streak": model.FOLLOWED}),
        ({"predicted": model.CHECKED}, {"predicted": 1.0000001 * model.CHECKED}),
        ({"predicted": -model.CHECKED}, {"predicted": -1.0000001 * model.CHECKED}),
        ({"curvature": ROOM / 0.0625}, {"curvature": 1.0000001 * ROOM / 0.0625}),
        ({"curvature": -ROOM / 0.0625}, {"curvature": -1.0000001 * ROOM / 0.0625}),
        ({"curvature": 0.1 * ROOM / 0.125, "missed": 0.125}, {"curvature": 0.11 * ROOM / 0.125, "missed": 0.125}),
        ({"before": 0.25 - 0.75 * 0.25}, {"before": 0.25 - 0.76 * 0.25}),
        ({"before": 0.25 + 0.75 * 0.25}, {"before": 0.25 + 0.76 * 0.25}),
        ({"before": 9.0, "age": 1}, {"before": 9.0, "age": 2}),
    ],
)
def test_the_limits_within_which_a_model_is_trusted(limit, beyond):
    """The prediction is near 0, the other root twice as far, the last miss small, the slope steady and recent."""

    def trusted(streak=2, age=3, missed=0.0, predicted=0.0625, curvature=0.0, before=0.25):
        models = model_of(before, curvature)
        models[0, [model.STREAK, model.AGE, model.MISSED]] = streak, age, missed
        return model.is_trusted(NEAR, models, 0, predicted, 0.25, 0.25)

    assert trusted(**limit)
    assert not trusted(**beyond)


# -- following a root -------------------------------------------------------------------------------------------------


def trusted_model(slope=1.0, curvature=0.0, missed=1e-4, age=0.0, unit=UNIT, streak=1.0):
    models = model_of(slope, curvature)
    models[0, [model.MISSED, model.AGE, model.UNIT, model.STREAK]] = missed, age, unit, streak
    return models


def test_a_root_that_may_not_be_the_nearest_is_not_followed():
    """The curvature found on the way makes the model unsure; the search then finds the nearer root."""
    models = trusted_model(slope=1.5, curvature=0.0, missed=1e-2)
    c = from_roots(0.08, -0.07, factor=10.0)
    s = look(c, models, predicted=0.085)
    assert s.found
    assert s.x == pytest.approx(-0.07, abs=UNIT)
    assert 0 in s.tried[:, 0]


# -- Schemes IV and V: steps without a root, and the root that is taken ------------------------------------------------


@pytest.mark.parametrize(("h", "most"), [(0.01, 2.9), (0.1, 3.3)])
@pytest.mark.parametrize("name", ["henon-heiles:chaotic", "perturbed-kepler"])
def test_a_followed_root_costs_few_evaluations(name, h, most):
    """Compared with Scheme III, one step of which is one attempt of Scheme V."""
    made = problem(name)
    taken = [integrate(made, id, h=h, steps=1000).counts["gradient"] for id in ("scheme-v", "scheme-iii")]
    assert taken[0] < most * taken[1]


# -- a few steps -------------------------------------------------------------------------------------------------------

BOX = problem("henon-heiles:box")
#: From this state a step of 0.1 has no root for Scheme IV but one for Scheme V.
ROOTLESS = {"q0": [0.1365, 0.0292], "p0": [-0.1373, 0.0245]}


def take_step(id, parameters=None, h=0.1, **start):
    s = integrate(BOX, id, h=h, steps=1, parameters=parameters, **(start or ROOTLESS))
    return last(s), s.parameter[0], s.counts["fallbacks"]


def test_a_step_without_a_root_is_the_midpoint_rule():
    """Schemes with an alternative take its step instead if that has a root."""
    end, lam, fallbacks = take_step("scheme-iv")
    assert np.isnan(lam)
    assert fallbacks == 1
    assert np.abs(end - take_step("implicit-midpoint")[0]).max() < 1e-15
    other, lam, _ = take_step("scheme-v")
    assert np.abs(other - end).max() > 1e-6, "the control"
    for id in ("scheme-iv-v", "scheme-v-iv"):
        found, same, fallbacks = take_step(id)
        assert fallbacks == 0
        assert abs(same - lam) < 1e-9
        assert np.abs(found - other).max() < 1e-15
