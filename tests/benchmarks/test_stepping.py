"""`Stepper`, a step as a map of states, in doubles and in multiprecision, and its errors."""

from __future__ import annotations

import gmpy2
import numpy as np
import pytest

from phasebench.benchmarks.certificate.battery import Entry
from phasebench.benchmarks.certificate.stepping import StepFailed, Stepper
from phasebench.benchmarks.certificate.subject import subject
from phasebench.benchmarks.problems import problem
from phasebench.integrators.compile.codegen import DOUBLE, MULTIPRECISION, precision
from support.steps import leapfrog

HERE = Entry("here", problem("harmonic-oscillator").system, (1.0, 0.0))


def stepper(step, arithmetic=DOUBLE):
    return Stepper(subject(step, {}, ("separable",)), HERE, arithmetic)


@pytest.fixture(params=[DOUBLE, MULTIPRECISION])
def arithmetic(request):
    with precision(40):
        yield request.param


def test_evaluations_and_type_of_the_states(arithmetic):
    made = stepper(leapfrog, arithmetic)
    assert list(made.system.evaluations) == [0, 0]
    rows = made.run(HERE.state, 0.5, 2)
    assert list(made.system.evaluations) == [4, 2]
    assert (made.taken, len(rows)) == (2, 3), "every state, and the first"
    assert rows[1].astype(float).tolist() == [0.875, -0.46875], "by hand"
    assert len(made.run(HERE.state, 0.5, 5, every=2)) == 3
    kind = float if arithmetic == DOUBLE else gmpy2.mpfr
    assert {*map(type, made.state([1.0, 0.0]).tolist())} == {kind}
    assert rows.dtype == made.state([1.0]).dtype == made.dtype


def test_energy_and_gradients_in_multiprecision():
    with precision(40):
        made = stepper(leapfrog, MULTIPRECISION)
        q, p = made.state(["0.1"]), made.state(["0.3"])
        assert abs(made.system.H(q, p) - made.number("0.05")) < 1e-38
        assert made.system.dH_dq(q, p) == q
        assert made.system.dH_dp(q, p) == p
        assert made.system.dH_dq(p, q) == p, "of another state"


def test_doubles_from_a_multiprecision_step_are_refused():
    with precision(40):
        made = stepper(lambda system, q, p, h: (q, [0.5]), MULTIPRECISION)
        with pytest.raises(StepFailed, match="it returned float, mpfr where it was given numbers of many digits"):
            made(made.state(HERE.state), 0.1)


def test_run_ends_at_a_nonfinite_number():
    made = stepper(lambda system, q, p, h: (q * 0 + (np.inf if made.taken == 3 else 1.0), p))
    assert len(made.run(HERE.state, 0.1, 9)) == 3


@pytest.mark.parametrize(("text", "told"), [("one\ntwo", "ValueError: one"), ("", "ValueError: ")])
def test_exception_names_the_step_and_its_first_line(text, told):
    def raising(system, q, p, h):
        if made.taken == 3:
            raise ValueError(text)
        return q, p

    made = stepper(raising)
    with pytest.raises(StepFailed) as caught:
        made.run(HERE.state, 0.1, 9)
    assert str(caught.value).startswith("step 3 on here: ")
    assert str(caught.value).endswith(told)
