"""The family in the contract's docstring runs on every kind of number as the built-in method that it is."""

from __future__ import annotations

import inspect
import json
import sys
import textwrap
from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest

import phasebench as pb
from phasebench.integrators.compile import codegen
from phasebench.integrators.driver import integrate
from phasebench.integrators.stepping import kernel, loop, solve
from phasebench.integrators.values import vector
from support.kinds import lanes_and_one_apart
from support.marks import compiled
from support.solutions import apart, end
from support.systems import chain


def example() -> str:
    """The example code in the docstring of `kernel`, the contract of a family."""
    lines = inspect.getdoc(kernel).partition("would be::\n")[2].splitlines()
    end = next(i for i, line in enumerate(lines) if line.startswith("1. "))
    return textwrap.dedent("\n".join(lines[:end]))


@pytest.fixture
def pair(monkeypatch):
    return pair_of(monkeypatch)


def pair_of(patch) -> tuple:
    """(a method of the family in the docstring, the built-in method that it must equal).

    The family's module is removed with the patch.
    """
    twin, module = pb.method("implicit-midpoint"), ModuleType("phasebench.integrators.families.midpoint_example")
    for source in (vector, solve, kernel, loop):
        vars(module).update({k: v for k, v in vars(source).items() if not k.startswith("__")})
    patch.setitem(sys.modules, module.__name__, module)
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


def test_runs_in_many_digits_as_the_registered_method(uncompiled):
    assert uncompiled("integrators/test_family_contract.py") < 1e-36


@compiled
def test_orbits_in_lanes_end_as_one_alone(pair):
    assert lanes_and_one_apart(pb.Hamiltonian(**SMALL), pair[0], [0.5, 0.2], [0.1, 0.4], 0.02) < 1e-13


if __name__ == "__main__":
    start = {"q0": [0.5, 0.2], "p0": [0.1, 0.4], "arithmetic": codegen.MULTIPRECISION}
    with codegen.precision(40), pytest.MonkeyPatch.context() as patch:
        system = pb.Hamiltonian(**SMALL)
        ends = [end(integrate(system, m, h=0.05, steps=5, **start)) for m in pair_of(patch)]
        print(json.dumps({"result": float(apart(*ends))}))
