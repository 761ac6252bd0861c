"""The model of the energy error that is carried from step to step, and how it follows a root."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.integrators.stepping import energy_model as model
from phasebench.integrators.stepping.energy_model import ALONG, FIRST
from support.curves import EXACT, NEAR, UNIT, from_roots, look, model_of

# -- the model --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "c", [(0.3, -1, 0.5), (-0.3, -1, 0.5), (0.3, 1, -2), (1e-9, -2, 3), (1, 0, -4), (1, 4, 0), (1, -2, 1)]
)
def test_the_smaller_root_of_a_parabola_is_its_smaller_root(c):
    roots = np.roots(c[::-1])
    assert model.smaller_root(*map(float, c)) == pytest.approx(roots[np.argmin(abs(roots))], rel=1e-14)


def test_smaller_root_without_a_root_and_for_a_tiny_constant():
    for c in ((1.0, 1.0, 1.0), (-1.0, 1.0, -1.0), (1.0, 0.0, 0.0), (np.nan, 1.0, 1.0)):
        assert model.smaller_root(*c) == np.inf
    for slope in (3.0, -3.0):
        assert model.smaller_root(1e-20, slope, 1.0) == pytest.approx(-1e-20 / slope, rel=1e-15)


def test_attempts_are_solved_to_the_accuracy_needed():
    """The tolerance of an attempt is a hundredth of the error expected, but not below round-off."""
    assert model.residual_factor(1.0, UNIT) == model.residual_factor(-1.0, UNIT) == pytest.approx(1e10, rel=1e-14)
    assert model.residual_factor(2.0**14, 1.0) == pytest.approx(163.84, rel=1e-14)
    for E, unit in ((1e4, 1.0), (9e3, 1.0), (0.0, 1.0), (1.0, 0.0), (np.inf, 1.0), (np.nan, 1.0), (1.0, np.nan)):
        assert model.residual_factor(E, unit) == (100.0 if E == 1e4 else 1.0)


def test_a_parabola_goes_through_its_three_points():
    c = np.array([0.7, -1.3, 0.4])
    x = np.array([-0.5, 0.3, 1.1])
    slope, bend = model.muller(*x, *np.polynomial.polynomial.polyval(x, c))
    assert bend == pytest.approx(c[2], rel=1e-14)
    assert slope == pytest.approx(c[1] + 2 * c[2] * x[2], rel=1e-14)


def test_a_slope_is_extrapolated_quadratically_in_time():
    """Slopes measured at the steps 0, ..., 3 and predicted for the following ones."""
    models = model_of(slope=5.0)
    for n in range(4):
        model.extrapolate_slope(models, 0)
        model.renew(models, 0, 2.0 + 0.3 * n - 0.07 * n * n)
        assert models[0, model.AGE] == 0
    for n in range(4, 8):
        assert model.extrapolate_slope(models, 0) == pytest.approx(2.0 + 0.3 * n - 0.07 * n * n, rel=1e-13)
        assert models[0, model.AGE] == n - 3


def test_a_rarely_measured_slope_is_extrapolated_linearly():
    models = model_of(slope=1.0)
    for n in (3, 6, 9):
        for _ in range(3):
            guess = model.extrapolate_slope(models, 0)
        model.renew(models, 0, 1.0 + 0.5 * n)
    assert guess == pytest.approx(5.5)
    assert models[0, [model.SLOPE, model.RATE, model.BEND]] == pytest.approx([5.5, 0.5, 0.0])


def test_the_bend_is_the_second_difference_of_the_slope():
    models = model_of(slope=1.0)
    for n in (3, 6, 9):
        for _ in range(3):
            model.extrapolate_slope(models, 0)
        model.renew(models, 0, 1.0 + 0.5 * n - 0.25 * n * n)
    assert models[0, model.BEND] == pytest.approx(-0.5)


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
        """Whether a model with these numbers is trusted."""
        models = model_of(before, curvature)
        models[0, [model.STREAK, model.AGE, model.MISSED]] = streak, age, missed
        return model.is_trusted(NEAR, models, 0, predicted, 0.25, 0.25)

    assert trusted(**limit)
    assert not trusted(**beyond)


# -- following a root -------------------------------------------------------------------------------------------------


def trusted_model(slope=1.0, curvature=0.0, missed=1e-4, age=0.0, unit=UNIT, streak=1.0):
    """A model of the energy error with these numbers, in which the next step trusts to predict its root."""
    models = model_of(slope, curvature)
    models[0, [model.MISSED, model.AGE, model.UNIT, model.STREAK]] = missed, age, unit, streak
    return models


def test_a_root_is_followed_by_its_slope():
    """Three attempts: at the prediction, then twice at the root, first with a larger tolerance."""
    models = trusted_model(slope=2.0)
    s = look([-0.1, 2.0], models, predicted=0.0501)
    assert s.found
    assert s.at == s.x == pytest.approx(0.05, abs=UNIT)
    assert s.tried[:, 0] == pytest.approx([0.0501, 0.05, 0.05], abs=UNIT)
    assert s.tried[:, 1].tolist() == [FIRST, ALONG, ALONG]
    assert s.tried[:, 2] == pytest.approx([0.01 * 2e-4 / UNIT, 0.01 * 2e-4 / UNIT, 1.0])
    assert models[0, model.MISSED] == pytest.approx(1e-4)
    assert models[0, model.STREAK] == 2
    assert models[0, model.UNIT] == UNIT
    assert models[0, model.AGE] == 0, "the slope was measured"


def test_a_prediction_that_is_a_root_is_accepted():
    models = trusted_model(missed=0.0)
    s = look([-0.05, 1.0], models, predicted=0.05)
    assert (s.x, s.found) == (0.05, True)
    assert s.tried.tolist() == [[0.05, FIRST, 1.0, 0.0]]
    assert models[0, [model.AGE, model.STREAK, model.MISSED]].tolist() == [1, 2, 0]


def test_following_a_root_measures_the_slope():
    models = trusted_model(slope=1.05, curvature=0.5)
    s = look([-0.05, 1.0, 0.5], models, predicted=0.0488)
    assert s.found
    assert s.tried[0, 0] == 0.0488
    assert len(s.tried) <= 4
    assert models[0, model.SLOPE] == pytest.approx(1.0, rel=1e-7)
    assert models[0, model.STREAK] == 2


def test_three_distant_attempts_measure_the_curvature():
    models = trusted_model(slope=1.4, curvature=0.1, missed=1e-2)
    s = look([-0.05, 1.0, 0.8], models, predicted=0.03)
    assert s.found
    assert s.x == pytest.approx((np.sqrt(1.16) - 1) / 1.6, abs=3 * UNIT)
    assert models[0, [model.SLOPE, model.CURVATURE]] == pytest.approx([1.0, 0.8], rel=1e-4)
    assert models[0, model.STREAK] == 1, "it begins anew"


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


@pytest.mark.parametrize(
    ("age", "missed", "aside"), [(5, 1e-10, True), (4, 1e-10, False), (7, 1e-10, True), (5, 1e-8, False)]
)
def test_an_old_slope_is_measured_beside_the_root(age, missed, aside):
    """Only if predictions are so good that attempts coincide; it is made 3000 round-off units away."""
    models = trusted_model(slope=2.0, missed=missed, age=age)
    s = look([-0.1, 2.0], models, predicted=0.05)
    assert s.found
    assert s.tried[0, 0] == pytest.approx(0.05 + 1.5e-9 * aside, abs=1e-14)
    assert s.x == pytest.approx(0.05, abs=UNIT)
    assert models[0, model.AGE] == (0 if aside else age + 1)


def test_a_root_that_may_not_be_the_nearest_is_not_followed():
    """The curvature found on the way makes the model unsure; the search then finds the nearer root."""
    models = trusted_model(slope=1.5, curvature=0.0, missed=1e-2)
    c = from_roots(0.08, -0.07, factor=10.0)
    s = look(c, models, predicted=0.085)
    assert s.found
    assert s.x == pytest.approx(-0.07, abs=UNIT)
    assert 0 in s.tried[:, 0]


def search(errors):
    """(result, model afterwards) of a root search in which attempt n has the error errors[n], in units of round-off.

    The errors do not depend on the parameter x.
    """
    models = trusted_model(missed=0.0, unit=EXACT)
    return look([0.0], models, 0.0625, errors=errors, unit=EXACT), models


@pytest.mark.parametrize(("E", "found"), [(1.0, True), (-1.0, True), (1.0001, False)])
def test_a_followed_root_must_be_exact_to_one_unit(E, found):
    s, _ = search([E, 0.0])
    assert s.found
    assert len(s.tried) == 1 + (not found)


def test_following_ends_when_the_error_does_not_halve():
    for second, ends in ((-51.0, True), (51.0, True), (-50.0, False), (50.0, False)):
        s, _ = search([100.0, second])
        assert (0 in s.tried[:, 0]) == ends, second
    for second, ends in ((8.0, False), (8.001, True)):
        s, _ = search([10.0, second])
        assert (0 in s.tried[:, 0]) == ends, second


def test_following_takes_seven_attempts_at_most():
    s, _ = search([400.0 * 0.45**k for k in range(7)])
    assert np.flatnonzero(s.tried[:, 0] == 0)[0] == 7


def test_the_fourth_attempt_may_miss_by_eight_units():
    for third, fourth, ends in (
        (8.0, 8.0, True),
        (16.0, 8.0, True),
        (7.0, -3.5, True),
        (8.0, 3.9, False),
        (18.0, 9.0, False),
    ):
        s, _ = search([100.0, 40.0, third, fourth, 0.0])
        assert len(s.tried) == 4 + (not ends), (third, fourth)
    s, _ = search([10.0, 4.0, 3.0, 0.0])
    assert len(s.tried) == 4, "the third may not"


def test_secants_need_errors_two_units_apart():
    """Energy errors of 600, then -2 or -2.5 units of round-off: the next slope is the model's, then the secant's."""
    for second, slope in ((-2.0, 1.0), (-2.5, 602.5 / 600)):
        s, models = search([600.0, second, 0.0])
        assert s.tried[2, 0] - s.tried[1, 0] == pytest.approx(-second * EXACT / slope, rel=1e-4, abs=0)
        assert models[0, model.AGE] == 1, "it is not kept"


def test_only_slopes_from_large_errors_are_stored():
    for first, kept in ((1000.0, False), (1001.0, True)):
        s, models = search([first, -4.0, 0.0])
        assert s.found
        assert (models[0, model.AGE] == 0) == kept
        assert models[0, model.SLOPE] == pytest.approx(1 + 4 / first if kept else 1.0, rel=1e-6)
