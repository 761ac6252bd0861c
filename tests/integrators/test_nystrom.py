"""Special kernels, chosen for separable H or quadratic T, reach the same states as the general one."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from phasebench.benchmarks.measure.battery import variants
from phasebench.benchmarks.problems import problem
from phasebench.integrators.driver import integrate
from phasebench.integrators.families import parametric, splitting
from phasebench.integrators.registry import method
from phasebench.integrators.stepping import kernel as kernels
from phasebench.integrators.systems.hamiltonian import Hamiltonian
from support.one_of_each import kinds

ROUND_OFF = 2e-13
ONE_STAGE = kinds(
    [method("scheme-i", lam="1/3"), *(m for m in variants() if m.family == "parametric" and m.data[0] == 1)]
)


class General(Hamiltonian):
    """A Hamiltonian that reports no structure, which forces the general kernel."""

    separable = False
    quadratic_kinetic = False


def full_mass():
    """A system with a mass matrix that is not diagonal."""
    return Hamiltonian(q="q1 q2", p="p1 p2", H="p1**2 + p1*p2 + p2**2 + cos(q1)/3 + q1**2*q2**2/2 + q2**2/2")


SYSTEMS = {
    "pendulum": lambda: problem("pendulum").system,
    "henon-heiles": lambda: problem("henon-heiles").system,
    "perturbed-kepler": lambda: problem("perturbed-kepler").system,
    "full mass matrix": full_mass,
}
STARTS = {
    "pendulum": ([1.3], [0.4]),
    "henon-heiles": ([0.1, 0.3], [0.2, -0.1]),
    "perturbed-kepler": ([0.8, 0.3], [-0.2, 0.9]),
    "full mass matrix": ([0.5, -0.3], [0.2, 0.4]),
}


def run(system, method, name, steps=40):
    """All states (q, p) of a run, array (rows, 2 d); fail if its status is not "ok"."""
    q, p = STARTS[name]
    s = integrate(system, method, h=0.02, steps=steps, q0=q, p0=p)
    assert s.status == "ok"
    return np.hstack([s.q, s.p])


@pytest.mark.parametrize("name", SYSTEMS)
@pytest.mark.parametrize("label", ONE_STAGE)
def test_the_special_kernel_equals_the_general_one(label, name):
    m, system = ONE_STAGE[label], SYSTEMS[name]()
    general = General(q=system.q, p=system.p, H=system.H, singular=system.singular)
    special, forced = kernels.prepare(m, system), kernels.prepare(m, general)
    assert forced.run is parametric.run
    assert forced.step.field is not None
    assert special.run is splitting.run or special.step.field is None, "the special form was not chosen"
    assert np.abs(run(system, m, name) - run(general, m, name)).max() < ROUND_OFF


def test_control_another_lambda_differs():
    system = SYSTEMS["henon-heiles"]()
    general = General(q=system.q, p=system.p, H=system.H)
    m = ONE_STAGE["scheme-i(lam=1/3)"]
    assert (
        np.abs(
            run(system, m, "henon-heiles") - run(general, m(lam=Fraction(1, 3) + Fraction(1, 1000)), "henon-heiles")
        ).max()
        > 1e-7
    )


@pytest.mark.parametrize(("lam", "kicks_first"), [(1, True), (0, False)])
def test_scheme_i_at_0_and_1_is_symplectic_euler(lam, kicks_first):
    m, system = ONE_STAGE["scheme-i(lam=1/3)"](lam=lam), SYSTEMS["pendulum"]()
    assert kernels.prepare(m, system).run is splitting.run
    (q,), (p,) = STARTS["pendulum"]
    h = 0.02
    for _ in range(40):
        if kicks_first:
            p = p - h * np.sin(q)
            q = q + h * p
        else:
            q = q + h * p
            p = p - h * np.sin(q)
    assert np.abs(run(system, m, "pendulum")[-1] - [q, p]).max() < ROUND_OFF


def test_the_mass_matrix_is_used():
    """Doubling the off-diagonal term of T changes the result; a kernel that dropped the term would not show it."""
    system = full_mass()
    other = Hamiltonian(q=system.q, p=system.p, H=system.H + system.p[0] * system.p[1])
    m = ONE_STAGE["scheme-i(lam=1/3)"]
    assert kernels.prepare(m, other).step.field is None
    assert np.abs(run(system, m, "full mass matrix") - run(other, m, "full mass matrix")).max() > 1e-3


def test_a_linear_term_in_t_is_not_quadratic():
    system = Hamiltonian(q="q", p="p", H="p**2/2 + p - cos(q)")
    assert system.separable
    assert not system.quadratic_kinetic
    assert kernels.prepare(ONE_STAGE["scheme-i(lam=1/3)"], system).step.field is not None


@pytest.mark.parametrize("kind", [Hamiltonian, General])
def test_extrapolated_starts_save_iterations(kind):
    """Forty steps in one run take fewer iterations than forty runs of one step, which start from zero."""
    made, m, h = SYSTEMS["henon-heiles"](), ONE_STAGE["scheme-i(lam=1/3)"], 0.005
    system = kind(q=made.q, p=made.p, H=made.H)
    y = STARTS["henon-heiles"]
    whole = integrate(system, m, h=h, steps=40, q0=y[0], p0=y[1])
    anew = 0
    for _ in range(40):
        step = integrate(system, m, h=h, steps=1, q0=y[0], p0=y[1])
        y, anew = (step.q[-1], step.p[-1]), anew + step.counts["iterations"]
    assert np.abs(np.concatenate(y) - [*whole.q[-1], *whole.p[-1]]).max() < ROUND_OFF
    assert whole.counts["iterations"] < 0.6 * anew


def weights(lam, rounded=False):
    """Sums of the two weights in each substep of Scheme III, as exact fractions of the doubles.

    The weights are those prepared, or (``rounded``) 1 - lambda and lambda rounded independently.
    """
    step = kernels.prepare(method("scheme-iii", lam=lam), SYSTEMS["henon-heiles"]()).step
    pairs = zip(step.mu, step.lam, strict=True) if not rounded else [(float(1 - lam), float(lam))]
    return {Fraction(float(mu)) + Fraction(float(weight)) for mu, weight in pairs}


def test_weights_of_symplectic_substeps_add_up_to_one():
    """Otherwise the map would be symplectic to round-off only."""
    several = [Fraction(k, n) for n in (3, 7, 11, 1000) for k in (-5, -1, 1, 2, 9)]
    assert {total for lam in several for total in weights(lam)} == {1}
    assert {total for lam in several for total in weights(lam, rounded=True)} > {1}, "the control"


def test_the_scale_of_a_kick():
    """The sum of the sizes of p, of the kick and of the right-hand side, so that it is not zero if one of them is."""
    for k in range(3):
        p, x, g = ((0.3 * (i == k), -2.0 * (i == k)) for i in range(3))
        of_q, of_p = parametric.lengths_of_kick(x, g, parametric.Stage(None, None, p, p, 0.1, 0.5, 0.5))
        assert of_q == of_p == pytest.approx(2.3)
