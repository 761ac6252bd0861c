"""Linker symbols of compiled functions depend on their content, so that functions of one name are not confused."""

from __future__ import annotations

import re

import pytest
from numba import types

from phasebench.integrators.compile import machine
from phasebench.integrators.values import vector
from phasebench.integrators.values.vector import TUPLES

NUMBER = types.float64(types.float64)


def times(k):
    """A function that multiplies by k."""

    def f(x):
        return k * x

    return f


def symbol(k, name):
    """Linker symbol of a compiled function without Numba's running number."""
    made = machine.load_or_compile(times(k), NUMBER, TUPLES, name)
    return re.sub(r"B\dv\d+", "", next(iter(made.overloads.values())).fndesc.mangled_name)


def test_functions_with_different_content_have_other_symbols():
    assert symbol(2.0, "times|2") != symbol(3.0, "times|3")
    assert symbol(2.0, "times|2") == symbol(2.0, "times|2"), "the control"


def part(k):
    """The qualified name of a compiled part of a kernel that multiplies by the constant k."""
    return vector.jit(times(k)).py_func.__qualname__


def test_parts_with_different_content_have_other_names():
    assert part(2.0) != part(3.0)
    assert part(2.0) == part(2.0), "the control"


def test_a_function_has_only_its_declared_signature():
    """Passed on with another signature it is refused instead of being called wrongly."""
    made = machine.load_or_compile(times(2.0), NUMBER, TUPLES, "times|2")
    assert made.nopython_signatures == [NUMBER]
    with pytest.raises(TypeError, match="No matching definition"):
        made(1.0 + 1j)


def test_closures_can_be_compiled():
    def outer(x):
        def inner(y):
            return y + x

        return inner(2.0 * x)

    assert machine.load_or_compile(outer, NUMBER, TUPLES, "outer|inner")(1.5) == 4.5
