"""The numbers of evaluations, steps and iterations that a solution reports are those that were made."""

from __future__ import annotations

import pytest

from phasebench.benchmarks.measure.battery import SYSTEMS
from phasebench.integrators.driver import integrate
from phasebench.integrators.records.projection import projection_method
from support import counts, stiff


@pytest.fixture(scope="module")
def counts_of(of_each):
    """Function: label of a method -> its counts from `support.counts.of`, as reported and as called."""
    return of_each(counts)


#: Families that never solve an equation; "parametric" and its projections do if H is not separable.
EXPLICIT = {"runge_kutta", "splitting", "processed", "force_gradient", "relaxation", "trigonometric", "wisdom_holman"}
EXPLICIT |= {"magnetic", "extended", "parts"}
#: Equations of constraints, or of turns, alone are solved, without the gradient.
EXPLICIT |= {"rattle", "rigid"}
EXPLICIT_ONES = {"variational-trapezoidal", "stormer-verlet-adaptive"}
#: Families whose steps vary.
VARYING = ("adaptive", "field")


@pytest.mark.parametrize("label", counts.ALL)
def test_every_evaluation_is_counted_once(counts_of, label):
    found = counts_of(label)
    assert len(found) > (label in stiff.METHODS)
    for name, told in found.items():
        assert told["gradient"] == told["called"] > 0, name


@pytest.mark.parametrize("label", counts.ALL)
def test_kernel_and_solution_report_the_same_counts(counts_of, label):
    """With variable steps the solution counts steps of length h, the kernel of a prepared run those that were taken."""
    own = {"steps"} if counts.ALL[label].family in VARYING else set()
    for name, told in counts_of(label).items():
        for key in set(counts.TOLD) - own:
            assert told["kernel"][key] == told[key], (name, key)


@pytest.mark.parametrize("label", counts.ALL)
def test_steps_are_counted_and_only_long_ones_need_newton(counts_of, label):
    """Methods of fixed steps count every step; Newton's method is used in the runs with long steps only."""
    for name, told in counts_of(label).items():
        assert told["steps"] == counts.STEPS or counts.ALL[label].family in VARYING, name
        assert (told["newton"] > 0) == (name in counts.LONG), name
        assert told["fallbacks"] == 0, name


@pytest.mark.parametrize("label", [x for x, m in counts.ALL.items() if m.family not in ("parametric", "projection")])
def test_iterations_are_evaluations_of_implicit_methods(counts_of, label):
    explicit = counts.ALL[label].family in EXPLICIT or label in EXPLICIT_ONES
    for name, told in counts_of(label).items():
        assert told["iterations"] == (0 if explicit else told["gradient"]), name


@pytest.mark.parametrize("base", ["rk4", "stormer-verlet", "implicit-midpoint"])
def test_a_projection_counts_iterations_like_its_base(base):
    for name in ("henon-heiles", "coupled"):
        system, q, p = SYSTEMS[name]()
        told = [integrate(system, m, h=counts.H, steps=3, q0=q, p0=p).counts for m in (base, projection_method(base))]
        assert told[1]["gradient"] > told[0]["gradient"]
        assert {bool(of["iterations"]) for of in told} == {told[0]["iterations"] > 0}


@pytest.mark.parametrize("id", ["stormer-verlet", "stormer-verlet-dkd", "symplectic-euler-p", "symplectic-euler-q"])
def test_symplectic_euler_iterates_only_if_not_separable(id):
    for name, explicit in (("henon-heiles", True), ("coupled", False)):
        system, q, p = SYSTEMS[name]()
        told = integrate(system, id, h=counts.H, steps=3, q0=q, p0=p).counts
        assert (told["iterations"] == 0) == explicit
        assert (told["gradient"] <= 4) == explicit
