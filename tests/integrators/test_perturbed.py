"""Changing any one coefficient by a millionth of itself breaks what its method declares.

Tested are the coefficients in the data of records. Those that kernels compute, such as Gauss nodes, have tests of their
own; long compositions and splittings are covered by the order conditions (test_coefficients.py).
"""

from __future__ import annotations

import pytest

from phasebench.benchmarks.measure.multiprecision import MOST, leaves
from phasebench.integrators.registry import BY_ID, METHODS

VISIBLE = 1e-15
#: Coefficients that what is declared does not fix: any weight of the gradient has order 2; the record's is the one of
#: effective order 4 (test_force_gradient.py).
FREE = {("takahashi-imada", (0, 1, 2))}
WITH_COEFFICIENTS = [m.id for m in METHODS if 0 < len(list(leaves(m.data))) <= MOST]


@pytest.mark.parametrize("id", WITH_COEFFICIENTS)
def test_a_changed_coefficient_shows(measured, id):
    """Each change makes the error of a step at least ten times larger, or destroys symplecticity or symmetry."""
    found, m = measured("perturbation_effects")[id], BY_ID[id]
    assert len(found["rows"]) == len(list(leaves(m.data)))
    for row in found["rows"]:
        if m.family == "schemes_iv_v" and m.data[row["path"][0]][3]:
            continue  # an alternative substep, which is not used here
        if (id, tuple(row["path"])) in FREE:
            continue
        lost = row["error"] >= 10 * found["error"]
        lost |= m.symplectic and row.get("symplecticity", 0) > VISIBLE
        lost |= m.symmetric and row.get("symmetry", 0) > VISIBLE
        assert lost, f"{id}: coefficient {row['path']} may be wrong: {row}, unperturbed {found['error']:.1e}"


def test_most_methods_have_tested_coefficients():
    assert len(WITH_COEFFICIENTS) > 20
