"""Orders, symplecticity, volume, symmetry, each coefficient's effect, in multiprecision, of a method of each kind."""

from __future__ import annotations

from fractions import Fraction

import mpmath
import numpy as np
import pytest

from phasebench.benchmarks.measure.battery import NON_SEPARABLE, by_label, expected_order, systems, variants
from phasebench.benchmarks.measure.declared import least_visible
from phasebench.benchmarks.measure.multiprecision import CELLS, observed_order
from phasebench.benchmarks.measure.step_map import determinant, volume
from phasebench.integrators.coefficients.table import value
from phasebench.integrators.coefficients.trees import DIGITS, order_residual, vector
from phasebench.integrators.records import projection
from phasebench.integrators.registry import BY_ID, METHODS, method
from support.exact import ALL, RECORDS, SAME_KIND, VISIBLE, cells, numbers
from support.slips import MOST, leaves

TOLERANCE = 0.1
#: Bound on the error of difference Jacobians with 40 digits.
ROUND_OFF = 1e-26


@pytest.mark.parametrize("id", ["explicit-euler", "rk4", "kutta-3"])
def test_a_tableau_is_explicit_and_of_its_order(id):
    m = projection.KUTTA_3 if id == "kutta-3" else method(id)
    with mpmath.workdps(DIGITS):
        *rows, b = (vector(value(str(x)) for x in row) for row in m.data)
        A = np.array(rows)
        assert not np.triu(A).any()
        assert order_residual(A, b, range(1, m.order + 1)) < 1e-25
        assert order_residual(A, b, [m.order + 1]) > 1e-6


# -- orders -----------------------------------------------------------------------------------------------------------


def order_or_fail(row):
    """Observed order of a measurement; fail if the measurement is an error message."""
    assert not isinstance(row, str), row
    return observed_order(row)


def agrees(o, order):
    return abs(o.value - order) < TOLERANCE


@pytest.mark.parametrize(("label", "name"), cells("orders"))
def test_the_observed_order_is_the_declared_one(measured, label, name):
    o = order_or_fail(measured("orders")[label][name])
    assert o.points >= 3
    assert agrees(o, expected_order(ALL[label], name)), f"observed {o}"


def test_every_kind_is_measured_on_nonlinear_and_non_separable_systems(measured):
    assert set(measured("orders")) == set(ALL)
    for label, m in ALL.items():
        found = set(measured("orders")[label])
        assert found, f"{label} runs on no system of the suite"
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
            o = order_or_fail(row)
            assert not agrees(o, expected_order(BY_ID[id], name)), f"{id} on {name}: {o}"


# -- structure --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("label", [label for label, m in ALL.items() if m.one_step])
def test_a_step_is_symplectic_if_and_only_if_declared(measured, label):
    worst = max(numbers(measured("symplecticity")[label]).values())
    if ALL[label].symplectic:
        assert worst < min(ROUND_OFF, least_visible(label, "symplecticity"))
    else:
        assert worst > least_visible(label, "symplecticity")


@pytest.mark.parametrize("label", ["scheme-iv", "scheme-v"])
def test_a_step_with_fixed_lambda_is_symplectic(measured, label):
    rows, free = measured("frozen")[label], measured("symplecticity")[label]
    assert len(free) > 1
    assert [row for row in rows.values() if row["lam"] != 0.5], "no step has a root of its own"
    for name, row in rows.items():
        assert row["distance"] < 1e-14, f"{name}: the frozen step is not the step that was taken"
        assert row["defect"] < ROUND_OFF, name
        assert name not in free or free[name] > VISIBLE or row["lam"] == 0.5, name


@pytest.mark.parametrize("label", [label for label, m in ALL.items() if CELLS["volume"][1](m)])
def test_volume_is_kept_if_and_only_if_declared(measured, label):
    """On charged particles; explicit Euler and RK4 are the controls."""
    defects = measured("volume")[label]
    assert set(defects) == {"charged-particle", "magnetic-mirror", "relativistic-particle"}
    assert ALL[label].keeps_volume == (label not in ("explicit-euler", "rk4"))
    if ALL[label].keeps_volume:
        assert max(defects.values()) < ROUND_OFF, defects
    else:
        assert min(defects.values()) > VISIBLE, defects


def test_determinants_and_volumes_of_known_maps():
    M = np.random.default_rng(5).standard_normal((5, 5))
    assert determinant(M[::-1]) == pytest.approx(np.linalg.det(M[::-1]), rel=1e-12)
    assert determinant([[0.0, 2.0], [3.0, 5.0]]) == -6.0, "the first pivot is zero"
    defect, noise = volume(lambda y: np.array([2 * y[0] + y[1] ** 2, y[1] / 2]), np.array([0.3, 0.4]), 1e-3, 2e-3)
    assert max(defect, noise) < 1e-12
    assert volume(lambda y: y * 1.1, np.array([0.3, 0.4]), 1e-3)[0] == pytest.approx(0.21, rel=1e-9)


# -- adjoints and symmetry: a step h, then a step -h of the adjoint, returns to the start -----------------------------

#: Bound on the distance from the start.
RETURNED = 1e-30
#: Methods with lambda that are not symmetric; the adjoint of a symmetric method is itself.
WITH_LAMBDA = [label for label, m in by_label(variants()).items() if "lam" in m.parameters and not m.symmetric]


@pytest.mark.parametrize("label", [label for label, m in ALL.items() if m.one_step and m.symmetric])
def test_symmetric_methods_return(measured, label):
    distances = numbers(measured("symmetry")[label])
    assert max(distances.values()) < min(RETURNED, least_visible(label, "symmetry")), distances


@pytest.mark.parametrize("label", [label for label, m in ALL.items() if not m.symmetric])
def test_control_other_methods_do_not_return(measured, label):
    distances = numbers(measured("symmetry")[label])
    assert max(distances.values()) > least_visible(label, "symmetry"), distances


@pytest.mark.parametrize("label", WITH_LAMBDA)
def test_the_adjoint_of_lambda_is_one_minus_lambda(measured, label):
    rows = measured("adjoint")[label]
    assert rows
    for name, row in rows.items():
        assert row["adjoint"] < RETURNED, f"{name}: {row}"
        assert row["itself"] > VISIBLE, f"{name}, the control: {row}"


def test_the_adjoint_of_scheme_i_has_one_minus_lambda():
    for lam in (Fraction(-1), Fraction(1, 3), Fraction(3, 2)):
        adjoint = RECORDS[f"scheme-i-adjoint(lam={lam})"]
        assert adjoint.data == RECORDS["scheme-i(lam=1/3)"](lam=1 - lam).data
        assert adjoint.data != RECORDS["scheme-i(lam=1/3)"](lam=lam).data


# -- each coefficient -------------------------------------------------------------------------------------------------

#: Coefficients that what is declared does not fix: any weight of the gradient has order 2; the record's is the one of
#: effective order 4 (test_splitting.py).
FREE = {("takahashi-imada", (0, 1, 2))}
WITH_COEFFICIENTS = [m.id for m in METHODS if 0 < len(list(leaves(m.data))) <= MOST]


@pytest.mark.parametrize("id", WITH_COEFFICIENTS)
def test_a_changed_coefficient_shows(measured, id):
    """A millionth makes the error of a step at least ten times larger, or destroys symplecticity or symmetry.

    Long compositions and splittings are covered by the order conditions (test_coefficients.py).
    """
    found, m = measured("perturbation_effects")[id], BY_ID[id]
    assert len(found["rows"]) == len(list(leaves(m.data)))
    for row in found["rows"]:
        if m.family == "schemes_iv_v" and m.data[row["path"][0]][3]:
            continue  # an alternative substep, which is not used here
        if (id, tuple(row["path"])) in FREE:
            continue
        lost = row["error"] >= 10 * found["error"]
        lost |= m.symplectic and row.get("symplecticity", 0) > 1e-15
        lost |= m.symmetric and row.get("symmetry", 0) > 1e-15
        assert lost, f"{id}: coefficient {row['path']} may be wrong: {row}, unperturbed {found['error']:.1e}"
