"""What a solution says it evaluated is what was called: by it methods of different kinds are compared."""

from __future__ import annotations

import pytest

from phasebench.benchmarks.measure.battery import SYSTEMS
from phasebench.integrators.driver import integrate
from phasebench.integrators.records.projection import projected
from support import counts, stiff


@pytest.fixture(scope="module")
def counted(of_each):
    return of_each(counts)


#: Methods that never solve an equation; those of "parametric" and their projections do where H is not separable.
EXPLICIT = {"runge_kutta", "splitting", "relaxation", "trigonometric", "wisdom_holman"}
EXPLICIT_ONES = {"variational-trapezoidal", "stormer-verlet-adaptive"}


@pytest.mark.parametrize("label", counts.ALL)
def test_every_evaluation_is_counted_once(counted, label):
    found = counted(label)
    assert len(found) > (label in stiff.METHODS)
    for name, told in found.items():
        assert told["gradient"] == told["called"] > 0, name


@pytest.mark.parametrize("label", counts.ALL)
def test_the_kernel_counts_what_a_solution_tells(counted, label):
    """A prepared run tells all of it; a solution counts its steps by its rows, which are of its h where steps vary."""
    own = {"steps"} if counts.ALL[label].family == "adaptive" else set()
    for name, told in counted(label).items():
        for key in set(counts.TOLD) - own:
            assert told["kernel"][key] == told[key], (name, key)


@pytest.mark.parametrize("label", counts.ALL)
def test_a_step_is_told_once_and_only_a_long_one_needs_newton(counted, label):
    """Where steps vary there are more of them in as much time, or fewer."""
    for name, told in counted(label).items():
        assert told["steps"] == counts.STEPS or counts.ALL[label].family == "adaptive", name
        assert (told["newton"] > 0) == (name in counts.LONG), name
        assert told["fallbacks"] == 0, name


@pytest.mark.parametrize("label", [x for x, m in counts.ALL.items() if m.family not in ("parametric", "projection")])
def test_evaluations_are_iterations_where_an_equation_is_solved(counted, label):
    explicit = counts.ALL[label].family in EXPLICIT or label in EXPLICIT_ONES
    for name, told in counted(label).items():
        assert told["iterations"] == (0 if explicit else told["gradient"]), name


@pytest.mark.parametrize("base", ["rk4", "stormer-verlet", "implicit-midpoint"])
def test_a_projection_iterates_as_its_base_does(base):
    for name in ("henon-heiles", "coupled"):
        system, q, p = SYSTEMS[name]()
        told = [integrate(system, m, h=counts.H, steps=3, q0=q, p0=p).counts for m in (base, projected(base))]
        assert told[1]["gradient"] > told[0]["gradient"]
        assert {bool(of["iterations"]) for of in told} == {told[0]["iterations"] > 0}


@pytest.mark.parametrize("id", ["stormer-verlet", "stormer-verlet-dkd", "symplectic-euler-p", "symplectic-euler-q"])
def test_substeps_of_symplectic_euler_iterate_where_H_is_not_separable_alone(id):
    for name, explicit in (("henon-heiles", True), ("coupled", False)):
        system, q, p = SYSTEMS[name]()
        told = integrate(system, id, h=counts.H, steps=3, q0=q, p0=p).counts
        assert (told["iterations"] == 0) == explicit
        assert (told["gradient"] <= 4) == explicit
