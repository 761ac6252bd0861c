"""Adjoints and symmetry: a step with H, then one with -H (the flow over -h), in multiprecision."""

from __future__ import annotations

from fractions import Fraction

import pytest

from phasebench.benchmarks.measure.battery import by_label, high_order_variants, variants
from phasebench.benchmarks.measure.multiprecision import digits

ROUND_OFF, VISIBLE = 1e-30, 1e-22
HIGH = 8
ALL = by_label(variants() + high_order_variants())
#: Of a symmetric method the adjoint is the method itself, which is tested as its symmetry.
WITH_LAMBDA = [label for label, m in by_label(variants()).items() if "lam" in m.parameters and not m.symmetric]


def shown(label):
    """What a defect shows above: less for methods of high order, of which more digits are measured."""
    return VISIBLE if ALL[label].order <= HIGH else 10.0 ** (-digits(ALL[label]) / 2)


def numbers(row):
    """A measurement of which no part failed."""
    assert row
    assert not [x for x in row.values() if isinstance(x, str)], row
    return row


@pytest.mark.parametrize("label", [label for label, m in ALL.items() if m.symmetric])
def test_symmetric_methods_return(measured, label):
    distances = numbers(measured("symmetry")[label])
    assert max(distances.values()) < min(ROUND_OFF, shown(label)), distances


@pytest.mark.parametrize("label", [label for label, m in ALL.items() if not m.symmetric])
def test_control_the_others_do_not_return_everywhere(measured, label):
    distances = numbers(measured("symmetry")[label])
    assert max(distances.values()) > shown(label), distances


def test_the_known_controls_are_among_the_others():
    asymmetric = {label for label, m in ALL.items() if not m.symmetric}
    assert {"explicit-euler", "rk4", "scheme-i(lam=1/3)", "symplectic-euler-p"} <= asymmetric


@pytest.mark.parametrize("label", WITH_LAMBDA)
def test_the_adjoint_of_lambda_is_one_minus_lambda(measured, label):
    rows = measured("adjoint")[label]
    assert rows
    for name, row in rows.items():
        assert row["adjoint"] < ROUND_OFF, f"{name}: {row}"
        assert row["itself"] > VISIBLE, f"{name}, the control: {row}"


def test_scheme_i_adjoint_is_scheme_i_at_one_minus_lambda():
    methods = by_label(variants())
    for lam in (Fraction(-1), Fraction(1, 3), Fraction(3, 2)):
        adjoint = methods[f"scheme-i-adjoint(lam={lam})"]
        assert adjoint.data == methods["scheme-i(lam=1/3)"](lam=1 - lam).data
        assert adjoint.data != methods["scheme-i(lam=1/3)"](lam=lam).data
