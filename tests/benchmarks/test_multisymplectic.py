"""Box schemes: tableaus, and local conservation laws that hold or converge as declared."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp

from phasebench.benchmarks.measure import box_laws as laws
from phasebench.benchmarks.problems import klein_gordon, nls
from phasebench.benchmarks.studies import multisymplectic
from phasebench.integrators import Hamiltonian, integrate
from phasebench.integrators.families.multisymplectic import run, scheme, schemes

MODULES = {"nls": nls, "klein-gordon": klein_gordon}
N, FEW, LENGTH = 5, 3, 2 * np.pi


@pytest.fixture(params=MODULES)
def name(request):
    return request.param


def case(name, cells=N, strength=1.0):
    """(equation, initial values y, tangent vectors, grid spacing dx) of a wave equation on ``cells`` grid cells."""
    dx = LENGTH / cells
    y, *tangents = multisymplectic.CASES[name].data(dx * np.arange(cells))
    return MODULES[name].multisymplectic(strength), y, tangents, dx


# -- equations and space discretizations -------------------------------------------------------------------------------


@pytest.mark.parametrize("id", schemes())
def test_equation_holds_at_the_stages(name, id):
    """K T + L z_x = grad S(Z) in all components, including those without a time derivative."""
    equation, y, _, dx = case(name)
    chosen = scheme(id)
    space = chosen.division(equation, N, dx)
    k = equation.slopes
    (step,) = run(equation, chosen, y, dx, 0.02, 1)
    for Y, T in zip(step.Y, step.T, strict=True):
        z, rate = space.lift(Y), space.lift(T)
        z_x = np.concatenate([space.slope(z[:, :-k]), space.back(z[:, -k:])], axis=1)
        rest = rate @ equation.K.T + z_x @ equation.L.T - equation.gradient(z)
        assert np.abs(rest).max() < 1e-12


# -- the schemes -------------------------------------------------------------------------------------------------------


def canonical_system(space) -> Hamiltonian:
    """The nonlinear Schroedinger equation on the grid of ``space`` as a canonical Hamiltonian system."""
    D = sp.Matrix(space.slope(np.eye(space.N)))
    q, p = (sp.symbols([f"{x}{j}" for j in range(space.N)], real=True) for x in "qp")
    bending = sum(((D * sp.Matrix(x)).T * (D * sp.Matrix(x)))[0] for x in (q, p)) / 2
    return Hamiltonian(q=q, p=p, H=bending - sum((x**2 + y**2) ** 2 / 2 for x, y in zip(q, p, strict=True)))


@pytest.mark.parametrize(
    ("id", "method"),
    [("euler-box", "symplectic-euler-p"), ("preissmann-box", "implicit-midpoint")],
)
def test_box_scheme_is_a_method_in_time(id, method):
    """A box scheme equals a method of the package on the equation discretized in space; control: half the step.

    Both share no code.
    """
    equation, y, _, dx = case("nls", FEW)
    chosen = scheme(id)
    system = canonical_system(chosen.division(equation, FEW, dx))
    *_, step = run(equation, chosen, y, dx, 0.05, 4)
    ends = [integrate(system, method, h=h, t_end=0.2, q0=y[:, 0], p0=y[:, 1], save_every=0) for h in (0.05, 0.025)]
    same, other = (np.abs(np.hstack([s.q[-1], s.p[-1]]) - step.end.T.ravel()).max() for s in ends)
    assert same < 1e-12
    assert other > 1e-7


# -- the laws ----------------------------------------------------------------------------------------------------------


def units(name, chosen, law, h=0.01, strength=1.0):
    """The residual of a law in three steps of a box scheme, in units of the round-off expected of it."""
    equation, y, tangents, dx = case(name, 9, strength)
    steps = run(equation, chosen, y, dx, h, 3, tangents)
    row = laws.measure(chosen.division(equation, 9, dx), chosen, steps, h, multisymplectic.CASES[name].invariant)
    return row[law] / row[f"{law}, round-off"]


@pytest.mark.parametrize("id", schemes())
def test_multisymplectic_law_holds_as_declared(name, id):
    chosen = scheme(id)
    found = units(name, chosen, laws.TWO_FORM, h=0.004)
    assert found < multisymplectic.UNITS if chosen.multisymplectic else found > 1e3
    if id == "gauss-box":
        off = replace(chosen, A_q=chosen.A_q + 1e-6)
        assert units(name, off, laws.TWO_FORM, h=0.004) > 1e3, "the control: a perturbed coefficient"


@pytest.mark.parametrize("law", [laws.ENERGY, laws.MOMENTUM])
def test_laws_of_energy_and_momentum(name, law):
    """Both are quadratic in the linear equation; with S of degree four only the energy is kept, by the AVF box."""
    box, avf = scheme("preissmann-box"), scheme("avf-box")
    assert units(name, box, law, strength=0.0) < multisymplectic.UNITS
    assert units(name, box, law) > 1e3
    if law == laws.ENERGY:
        assert units(name, avf, law) < multisymplectic.UNITS
        assert units(name, replace(avf, means=False), law) > 1e3
