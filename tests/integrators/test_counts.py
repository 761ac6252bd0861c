"""What a solution says it evaluated is what was called: by it methods of different kinds are compared."""

from __future__ import annotations

import pytest

from phasebench.benchmarks.measure.battery import SYSTEMS
from phasebench.integrators.driver import integrate
from support import counts


@pytest.fixture(scope="module")
def counted(of_each):
    return of_each(counts)


@pytest.mark.parametrize("label", counts.ALL)
def test_every_evaluation_is_counted_once(counted, label):
    found = counted(label)
    assert found
    for name, (told, called) in found.items():
        assert told == called > 0, name


@pytest.mark.parametrize("id", ["stormer-verlet", "stormer-verlet-dkd", "symplectic-euler-p", "symplectic-euler-q"])
def test_substeps_of_symplectic_euler_iterate_where_H_is_not_separable_alone(id):
    for name, explicit in (("henon-heiles", True), ("coupled", False)):
        system, q, p = SYSTEMS[name]()
        told = integrate(system, id, h=counts.H, steps=3, q0=q, p0=p).counts
        assert (told["iterations"] == 0) == explicit
        assert (told["gradient"] <= 4) == explicit
