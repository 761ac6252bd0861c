"""Adjoints and symmetry in multiprecision: a step h, then a step -h of the adjoint, returns to the start."""

from __future__ import annotations

from fractions import Fraction

import pytest

from phasebench.benchmarks.measure.battery import by_label, variants
from phasebench.benchmarks.measure.declared import least_visible
from support.exact import ALL, RECORDS, VISIBLE, numbers

ROUND_OFF = 1e-30
#: Methods with lambda that are not symmetric; the adjoint of a symmetric method is itself.
WITH_LAMBDA = [label for label, m in by_label(variants()).items() if "lam" in m.parameters and not m.symmetric]


@pytest.mark.parametrize("label", [label for label, m in ALL.items() if m.one_step and m.symmetric])
def test_symmetric_methods_return(measured, label):
    distances = numbers(measured("symmetry")[label])
    assert max(distances.values()) < min(ROUND_OFF, least_visible(label, "symmetry")), distances


@pytest.mark.parametrize("label", [label for label, m in ALL.items() if not m.symmetric])
def test_control_other_methods_do_not_return(measured, label):
    distances = numbers(measured("symmetry")[label])
    assert max(distances.values()) > least_visible(label, "symmetry"), distances


@pytest.mark.parametrize("label", WITH_LAMBDA)
def test_the_adjoint_of_lambda_is_one_minus_lambda(measured, label):
    rows = measured("adjoint")[label]
    assert rows
    for name, row in rows.items():
        assert row["adjoint"] < ROUND_OFF, f"{name}: {row}"
        assert row["itself"] > VISIBLE, f"{name}, the control: {row}"


def test_the_adjoint_of_scheme_i_has_one_minus_lambda():
    for lam in (Fraction(-1), Fraction(1, 3), Fraction(3, 2)):
        adjoint = RECORDS[f"scheme-i-adjoint(lam={lam})"]
        assert adjoint.data == RECORDS["scheme-i(lam=1/3)"](lam=1 - lam).data
        assert adjoint.data != RECORDS["scheme-i(lam=1/3)"](lam=lam).data
