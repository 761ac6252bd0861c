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
    """The energy of one direction, which the flow keeps and the method does not."""
    s = pb.integrate(problem("(x**2 + u**2)/2"), "stormer-verlet", h=0.1, t_end=1.0)
    found = s.invariants()["L"]
    np.testing.assert_allclose(found, (s.q[:, 0] ** 2 + s.p[:, 0] ** 2) / 2, rtol=1e-14)
    assert np.ptp(found) > 1e-5


@pytest.mark.parametrize("text", ["x*w - y*u", "x*v -", "__import__('os')"])
def test_text_that_is_no_formula_is_refused_when_the_problem_is_made(text):
    with pytest.raises(pb.InvalidInput, match="the invariant 'L': the formula"):
        problem(text)
