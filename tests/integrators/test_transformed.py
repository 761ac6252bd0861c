"""Poincare's time transformation of a Hamiltonian: same orbits, variable steps in time, symplectic methods."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest

from phasebench.benchmarks.measure.step_map import jacobian, symplecticity_defect
from phasebench.benchmarks.problems import problem
from phasebench.integrators.compile.codegen import MULTIPRECISION, precision, vector
from phasebench.integrators.driver import integrate
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.systems.transformed import TransformedHamiltonian, distance_scale
from support.solutions import last

ORBIT = problem("kepler", e=0.9)
SYSTEM = TransformedHamiltonian(ORBIT.system)
Q0, P0 = SYSTEM.start(ORBIT.q0, ORBIT.p0)
METHODS = ("implicit-midpoint", "rk4")


def test_the_field_is_the_scaled_original_field():
    r = np.linalg.norm(ORBIT.q0)
    new, old = SYSTEM.vector_field()(0, np.append(Q0, P0)), ORBIT.system.vector_field()(0, [*ORBIT.q0, *ORBIT.p0])
    assert np.allclose(new, r**1.5 * np.array([old[0], old[1], 1, old[2], old[3], 0]), rtol=1e-12, atol=1e-12)
    doubled = TransformedHamiltonian(ORBIT.system, scale=f"2*{ORBIT.system.q[0]}")
    assert np.isclose(doubled.vector_field()(0, np.append(Q0, P0))[2], 2 * ORBIT.q0[0])


def kepler_error(s):
    """Distance of the last row from Kepler's orbit at the time of that row."""
    e, t = 0.9, s.q[-1, 2]
    E = t
    for _ in range(100):
        E -= (E - e * np.sin(E) - t) / (1 - e * np.cos(E))
    return np.abs(s.q[-1, :2] - [np.cos(E) - e, np.sqrt(1 - e**2) * np.sin(E)]).max()


def test_a_symplectic_method_follows_the_orbit():
    errors = [kepler_error(integrate(SYSTEM, "implicit-midpoint", h=h, t_end=6.0, q0=Q0, p0=P0)) for h in (0.02, 0.01)]
    assert errors[1] < 2e-3
    assert 3.5 < errors[0] / errors[1] < 4.5
    s = integrate(SYSTEM, "implicit-midpoint", h=0.05, steps=4000, q0=Q0, p0=P0)
    fixed = integrate(ORBIT, "implicit-midpoint", t_end=s.q[-1, 2], steps=40_000)
    transformed, plain = (
        np.abs(ORBIT.system.observe(ORBIT.system.H, x.q[:, :2], x.p[:, :2]) + 0.5).max() for x in (s, fixed)
    )
    assert s.status == fixed.status == "ok"
    assert transformed < 0.05
    assert plain > transformed, "with ten times as many steps"


def measured_defects():
    with precision(40):
        y = vector([*Q0, *P0])
        d = SYSTEM.d

        def step(method):
            def advance(x):
                return last(integrate(SYSTEM, method, h=0.1, steps=1, q0=x[:d], p0=x[d:], arithmetic=MULTIPRECISION))

            return advance

        return {m: float(symplecticity_defect(jacobian(step(m), y, vector(["1e-8"])[0]))) for m in METHODS}


def test_a_step_is_symplectic_in_extended_phase_space(uncompiled):
    defects = uncompiled("integrators/test_transformed.py")
    assert defects["implicit-midpoint"] < 1e-25
    assert defects["rk4"] > 1e-12, "the control"


def test_systems_without_distances_are_refused():
    with pytest.raises(InvalidInput, match="no distances"):
        TransformedHamiltonian(problem("henon-heiles").system)
    with pytest.raises(InvalidInput, match="no distances"):
        distance_scale(
            SimpleNamespace(singular=(ORBIT.system.q[0], np.hypot), softened=())
        )  # one of them is not a formula
    with pytest.raises(InvalidInput, match="coordinates alone"):
        TransformedHamiltonian(ORBIT.system, scale=f"1 + {ORBIT.system.p[0]}**2")
    with pytest.raises(InvalidInput, match="canonical"):
        TransformedHamiltonian(problem("lotka-volterra").system, scale=1)


if __name__ == "__main__":
    print(json.dumps({"result": measured_defects()}))
