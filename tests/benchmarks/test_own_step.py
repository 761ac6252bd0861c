"""A step of the user's own: what it may return, what is refused, and the map of states that ``validate`` runs."""

from __future__ import annotations

import pickle

import gmpy2
import numpy as np
import pytest

from phasebench.benchmarks.certificate.battery import Entry
from phasebench.benchmarks.certificate.stepping import StepFailed, Stepper
from phasebench.benchmarks.certificate.subject import subject
from phasebench.benchmarks.measure import own_step
from phasebench.benchmarks.problems import problem
from phasebench.integrators.compile.codegen import DOUBLE, MULTIPRECISION, precision
from phasebench.integrators.errors import InvalidInput
from support.steps import leapfrog

HENON = problem("henon-heiles:box")
HERE = Entry("here", problem("harmonic-oscillator").system, (1.0, 0.0))


def ran(step, **more):
    """The solution of five steps of the user's function on the Henon-Heiles problem."""
    return own_step.integrate_step(HENON, own_step.from_function(step), h=0.1, steps=5, **more)


@pytest.mark.parametrize("made", [tuple, np.array])
def test_step_may_return_any_pair_of_arrays(made):
    found = ran(lambda system, q, p, h: made([q + 1, p]))
    assert np.array_equal(found.q[-1], np.add(HENON.q0, 5))
    assert len(found.t) == 6


# -- a step as a map of states ----------------------------------------------------------------------------------------


def stepper(step, arithmetic=DOUBLE):
    return Stepper(subject(step, {}, ("separable",)), HERE, arithmetic)


@pytest.mark.parametrize("arithmetic", [DOUBLE, MULTIPRECISION])
def test_evaluations_and_type_of_the_states(arithmetic):
    with precision(40):
        made = stepper(leapfrog, arithmetic)
        rows = made.run(HERE.state, 0.5, 2)
        assert list(made.system.evaluations) == [4, 2]
        assert (made.taken, len(rows)) == (2, 3), "every state, and the first"
        assert rows[1].astype(float).tolist() == [0.875, -0.46875], "by hand"
        assert len(made.run(HERE.state, 0.5, 5, every=2)) == 3
        kind = float if arithmetic == DOUBLE else gmpy2.mpfr
        assert {*map(type, rows[1].tolist()), *map(type, made.state([1.0]).tolist())} == {kind}


def test_doubles_from_a_multiprecision_step_are_refused():
    with precision(40):
        made = stepper(lambda system, q, p, h: (q, [0.5]), MULTIPRECISION)
        with pytest.raises(StepFailed, match="it returned float, mpfr where it was given numbers of many digits"):
            made(made.state(HERE.state), 0.1)


def test_run_ends_at_a_nonfinite_number():
    made = stepper(lambda system, q, p, h: (q * 0 + (np.inf if made.taken == 3 else 1.0), p))
    assert len(made.run(HERE.state, 0.1, 9)) == 3


def test_exception_names_the_step_and_its_first_line():
    def raising(system, q, p, h):
        if made.taken == 3:
            raise ValueError("one\ntwo")
        return q, p

    made = stepper(raising)
    with pytest.raises(StepFailed, match=r"^step 3 on here: .*ValueError: one$"):
        made.run(HERE.state, 0.1, 9)


def test_arguments_in_another_order_are_refused():
    for step in (lambda q, p, h, system: (q, p), lambda system, p, q, h: (q, p)):
        with pytest.raises(InvalidInput, match=r"called \(system, q, p, h\)"):
            own_step.from_function(step)
    for step in (lambda system, q, p, dt: (q, p), lambda system, x, v, h: (x, v)):
        assert own_step.from_function(step).step is step


def test_step_of_a_file_travels_by_its_path_and_asks_for_a_canonical_system(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text("def step(system, q, p, h):\n    return q, p\n")
    made = own_step.from_file(file)
    file.write_text("def step(system, q, p, h):\n    return q + h, p\n")
    assert pickle.loads(pickle.dumps(made)).step(None, 0.0, 0.0, 1.0) == (1.0, 0.0), "the receiver reads the file"
    assert made.lacks(HENON.system) is None
    assert "canonical" in made.lacks(problem("lotka-volterra").system)
