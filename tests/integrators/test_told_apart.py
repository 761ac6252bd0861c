"""Machine code of functions of one name: which of them is called must not depend on what processes compiled before."""

from __future__ import annotations

import re

import pytest
from numba import errors, types

from phasebench.integrators.engine import machine
from phasebench.integrators.engine.vector import TUPLES

NUMBER = types.float64(types.float64)


def times(k):
    def f(x):
        return k * x

    return f


def symbol(k, name):
    """What the linker knows the function by, without the number that counts what the process has compiled."""
    made = machine.compiled(times(k), NUMBER, TUPLES, name)
    return re.sub(r"B\dv\d+", "", next(iter(made.overloads.values())).fndesc.mangled_name)


def test_functions_of_one_line_and_of_other_content_have_other_symbols():
    assert symbol(2.0, "times|2") != symbol(3.0, "times|3")
    assert symbol(2.0, "times|2") == symbol(2.0, "times|2"), "the control"


def test_a_function_of_one_signature_has_no_other():
    """Where it is handed on as of another it is refused, and not called with what it does not take."""
    made = machine.compiled(times(2.0), NUMBER, TUPLES, "times|2")
    assert made.get_compile_result(NUMBER) is next(iter(made.overloads.values()))
    with pytest.raises(errors.TypingError, match="not available"):
        made.get_compile_result(types.float64(types.float64, types.float64))


def test_a_function_may_have_functions_inside_that_know_its_variables():
    def outer(x):
        def inner(y):
            return y + x

        return inner(2.0 * x)

    assert machine.compiled(outer, NUMBER, TUPLES, "outer|inner")(1.5) == 4.5
