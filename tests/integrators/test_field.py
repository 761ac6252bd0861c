"""The family "field", whose step size follows from the vector field: any H, order, walls, encounters, stored rows."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian
from phasebench.integrators.compile.codegen import DOUBLE, MULTIPRECISION, precision
from phasebench.integrators.driver import OK, TIMEOUT, integrate
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.families import field
from phasebench.integrators.prepared import lay_out
from phasebench.integrators.registry import METHODS
from phasebench.integrators.stepping.kernel import prepare
from support.solutions import end, energy_errors

BY_ID = {m.id: m for m in METHODS if m.family == "field"}
KEPLER = problem("kepler", e=0.8)
PERIOD = 2 * np.pi
#: A wall at q = 0; far from it the force is constant to all digits, so that nothing announces the wall.
WALL = Hamiltonian(q="q", p="p", H="p**2/2 + exp(-40*q) + q")


def lengths(system, id, h, q0, p0, every, rows=1):
    """(length of the next step, length of the last step, time, counts) after a run that stored some rows."""
    run = lay_out(prepare(BY_ID[id], system), system.d, h, q0, p0, DOUBLE)
    shape = (rows, system.d)
    assert run(np.zeros(shape), np.zeros(shape), np.zeros((rows, 1)), every)[1] == 0
    state = run.carry.state
    return state[5, 0], state[5, 1], state[4, 0], run.counts


def test_the_weights_for_derivatives_at_the_end_of_a_step():
    """For f = exp(c) on the nodes, f(1) and its derivatives at 1 are e up to the interpolation error.

    The last one, of order 7, is a constant of the polynomial of degree 7: nearly that of exp in the middle.
    """
    with precision(40):
        step = prepare(BY_ID["gauss-8-field"], KEPLER.system, MULTIPRECISION).step
        values = [mpmath.exp(mpmath.mpf(str(c))) for c in step.method.nodes[0][:8]]
        told = [mpmath.fsum(mpmath.mpf(str(w)) * f for w, f in zip(row, values, strict=False)) for row in step.ends]
    for k, (x, bound) in enumerate(zip(told[:4], (1e-8, 1e-6, 1e-5, 1e-3), strict=True)):
        assert abs(x - mpmath.e) < bound, k
    assert float(told[4]) == pytest.approx(np.exp(0.5), rel=0.01)
    assert len(told) == 5
    assert abs(told[3] - mpmath.e) > 1e-12, "the control: the weights are no rule for exp itself"


def test_steps_on_a_kepler_orbit_follow_the_distance():
    """About as r^(3/2): at the apocentre, 9 times as far as the pericentre, they are about 27 times as long."""
    steps = []
    for half in (0, 1):
        t, h = (0.999 + half * 0.5) * PERIOD, 0.002
        steps.append(lengths(KEPLER.system, "gauss-8-field", h, KEPLER.q0, KEPLER.p0, round(t / h))[0])
    assert 20 < steps[1] / steps[0] < 50


def test_steps_into_a_wall_are_rejected():
    """Starting at q = 3 the steps grow at the largest rate; steps into the wall are rejected and repeated."""
    fine, s = (
        end(integrate(WALL, "gauss-8-field", t_end=10.0, steps=n, q0=[3.0], p0=[0.0], save_every=0))
        for n in (4000, 100)
    )
    assert np.abs(fine - s).max() < 1e-6
    assert np.abs(WALL.energies(fine[:1, None], fine[1:, None]) - 3).max() < 1e-13
    fixed = integrate(WALL, "gauss-8", t_end=10.0, steps=100, q0=[3.0], p0=[0.0], save_every=0)
    assert fixed.status != "ok" or np.abs(end(fixed) - fine).max() > 1e-3, "the control"


@pytest.mark.parametrize("id", ["gauss-6-field", "gauss-8-field"])
def test_no_step_passes_through_a_wall_to_the_same_energy(id):
    """H is even in q, so that its value does not tell on which side of 1/q^2 a step ends; the sign of q does."""
    wall = Hamiltonian(q="q", p="p", H="p**2/2 + 1/q**2 + q**2/2")
    s = integrate(wall, id, h=1e-4, t_end=40, q0=[0.01], p0=[0.0], save_every=4000)
    assert (s.q > 0).all()
    assert np.abs(energy_errors(s)).max() < 1e-3 * wall.energies([[0.01]], [[0.0]])[0]


def test_the_growth_of_steps_is_bounded():
    run = lay_out(prepare(BY_ID["gauss-8-field"], WALL), 1, 0.01, [3.0], [0.0], DOUBLE)
    seen = []
    for _ in range(40):
        assert run(np.zeros((1, 1)), np.zeros((1, 1)), np.zeros((1, 1)), 1) == (1, 0)
        seen.append(run.carry.state[5, 0])
    ratios = np.array(seen[1:]) / seen[:-1]
    assert ratios.max() <= field.GROWTH * (1 + 1e-12)
    assert ratios.max() > 0.9 * field.GROWTH, "the field is constant: nothing else bounds a step"


def test_missing_traits_of_a_system_are_reported():
    beyond = Hamiltonian(q="x y", p="u v", H="u**2/2 + v**2/2 + (x**2 + y**2)**(1/3)")
    with pytest.raises(InvalidInput, match="elementary derivatives"):
        integrate(beyond, "gauss-8-field", h=0.1, steps=1, q0=[1, 0], p0=[0, 1])


@pytest.mark.parametrize(("name", "turned"), [("gauss-4-field", 1e-16), ("gauss-8-field", 1e-6)])
def test_a_coordinate_at_rest_does_not_shorten_steps(name, turned):
    """q' = 0 at p = 0 for H = exp(q) - q + exp(p) - p + ...; a tiny p must not make the steps shorter."""
    made = Hamiltonian(q="q", p="p", H="exp(q) - q + exp(p) - p + q**2*p**2/100")
    counts = [lengths(made, name, 0.5, [0.7], [p], 20)[3].steps for p in (0.0, turned)]
    assert abs(counts[0] - counts[1]) <= 1
    assert counts[1] < 100


def test_a_step_that_shrinks_to_zero_ends_the_run():
    """A fall into a centre that is not declared singular."""
    made = Hamiltonian(q="q", p="p", H="p**2/2 - 1/q", singular=())
    ended = integrate(made, "gauss-4-field", h=0.1, t_end=10.0, q0=[1.0], p0=[0.0], timeout=60)
    assert ended.status not in (OK, TIMEOUT)
