"""The search for the root of the energy error E(x) nearest 0, on functions with known roots."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.integrators.stepping import energy_model as model
from phasebench.integrators.stepping.energy_model import ALONG, FIRST, LATEST, Search
from phasebench.integrators.stepping.solve import LEVELS, NOT_FINITE, SOLVED
from support.curves import EXACT, UNIT, from_roots, look, model_of


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
    assert s.tried.tolist() == [[0.0, FIRST, 1.0, 0.0]]
    assert models[0, model.START] == E0 * UNIT
    assert models[0, model.UNIT] == UNIT
    assert models[0, model.STREAK] == -LEVELS


def test_a_step_without_a_solution_at_zero_is_reported():
    s = look([1.0, 1.0], within=(0.5, 1.0))
    assert (s.x, s.at, s.status) == (0.0, 0.0, NOT_FINITE)
    assert len(s.tried) == 1


@pytest.mark.parametrize("followed", [True, False])
def test_the_root_of_the_model_is_tried_first(followed):
    """The model of E is exact here: the search tries its root after 0, and leaves it unchanged."""
    models = model_of(-1.4, 1.0)
    s = look([0.125, -1.4, 1.0], models, followed=followed)
    root = model.smaller_root(0.125, -1.4, 1.0)
    assert s.found
    assert s.tried[:, 0] == pytest.approx([0.0, root, root], abs=UNIT)
    assert s.tried[:, 1].tolist() == [FIRST, ALONG, LATEST]
    assert s.tried[1, 2] == pytest.approx(0.01 * 0.125 / UNIT)
    assert s.tried[2, 2] == 1
    assert models[0, [model.SLOPE, model.CURVATURE]] == pytest.approx([-1.4, 1.0], rel=1e-9)
    assert models[0, [model.RATE, model.BEND, model.STREAK]].tolist() == [0, 0, 1]


def test_for_distant_roots_the_other_side_is_tried_first():
    """The model predicts 0.5; the sign at -0.5 shows that a root lies between, and the parabola locates it."""
    c = from_roots(0.5, -0.2)
    models = model_of(0.2)
    s = look(c, models)
    assert s.x == pytest.approx(-0.2, abs=UNIT)
    assert s.tried[:3, 0] == pytest.approx([0.0, -0.5, -0.2], abs=UNIT)
    assert s.tried[1, 1:3] == pytest.approx([ALONG, 0.01 * 0.1 / UNIT])
    assert models[0, [model.SLOPE, model.CURVATURE]] == pytest.approx([-0.3, 1.0])
    assert look(-c, model_of(-0.2)).x == pytest.approx(-0.2, abs=UNIT)
    assert look([-0.1, 1.0], model_of(1.0)).tried[1, 0] == 0.1, "a tenth is not beyond it"


def test_a_search_ends_at_one_unit_or_stagnates_below_eight():
    for errors, ends in (
        ([20.0, 10.0, 1.0], 3),
        ([20.0, 10.0, 4.0, 1.0], 4),
        ([20.0, 10.0, 9.0, 8.0], 4),
        ([20.0, 10.0, 9.0, 5.0, 2.5], 4),
        ([20.0, 10.0, 16.0, 8.0, 0.0], 4),
        ([20.0, 10.0, 16.0, 7.9, 0.0], 5),
        ([20.0, 10.0, 8.0, 3.9, 0.0], 5),
        ([20.0, 10.0, 9.0, 8.1, 0.0], 5),
    ):
        s = look([0.0], model_of(1.0), errors=errors, unit=EXACT)
        assert s.found
        assert len(s.tried) == ends, errors


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
    assert s.tried[-1].tolist() == [0.0, FIRST, 1.0, 0.0]
    assert models[0, model.STREAK] == -LEVELS


@pytest.mark.parametrize(("units", "slack", "kept"), [(5, 8, True), (8, 8, True), (8.1, 8, False), (5, 0, False)])
def test_without_a_root_a_small_error_at_zero_is_accepted(units, slack, kept):
    models = model_of()
    s = look([units * UNIT, 0.0, 1.0], models, search=OUT._replace(slack=float(slack), near=1.0), within=(-0.01, 0.01))
    assert np.isfinite(models[0, model.SLOPE]) or not kept
    assert (s.x, s.found, s.at) == (0.0, kept, 0.0)
    assert (len(s.tried) == 3) == kept
    assert s.tried[-1, 1] == FIRST
