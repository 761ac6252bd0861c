"""A family written from the contract's docstring alone, and an explicit one, run on every kind of number."""

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

#: The trapezoidal rule with the end foreseen by Euler's step (Heun).
EXPLICIT = """
class Heun(NamedTuple):
    field: Callable
    h: float = 0.0
    eps: float = 0.0

def step(method, y, orbit, counts):
    first_q, first_p = method.field(y.q, y.p, method.h, 0.0)
    q, p = axpy(method.h, first_q, y.q), axpy(method.h, first_p, y.p)
    last_q, last_p = method.field(q, p, method.h, 0.0)
    counts.gradient += 2
    half = 0.5 * method.h
    return update(y, scale(half, plus(first_q, last_q)), scale(half, plus(first_p, last_p))), SOLVED

run = loop(step)
IN_LANES = True

def prepare(method, system, arithmetic):
    return Prepared(run, Heun(system.field(arithmetic)), width=1, stages=1, implicit=False)
"""


def example() -> str:
    """The example code in the docstring of `kernel`, the contract of a family."""
    lines = inspect.getdoc(kernel).partition("would be::\n")[2].splitlines()
    end = next(i for i, line in enumerate(lines) if line.startswith("1. "))
    return textwrap.dedent("\n".join(lines[:end]))


#: Name -> (the text of a family, the registered or tabulated method that it is).
FAMILIES = {
    "midpoint_example": (example(), pb.method("implicit-midpoint")),
    "heun_example": (EXPLICIT, replace(pb.method("rk4"), id="heun", order=2, data=((0, 0), (1, 0), (0.5, 0.5)))),
}


def pair_of(name: str, patch) -> tuple:
    """(a method of the family written in this test, the built-in method that it must equal).

    The family's module is removed with the patch.
    """
    text, twin = FAMILIES[name]
    module = ModuleType(f"phasebench.integrators.families.{name}")
    for source in (vector, solve, kernel, loop):
        vars(module).update({k: v for k, v in vars(source).items() if not k.startswith("__")})
    patch.setitem(sys.modules, module.__name__, module)
    exec(compile(text, f"<{name}>", "exec"), vars(module))
    return replace(twin, id=name.replace("_", "-"), family=name), twin


@pytest.fixture(params=FAMILIES)
def pair(request, monkeypatch):
    return pair_of(request.param, monkeypatch)


def chain(n: int) -> pb.Hamiltonian:
    """A ring of n bodies with quartic springs, started in a wave."""
    q, p = [f"q{i}" for i in range(n)], [f"p{i}" for i in range(n)]
    springs = " + ".join(f"(q{i} - q{(i + 1) % n})**2/2 + (q{i} - q{(i + 1) % n})**4/4" for i in range(n))
    return pb.Hamiltonian(q=q, p=p, H=" + ".join(f"{x}**2/2" for x in p) + " + " + springs)


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
    differences = uncompiled("integrators/test_family_contract.py")
    assert set(differences) == set(FAMILIES)
    assert max(differences.values()) < 1e-36


@compiled
def test_orbits_in_lanes_end_as_one_alone(pair):
    assert lanes_and_one_apart(pb.Hamiltonian(**SMALL), pair[0], [0.5, 0.2], [0.1, 0.4], 0.02) < 1e-13


def differences_in_many_digits() -> dict[str, float]:
    """{family: distance between the end states of its method and of the built-in one} after 5 steps with 40 digits."""
    system, found = pb.Hamiltonian(**SMALL), {}
    start = {"q0": [0.5, 0.2], "p0": [0.1, 0.4], "arithmetic": codegen.MULTIPRECISION}
    with codegen.precision(40), pytest.MonkeyPatch.context() as patch:
        for name in FAMILIES:
            ends = [end(integrate(system, m, h=0.05, steps=5, **start)) for m in pair_of(name, patch)]
            found[name] = float(apart(*ends))
    return found


if __name__ == "__main__":
    print(json.dumps({"result": differences_in_many_digits()}))
