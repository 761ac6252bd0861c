"""Invariants given as text are formulae of the problem's variables."""

from __future__ import annotations

import numpy as np
import pytest

import phasebench as pb

SYSTEM = pb.Hamiltonian(q="x y", p="u v", H="(u**2 + v**2)/2 + (x**2 + y**2)/2")


def problem(L) -> pb.Problem:
    orbit = pb.Orbit("circle", (1.0, 0.0), (0.0, 1.0))
    return pb.Problem(id="mine", name="mine", source="", system=SYSTEM, orbits=(orbit,), invariants={"L": L})


def test_text_is_read_as_a_formula():
    found = pb.integrate(problem("x*v - y*u"), "stormer-verlet", h=0.1, t_end=1.0).invariants()
    assert np.abs(found["L"] - 1.0).max() < 1e-14


@pytest.mark.parametrize("text", ["x*w - y*u", "x*v -", "__import__('os')"])
def test_text_that_is_no_formula_is_refused_when_the_problem_is_made(text):
    with pytest.raises(pb.InvalidInput, match="the invariant 'L': the formula"):
        problem(text)
