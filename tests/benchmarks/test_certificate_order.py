"""The order of a step from errors at several h and from its series: steps of known order, truncated coefficients."""

from __future__ import annotations

from fractions import Fraction
from math import nan

import gmpy2
import numpy as np
import pytest

from phasebench.benchmarks.certificate import battery, order
from phasebench.benchmarks.certificate.order import Series, differences
from phasebench.benchmarks.certificate.stepping import StepFailed, Stepper
from phasebench.benchmarks.certificate.subject import subject
from phasebench.integrators.compile.codegen import DOUBLE, MULTIPRECISION

PENDULUM = battery.find_entry("pendulum")


def verlet(system, q, p, h, kick=Fraction(1, 2)):
    p = p - h * system.dH_dq(q, p) * kick.numerator / kick.denominator
    q = q + h * system.dH_dp(q, p)
    return q, p - h * system.dH_dq(q, p) / 2


def truncated_verlet(system, q, p, h):
    """Verlet whose first half kick has a coefficient cut to ten digits."""
    return verlet(system, q, p, h, Fraction(5_000_000_001, 10_000_000_000))


def euler(system, q, p, h):
    return q + h * system.dH_dp(q, p), p - h * system.dH_dq(q, p)


def rk4(system, q, p, h):
    def slopes(q, p):
        return system.dH_dp(q, p), -system.dH_dq(q, p)

    a = slopes(q, p)
    b = slopes(*(x + h * k / 2 for x, k in zip((q, p), a, strict=True)))
    c = slopes(*(x + h * k / 2 for x, k in zip((q, p), b, strict=True)))
    d = slopes(*(x + h * k for x, k in zip((q, p), c, strict=True)))
    return tuple(x + h * (k + 2 * m + 2 * n + o) / 6 for x, k, m, n, o in zip((q, p), a, b, c, d, strict=True))


def broken(system, q, p, h):
    return q / (h - h), p


def stepper(step, arithmetic=MULTIPRECISION) -> Stepper:
    return Stepper(subject(step), PENDULUM, arithmetic)


# -- series ------------------------------------------------------------------------------------------------------------


def test_differences_give_the_coefficients_of_a_polynomial():
    coefficients = np.array([3.0, -1.0, 0.5, 2.0])
    values = [np.array([sum(c * j**k for k, c in enumerate(coefficients)), 7.0]) for j in range(4)]
    found = np.array(differences(values))
    assert np.allclose(found[:, 0], coefficients)
    assert np.allclose(found[:, 1], [7, 0, 0, 0])


def test_count_of_leading_terms_that_vanish():
    terms = Series((1e-16, 1e-10, 0.9 * order.VANISHES, 0.2, 1e-30))
    others = (Series((0.1,)), Series((1e-9, nan, 1e-9)), Series((0.0, 0.0)))
    assert [series.clean for series in (terms, *others)] == [3, 0, 1, 2]
    assert [terms.largest(k) for k in (0, 1, 2, 5)] == [0.0, 1e-16, 1e-10, 0.9 * order.VANISHES]
    assert Series((order.VANISHES,)).clean == 0


@pytest.mark.parametrize(("step", "p"), [(euler, 1), (verlet, 2), (rk4, 4)])
def test_step_of_order_p_has_p_vanishing_terms(step, p):
    found = order.series(stepper(step), 1)
    assert found.clean == p
    assert len(found.terms) == order.TERMS
    assert found.largest(p) < 1e-60
    assert 0.01 < found.terms[p] < 10


def test_truncated_coefficient_shows_in_the_first_term():
    """A first kick that is 1e-10 h too long leaves an error of order h of that size, relative to the field."""
    found = order.series(stepper(truncated_verlet), 1)
    assert found.clean == 2
    slopes = np.abs(PENDULUM.system.vector_field()(0.0, PENDULUM.start(1)))
    assert found.terms[0] == pytest.approx(1e-10 * slopes[1] / slopes.max(), rel=1e-6, abs=0)


# -- ladders -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("step", "p"), [(euler, 1), (verlet, 2), (rk4, 4)])
@pytest.mark.parametrize("arithmetic", [DOUBLE, MULTIPRECISION])
def test_order_of_known_steps(step, p, arithmetic):
    row = order.order(stepper(step, arithmetic), 1)
    assert row["value"] == pytest.approx(p, abs=0.1)
    assert row["low"] <= row["value"] <= row["high"]
    assert len(row["h"]) == len(row["error"]) == len(battery.LADDER)
    assert row["h"][0] == float(battery.SPAN)
    assert (row["on"], row["arithmetic"]) == ("pendulum", arithmetic)
    if arithmetic == DOUBLE:
        assert row["constant"] <= row["doubt"] < 1e-8, "nothing is left of a consistent step as h falls"
    else:
        assert row["clean"] == p


def test_limit_error_of_an_inconsistent_step():
    """Kicks that are 1e-3 too long leave an error that does not vanish with h, of that size relative to the field."""

    def longer(system, q, p, h):
        return verlet(system, q, p, h, Fraction(501, 1000))

    slopes = np.abs(PENDULUM.system.vector_field()(0.0, PENDULUM.start(1)))
    row = order.order(stepper(longer, DOUBLE), 1)
    assert row["constant"] == pytest.approx(1e-3 * slopes[1] / slopes.max(), rel=1e-4, abs=0)
    assert row["doubt"] < 1e-3 * row["constant"]


def test_errors_are_relative_to_the_size_of_the_state():
    """The error of a step that does nothing is the orbit's displacement, relative to the size of its end."""
    row = order.ladder(stepper(lambda system, q, p, h: (q + 0 * h, p + 0 * h), DOUBLE), 1)
    start, (end, _) = PENDULUM.start(1), order.flow(PENDULUM, 1, battery.SPAN)
    end = end.astype(float)
    assert row["error"] == pytest.approx([np.abs(start - end).max() / np.abs(end).max()] * len(battery.LADDER))


def test_arithmetic_failure_has_no_error_others_raise():
    row = order.ladder(stepper(broken, DOUBLE), 1)
    assert np.isnan(row["error"]).all()
    with pytest.raises(StepFailed, match="KeyError") as raised:
        order.ladder(stepper(lambda system, q, p, h: {}["ZeroDivisionError:"], DOUBLE), 1)
    assert not raised.value.numerical

    class NotConverged(ArithmeticError):
        """The error of a user's own solver."""

    def gives_up(system, q, p, h):
        raise NotConverged("25 iterations")

    assert np.isnan(order.ladder(stepper(gives_up, DOUBLE), 1)["error"]).all()


def test_exact_step_has_no_order():
    """A step that is the oscillator's rotation, in the precision of its arguments, is exact."""

    def rotation(system, q, p, h):
        c, s = gmpy2.cos(h), gmpy2.sin(h)
        return c * q + s * p, c * p - s * q

    row = order.order(Stepper(subject(rotation), battery.oscillator(), MULTIPRECISION), 1)
    assert (row["points"], row["clean"]) == (0, order.TERMS)
    assert np.isnan(row["value"])


@pytest.mark.parametrize(("least", "told"), [(0.1, True), (0.08, False)])
def test_limit_error_needs_eight_step_sizes(least, told):
    """A step fails at the three or four largest of eleven h; with seven h left no limit error is stated."""

    def small(system, q, p, h):
        return verlet(system, q, p, h) if h < least else (q / (h - h), p)

    row = order.constant(stepper(small, DOUBLE), 1, order.metrics.Order(2.0, 2.0, 2.0, 0.1, 0.01, 8))
    assert ("constant" in row, "doubt" in row) == (told, told)


def test_expensive_step_has_fewer_multiprecision_rungs():
    def dear(evaluations):
        def step(system, q, p, h):
            for _ in range(evaluations - 3):
                system.dH_dq(q, p)
            return verlet(system, q, p, h)

        return step

    lengths = [len(order.rungs(stepper(dear(n)))) for n in (order.DEAR, order.DEAR + 1)]
    assert lengths == [len(battery.LADDER), order.SHORTER]
    assert len(order.rungs(stepper(dear(order.DEAR + 1), DOUBLE))) == len(battery.LADDER)
