"""Observed order of a method of each kind in multiprecision, on nonlinear and non-separable systems."""

from __future__ import annotations

import pytest

from phasebench.benchmarks.measure.battery import NON_SEPARABLE, expected_order, systems
from phasebench.benchmarks.measure.multiprecision import observed_order
from phasebench.integrators.compile.codegen import MULTIPRECISION, precision, to_number
from phasebench.integrators.registry import BY_ID, METHODS
from support.exact import ALL, SAME_KIND, cells

TOLERANCE = 0.1
CASES = cells("orders")


def order_or_fail(row):
    """Observed order of a measurement; fail if the measurement is an error message."""
    assert not isinstance(row, str), row
    return observed_order(row)


def agrees(o, order):
    """Whether an observed order is within `TOLERANCE` of the order, above and below."""
    return abs(o.value - order) < TOLERANCE


@pytest.mark.parametrize(("label", "name"), CASES)
def test_the_observed_order_is_the_declared_one(measured, label, name):
    o = order_or_fail(measured("orders")[label][name])
    assert o.points >= 3
    assert agrees(o, expected_order(ALL[label], name)), f"observed {o}"


def test_every_method_is_measured(measured):
    assert set(measured("orders")) == set(ALL)
    for label, m in ALL.items():
        assert measured("orders")[label], f"{label} runs on no system of the suite"
        found = set(measured("orders")[label])
        for name in systems(m):
            assert {name, SAME_KIND.get(name)} & found, f"{label} on the kind of {name}"
        if not set(m.requires) - {"canonical", "Poisson structure"}:
            assert found & set(NON_SEPARABLE), f"{label} is measured on separable systems only"


def test_control_a_wrong_coefficient_changes_the_order(measured):
    spoiled = measured("control_errors")
    assert {BY_ID[id].family for id in spoiled} >= {"runge_kutta", "splitting", "parametric", "schemes_iv_v"}
    for id, rows in spoiled.items():
        assert rows
        for name, row in rows.items():
            assert not agrees(order_or_fail(row), expected_order(BY_ID[id], name)), (
                f"{id} on {name}: {order_or_fail(row)}"
            )


def test_control_midpoint_with_a_wrong_weight_loses_an_order(measured):
    rows = measured("orders")
    right, wrong = "scheme-i(lam=1/2)", "scheme-i(lam=1/3)"
    for name in rows[right]:
        assert order_or_fail(rows[right][name]).value - order_or_fail(rows[wrong][name]).value > 0.8


def fractions(m):
    """Fractions of the step taken by the substeps of a record, without alternative substeps."""
    if m.family == "schemes_iv_v":
        return [c for c, _, _, alternative in m.data if alternative == 0]
    return [row[0] for row in m.data[1]]


def test_fractions_of_substeps_add_up_to_one():
    """In the imported records; fractions rounded to doubles would cause a clock error of 1e-16."""
    composed = [m for m in METHODS if m.family in ("parametric", "schemes_iv_v")]
    with precision(50):
        off = {m.id: abs(sum(to_number(c, MULTIPRECISION) for c in fractions(m)) - 1) for m in composed}
    assert len(off) > 100
    assert max(off.values()) < 1e-40, max(off, key=off.get)
