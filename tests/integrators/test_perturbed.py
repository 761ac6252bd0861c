"""No coefficient can be wrong unnoticed: each one changed by a millionth of itself breaks what its method declares.

The coefficients are those in the records' data; those that kernels compute (Gauss nodes, say) have tests of their own,
and long compositions and splittings are checked by the order conditions (tests/test_coefficients.py).
"""

from __future__ import annotations

import pytest

from phasebench.benchmarks.measure.multiprecision import MOST, leaves
from phasebench.integrators.registry import BY_ID, METHODS

VISIBLE = 1e-15
WITH_COEFFICIENTS = [m.id for m in METHODS if 0 < len(list(leaves(m.data))) <= MOST]


@pytest.mark.parametrize("id", WITH_COEFFICIENTS)
def test_a_changed_coefficient_shows(measured, id):
    """The step's error grows tenfold at least, or its symplecticity or symmetry is lost."""
    found, m = measured("perturbed")[id], BY_ID[id]
    assert len(found["rows"]) == len(list(leaves(m.data)))
    for row in found["rows"]:
        if m.family == "schemes_iv_v" and m.data[row["path"][0]][3]:
            continue  # the second choice of scheme-iv-v and scheme-v-iv: not taken here, the first of the other
        lost = row["error"] >= 10 * found["error"]
        lost |= m.symplectic and row.get("symplecticity", 0) > VISIBLE
        lost |= m.symmetric and row.get("symmetry", 0) > VISIBLE
        assert lost, f"{id}: coefficient {row['path']} may be wrong: {row}, unperturbed {found['error']:.1e}"


def test_most_methods_have_coefficients_that_are_tried():
    assert len(WITH_COEFFICIENTS) > 20
