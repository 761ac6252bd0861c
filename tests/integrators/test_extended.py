"""Methods in extended phase space: what holds of the map of both copies, and what a copy is for."""

from __future__ import annotations

import json
from fractions import Fraction
from unittest import mock

import numpy as np
import pytest

from phasebench.benchmarks.measure.battery import SYSTEMS
from phasebench.benchmarks.measure.step_map import pair_defect
from phasebench.integrators.compile.codegen import MULTIPRECISION, precision, to_number, vector
from phasebench.integrators.driver import integrate
from phasebench.integrators.families import extended
from phasebench.integrators.prepared import lay_out
from phasebench.integrators.record import Method
from phasebench.integrators.registry import method
from phasebench.integrators.stepping import kernel


def pair_map(record: Method, system, h, steps=1):
    """The map of (q, p, x, y) by some steps, which starts from a copy that is another state."""
    d = system.d
    prepared = kernel.prepare(record, system, MULTIPRECISION)

    def advance(z, h=h):
        run = lay_out(prepared, d, h, z[:d], z[2 * d : 3 * d], MULTIPRECISION)
        run.carry.state[extended.COPY, :d], run.carry.state[extended.COPY + 1, :d] = z[d : 2 * d], z[3 * d :]
        run.counts.steps = 1  # a step was taken: the copy is read, not made
        rows = np.zeros((2, 1, d), dtype=object)
        run(*rows, np.zeros((1, 1)), steps)
        table = run.carry.state
        return np.concatenate([table[k, :d] for k in (0, extended.COPY, 1, extended.COPY + 1)])

    return advance


def structure() -> dict:
    """{method: (defect of symplecticity, distance after a step forth and back) of both copies}, and a control."""
    system, q, p = SYSTEMS["coupled"]()
    found, h = {}, to_number(Fraction(1, 40), MULTIPRECISION)
    with precision(40):
        z = vector([*q, *(x + 0.1 for x in q), *p, *(x - 0.05 for x in p)])

        def measured(record):
            advance = pair_map(record, system, h)
            return float(pair_defect(advance, z)), float(max(abs(advance(advance(z), -h) - z)))

        for id in ("tao-2", "tao-4", "pihajoki-2"):
            found[id] = measured(method(id))
        cos = extended.cos
        with mock.patch.object(extended, "cos", lambda x: cos(x) * (1 + to_number(Fraction(1, 10**9), MULTIPRECISION))):
            found["no rotation"] = measured(method("tao-2"))
    return found


@pytest.fixture(scope="module")
def there(uncompiled):
    return uncompiled("integrators/test_extended.py")


@pytest.mark.parametrize("id", ["tao-2", "tao-4", "pihajoki-2"])
def test_the_map_of_both_copies_is_symplectic_and_symmetric(there, id):
    symplecticity, symmetry = there[id]
    assert symplecticity < 1e-26
    assert symmetry < 1e-36


def test_control_a_turn_that_is_no_rotation_is_not_symplectic(there):
    assert there["no rotation"][0] > 1e-12


def test_free_copies_part_if_h_is_not_separable_and_bound_ones_stay():
    system, q, p = SYSTEMS["tao"]()
    free, bound = (integrate(system, id, h=0.01, steps=3000, q0=q, p0=p).energy() for id in ("pihajoki-2", "tao-2"))
    free, bound = (np.abs(E / E[0] - 1) for E in (free, bound))
    assert free.max() > 100 * free[:300].max()
    assert bound.max() < 2 * bound[:300].max() < 1e-4


if __name__ == "__main__":
    print(json.dumps({"result": structure()}))
