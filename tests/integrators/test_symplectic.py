"""Symplecticity defect of every step map, from Jacobians in multiprecision."""

from __future__ import annotations

import pytest

from phasebench.benchmarks.measure.visible import least_visible
from support.exact import ALL, VISIBLE, numbers

#: Bound on the error of difference Jacobians with 40 digits.
ROUND_OFF = 1e-26
SYMPLECTIC = [label for label, m in ALL.items() if m.symplectic]
OTHERS = [label for label, m in ALL.items() if m.one_step and not m.symplectic]


@pytest.mark.parametrize("label", SYMPLECTIC)
def test_symplectic(measured, label):
    defects = numbers(measured("symplecticity")[label])
    assert max(defects.values()) < min(ROUND_OFF, least_visible(label, "symplecticity")), defects


@pytest.mark.parametrize("label", OTHERS)
def test_control_other_methods_are_visibly_not_symplectic(measured, label):
    defects = numbers(measured("symplecticity")[label])
    assert max(defects.values()) > least_visible(label, "symplecticity"), defects


def test_known_controls_are_not_declared_symplectic():
    assert {"rk4", "explicit-euler", "implicit-euler", "avf", "scheme-iv", "scheme-v"} <= set(OTHERS)


@pytest.mark.parametrize("label", ["scheme-iv", "scheme-v"])
def test_a_step_with_fixed_lambda_is_symplectic(measured, label):
    rows, free = measured("frozen")[label], measured("symplecticity")[label]
    assert len(free) > 1
    assert [row for row in rows.values() if row["lam"] != 0.5], "no step has a root of its own"
    for name, row in rows.items():
        assert row["distance"] < 1e-14, f"{name}: the frozen step is not the step that was taken"
        assert row["defect"] < ROUND_OFF, name
        assert name not in free or free[name] > VISIBLE or row["lam"] == 0.5, name
