"""Volume of the step maps on charged particles, from Jacobians in multiprecision."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.measure import multiprecision
from phasebench.benchmarks.measure.step_map import determinant, volume
from phasebench.integrators.compile.codegen import precision, vector
from phasebench.integrators.registry import METHODS
from support.exact import ALL

#: Bound on the error of difference Jacobians with 40 digits, and the least visible defect.
ROUND_OFF, VISIBLE = 1e-26, 1e-22
MEASURED = [label for label, m in ALL.items() if multiprecision.CELLS["volume"][1](m)]
KEEPING = [label for label in MEASURED if ALL[label].keeps_volume]
OTHERS = [label for label in MEASURED if not ALL[label].keeps_volume]


def test_all_methods_for_charged_particles_are_measured_and_controls_of_both_kinds():
    assert {m.id for m in METHODS if "magnetic" in m.requires} < set(KEEPING)
    assert {"boris", "higuera-cary", "he-splitting-2", "he-splitting-4", "implicit-midpoint", "gauss-4"} == set(KEEPING)
    assert set(OTHERS) == {"explicit-euler", "rk4"}


@pytest.mark.parametrize("label", KEEPING)
def test_volume_is_kept_where_declared(measured, label):
    defects = measured("volume")[label]
    assert set(defects) == {"charged-particle", "magnetic-mirror", "relativistic-particle"}
    assert max(defects.values()) < ROUND_OFF, defects


@pytest.mark.parametrize("label", OTHERS)
def test_control_others_do_not_keep_it(measured, label):
    defects = measured("volume")[label]
    assert min(defects.values()) > VISIBLE, defects


@pytest.mark.parametrize("n", range(1, 7))
def test_the_determinant(n):
    M = np.random.default_rng(n).standard_normal((n, n))
    assert determinant(M) == pytest.approx(np.linalg.det(M), rel=1e-12)
    assert determinant(M[::-1]) == pytest.approx(np.linalg.det(M[::-1]), rel=1e-12)
    singular = np.vstack([M[1:], M[1:].sum(axis=0)]) if n > 1 else np.zeros((1, 1))
    assert abs(determinant(singular)) < 1e-12


def test_the_determinant_exchanges_rows_where_the_first_pivot_is_zero():
    assert determinant([[0.0, 2.0], [3.0, 5.0]]) == -6.0
    with precision(40):
        assert determinant(np.array([vector(["0", "2"]), vector(["3", "5"])])) == -6


def test_the_volume_of_a_known_map():
    defect, noise = volume(lambda y: np.array([2 * y[0] + y[1] ** 2, y[1] / 2]), np.array([0.3, 0.4]), 1e-3, 2e-3)
    assert max(defect, noise) < 1e-12
    assert volume(lambda y: y * 1.1, np.array([0.3, 0.4]), 1e-3)[0] == pytest.approx(0.21, rel=1e-9)
