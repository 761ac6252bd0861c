"""Processed splittings: orders from their coefficients, steps beside a plain implementation, what a step costs."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from phasebench.integrators.coefficients import BY_NAME, GROUPS
from phasebench.integrators.coefficients.order_conditions import (
    residuals,
)
from phasebench.integrators.coefficients.polish import starting_values
from phasebench.integrators.coefficients.processed import inverse
from phasebench.integrators.driver import integrate
from phasebench.integrators.ensemble import integrate_ensemble
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.records import processed as records
from phasebench.integrators.systems.hamiltonian import Hamiltonian
from support import processed_steps
from support.coefficient_tables import full_precision as full_precision
from support.solutions import apart

IDS = [t.name for t in GROUPS["processed"]]
each = pytest.mark.parametrize("table", GROUPS["processed"], ids=lambda t: t.name)
PENDULUM = Hamiltonian(q="q", p="p", H="p**2/2 - cos(q)")


@pytest.fixture(scope="module")
def plain(of_each):
    """Function id -> measurements of `support.processed_steps`."""
    return of_each(processed_steps)


@each
def test_numbers_that_are_left_out_follow_from_sums(table):
    """The fractions, drifts and kicks of a kernel add up to 1; a composition's processor to 0."""
    kernel, pre = records.parts_of(table)
    parts = [kernel] if table.gamma else [[w for x, w in kernel if x == letter] for letter in "AB"]
    assert all(abs(mpmath.fsum(part) - 1) < 1e-55 for part in parts)
    if table.gamma:
        assert abs(mpmath.fsum(pre)) < 1e-55
        assert abs(mpmath.fsum(pre[: len(pre) // 2])) < 1e-55


def test_the_inverse_runs_backwards():
    _, first = records.parts_of(BY_NAME["blanes-casas-ros-p4"])
    found = residuals("splitting", first + inverse(first), 5)
    exact = residuals("splitting", [], 5)
    assert all(apart(found[key], exact[key]) < 1e-55 for key in found)


def test_starting_values_leave_out_implied_numbers():
    table = BY_NAME["blanes-casas-murua-p11-6"]
    assert len(starting_values(table)) == len(table.published) == 7
    assert list(map(len, records.parts_of(table))) == [11, 12]


# -- runs -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("id", IDS)
def test_one_and_50_steps_are_those_of_a_plain_implementation(plain, id):
    found = plain(id)
    assert max(found["distance"]) < 1e-34
    assert min(found["control"]) > 1e-27, "the control: the processor changed in the 18th digit"


@pytest.mark.parametrize("id", IDS)
def test_doubles_agree_to_round_off(plain, id):
    """Rows are saved on the way, where the processor is taken back and applied again."""
    q, p = processed_steps.START
    for steps, end in zip(processed_steps.STEPS, plain(id)["ends"], strict=True):
        s = integrate(processed_steps.SYSTEM, id, h=processed_steps.H, steps=steps, q0=q, p0=p, save_every=7)
        np.testing.assert_allclose([*s.q[-1], *s.p[-1]], end, rtol=0, atol=1e-15 * (5 + steps))


@pytest.mark.parametrize("id", IDS)
def test_steps_between_rows_cost_the_kernel_alone(id):
    """A row costs the processor and its inverse; the last kick of a step is the first of the next."""
    kernel, pre = map(records.letters, records.parts_of(BY_NAME[id]))
    kernel, pre = records.weights(kernel), records.rows(pre)
    own = sum(b != 0 for b in kernel[1][1:])
    own += kernel[1][0] != 0 and kernel[1][-1] == 0
    first = 2 * (kernel[1][0] != 0)
    row = 2 * sum(b != 0 for _, b in pre) + first
    for every in (1, 5, 20):
        s = integrate(PENDULUM, id, h=0.05, steps=20, q0=[1.3], p0=[0.4], save_every=every)
        assert s.counts["gradient"] == 20 * own + 20 // every * row


@pytest.mark.parametrize("id", ["blanes-p7-6", "blanes-casas-ros-p3", "blanes-casas-ros-p4"])
def test_lanes_integrate_the_same_orbits(id):
    Q, P = np.linspace(0.5, 1.5, 9)[:, None], np.linspace(0.1, 0.3, 9)[:, None]
    found = [integrate_ensemble(PENDULUM, id, Q, P, h=0.05, steps=200, lanes=lanes) for lanes in (True, False)]
    assert found[0].in_lanes.all()
    assert not found[1].in_lanes.any()
    np.testing.assert_allclose(found[0].q, found[1].q, rtol=0, atol=1e-13)
    assert np.ptp(found[0].q[:, 0]) > 1e-3, "the control: the orbits differ"


def test_weights_of_a_kernel_that_begins_with_a_drift():
    half, one = mpmath.mpf(1) / 2, mpmath.mpf(1)
    assert records.weights([("A", half), ("B", one), ("A", half)]) == ((half, half), (0, one, 0))
    assert records.weights(records.letters([one])) == ((one,), (half, half))
    assert records.rows([("B", one), ("B", one), ("A", half)]) == ((0, 2), (half, 0))


def test_a_processed_method_refuses_a_system_that_is_not_separable():
    coupled = Hamiltonian(q="q", p="p", H="p**2*(1 + q**2)/2")
    with pytest.raises(InvalidInput, match="separable"):
        integrate(coupled, "blanes-p7-6", h=0.1, steps=1, q0=[1.0], p0=[0.0])
