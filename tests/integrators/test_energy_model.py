"""The model of the energy error that is carried from step to step, and how it follows a root."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.integrators.stepping import energy_model as model
from support.curves import NEAR, UNIT, from_roots, look, model_of

# -- the model --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "c", [(0.3, -1, 0.5), (-0.3, -1, 0.5), (0.3, 1, -2), (1e-9, -2, 3), (1, 0, -4), (1, 4, 0), (1, -2, 1)]
)
def test_the_smaller_root_of_a_parabola_is_its_smaller_root(c):
    roots = np.roots(c[::-1])
    assert model.smaller_root(*map(float, c)) == pytest.approx(roots[np.argmin(abs(roots))], rel=1e-14)


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


def test_following_takes_two_or_three_attempts_per_step():
    """E changes smoothly from step to step; each root is extrapolated from the two before."""
    models, roots, cost, searched = model_of(), [], [], []
    for n in range(80):
        c = (-0.02 - 0.01 * np.sin(0.05 * n), 1.0 + 0.2 * np.cos(0.03 * n), 0.3)
        s = look(c, models, 2 * roots[-1] - roots[-2] if n > 1 else np.nan)
        assert s.found
        assert abs(s.E) <= model.SLACK * UNIT
        assert s.x == pytest.approx(model.smaller_root(*c), abs=10 * UNIT)
        roots.append(s.x)
        cost.append(len(s.tried))
        if 0 in s.tried[:, 0]:
            searched.append(n)
    assert np.mean(cost[3:]) < 3.4
    assert 24 <= max(np.diff(searched)) <= 25
    assert len(searched) < 10


def test_a_root_that_may_not_be_the_nearest_is_not_followed():
    """The curvature found on the way makes the model unsure; the search then finds the nearer root."""
    models = trusted_model(slope=1.5, curvature=0.0, missed=1e-2)
    c = from_roots(0.08, -0.07, factor=10.0)
    s = look(c, models, predicted=0.085)
    assert s.found
    assert s.x == pytest.approx(-0.07, abs=UNIT)
    assert 0 in s.tried[:, 0]
