"""A step of the user's own: what it may return, error messages for the rest, and its claims."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.measure import own_step
from phasebench.benchmarks.problems import problem
from phasebench.integrators.errors import InvalidInput

HENON = problem("henon-heiles:box")


def ran(step, **more):
    """The solution of five steps of the user's function on the Henon-Heiles problem."""
    return own_step.integrate_step(HENON, own_step.from_function(step), h=0.1, steps=5, **more)


def still(system, q, p, h):
    return q + 0.0, p + 0.0


def test_every_row_is_saved_by_default():
    assert len(ran(still).t) == 6
    assert len(ran(still, save_every=2).t) == 4


@pytest.mark.parametrize("made", [tuple, list, np.array])
def test_step_may_return_any_pair_of_arrays(made):
    assert np.array_equal(ran(lambda system, q, p, h: made([q + 1, p])).q[-1], np.add(HENON.q0, 5))


@pytest.mark.parametrize(
    ("returns", "said"),
    [
        (lambda q, p: 7, r"step returned 7; it must return q, p"),
        (lambda q, p: (q, p, q), r"it must return q, p"),
        (lambda q, p: np.array([q, p, q]), r"it must return q, p"),
        (lambda q, p: np.zeros((2, 2, 2)), r"it must return q, p"),
        (lambda q, p: "x" * 100, r"step returned str 'x{59} \.\.\.; it must return q, p"),
        (lambda q, p: (q, p[:1]), r"step returned p of shape \(1,\); it must be \(2,\)"),
        (lambda q, p: (q, 1j * p), r"step returned p = .*; it must be an array of real numbers"),
    ],
)
def test_invalid_return_value_is_shown(returns, said):
    with pytest.raises(InvalidInput, match=said):
        ran(lambda system, q, p, h: returns(q, p))


@pytest.mark.parametrize("name", ["stability", "tolerance"])
@pytest.mark.parametrize("value", [0, -1.0, float("inf"), float("nan"), True, "2"])
def test_claimed_limit_must_be_a_positive_number(name, value):
    assert own_step.checked_claims({name: 0.5}, "here") == {name: 0.5}
    with pytest.raises(InvalidInput, match=f"here has {name} = .*a positive number"):
        own_step.checked_claims({name: value}, "here")
