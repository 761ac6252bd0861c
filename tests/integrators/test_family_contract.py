"""The family in the contract's docstring runs on tuples and arrays as the built-in method that it is."""

from __future__ import annotations

import inspect
import sys
import textwrap
from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest

import phasebench as pb
from phasebench.integrators.compile import codegen
from phasebench.integrators.stepping import kernel, loop, solve
from phasebench.integrators.values import vector
from support.marks import compiled
from support.solutions import end
from support.systems import chain


def example() -> str:
    """The example code in the docstring of `kernel`, the contract of a family."""
    lines = inspect.getdoc(kernel).partition("would be::\n")[2].splitlines()
    end = next(i for i, line in enumerate(lines) if line.startswith("1. "))
    return textwrap.dedent("\n".join(lines[:end]))


@pytest.fixture
def pair(monkeypatch) -> tuple:
    """(a method of the family in the docstring, the built-in method that it must equal)."""
    twin, module = pb.method("implicit-midpoint"), ModuleType("phasebench.integrators.families.midpoint_example")
    for source in (vector, solve, kernel, loop):
        vars(module).update({k: v for k, v in vars(source).items() if not k.startswith("__")})
    monkeypatch.setitem(sys.modules, module.__name__, module)
    exec(compile(example(), "<example>", "exec"), vars(module))
    return replace(twin, id="midpoint-example", family="midpoint_example"), twin


SMALL = {"q": ["x", "y"], "p": ["u", "v"], "H": "(u**2 + v**2)/2*(1 + x**2/4) + x**4/4 + y**2/2 + x*v/5"}


def test_runs_on_tuples_as_the_registered_method(pair):
    twin = pair[1]
    system = pb.Hamiltonian(**SMALL)
    ends = [end(pb.integrate(system, m, h=0.05, steps=40, q0=[0.5, 0.2], p0=[0.1, 0.4])) for m in pair]
    assert np.abs(ends[0] - ends[1]).max() < 1e-14
    other = end(pb.integrate(system, twin, h=0.05, steps=41, q0=[0.5, 0.2], p0=[0.1, 0.4]))
    assert np.abs(ends[0] - other).max() > 1e-3  # the comparison can fail


@compiled
def test_runs_on_arrays_as_the_registered_method(pair):
    system, n = chain(codegen.TUPLE_LIMIT + 2), codegen.TUPLE_LIMIT + 2
    q0, p0 = np.sin(np.arange(n)), np.zeros(n)
    ends = [end(pb.integrate(system, m, h=0.02, steps=20, q0=q0, p0=p0)) for m in pair]
    assert np.abs(ends[0] - ends[1]).max() < 1e-13
