"""Splittings and their special kernels: diagonal masses, quadratic T, processors, modified kicks."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from phasebench.benchmarks.measure.battery import variants
from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian
from phasebench.integrators.coefficients import BY_NAME, GROUPS
from phasebench.integrators.compile import codegen
from phasebench.integrators.driver import integrate
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.families import parametric, splitting
from phasebench.integrators.records import processed
from phasebench.integrators.registry import METHODS, method
from phasebench.integrators.stepping import kernel
from support.one_of_each import kinds
from support.solutions import last
from support.systems import chain, of_masses

# -- diagonal masses: the drift multiplies by numbers, with the same bits as with the function grad T -----------------


def end(system):
    q, p = np.linspace(0.3, 0.7, system.d), np.linspace(-0.2, 0.4, system.d)
    return last(integrate(system, "stormer-verlet", q0=q, p0=p, h=0.01, steps=200))


@pytest.mark.processor
@pytest.mark.parametrize("d", [2, codegen.TUPLE_LIMIT + 1])
def test_masses_and_grad_t_agree_bit_by_bit(d, monkeypatch):
    with_masses = end(chain(d))
    monkeypatch.setattr(Hamiltonian, "inverse_masses", None)
    system = chain(d)
    assert not isinstance(kernel.prepare(method("stormer-verlet"), system).step.dT, np.ndarray)
    np.testing.assert_array_equal(end(system), with_masses)


def test_control_another_mass_would_be_seen():
    others = chain(2, lambda p: of_masses(p) + p[-1] ** 2 / 10**9)
    assert np.any(end(others) != end(chain(2)))


@pytest.mark.parametrize("h", [1.0, 2.0])
def test_a_kick_of_length_1_is_not_special(h):
    """The last kick of a step is merged with the first of the next; a merged kick may have length 1."""
    s = integrate(Hamiltonian(q="q", p="p", H="p**2/2 + q**2/50"), "stormer-verlet", h=h, steps=2, q0=[0.3], p0=[0.2])
    q, p = 0.3, 0.2
    for _ in range(2):
        p -= h / 2 * q / 25
        q += h * p
        p -= h / 2 * q / 25
    assert [s.q[-1, 0], s.p[-1, 0]] == pytest.approx([q, p], abs=1e-15)


# -- quadratic T: the special kernels reach the states of the general one ---------------------------------------------

ROUND_OFF = 2e-13
ONE_STAGE = kinds(
    [method("scheme-i", lam="1/3"), *(m for m in variants() if m.family == "parametric" and m.data[0] == 1)]
)


class General(Hamiltonian):
    """A Hamiltonian that reports no structure, which forces the general kernel."""

    separable = False
    quadratic_kinetic = False


def full_mass():
    return Hamiltonian(q="q1 q2", p="p1 p2", H="p1**2 + p1*p2 + p2**2 + cos(q1)/3 + q1**2*q2**2/2 + q2**2/2")


SYSTEMS = {"henon-heiles": lambda: problem("henon-heiles").system, "full mass matrix": full_mass}
STARTS = {"henon-heiles": ([0.1, 0.3], [0.2, -0.1]), "full mass matrix": ([0.5, -0.3], [0.2, 0.4])}


def run(system, method, name, steps=40):
    q, p = STARTS[name]
    s = integrate(system, method, h=0.02, steps=steps, q0=q, p0=p)
    assert s.status == "ok"
    return np.hstack([s.q, s.p])


@pytest.mark.parametrize("name", SYSTEMS)
@pytest.mark.parametrize("label", ONE_STAGE)
def test_the_special_kernel_equals_the_general_one(label, name):
    m, system = ONE_STAGE[label], SYSTEMS[name]()
    general = General(q=system.q, p=system.p, H=system.H, singular=system.singular)
    special, forced = kernel.prepare(m, system), kernel.prepare(m, general)
    assert forced.run is parametric.run
    assert forced.step.field is not None
    assert special.run is splitting.run or special.step.field is None, "the special form was not chosen"
    assert np.abs(run(system, m, name) - run(general, m, name)).max() < ROUND_OFF


def weights(lam, rounded=False):
    """Sums of the two weights in each substep of Scheme III, as exact fractions of the doubles.

    The weights are those prepared, or (``rounded``) 1 - lambda and lambda rounded independently.
    """
    step = kernel.prepare(method("scheme-iii", lam=lam), SYSTEMS["henon-heiles"]()).step
    pairs = zip(step.mu, step.lam, strict=True) if not rounded else [(float(1 - lam), float(lam))]
    return {Fraction(float(mu)) + Fraction(float(weight)) for mu, weight in pairs}


def test_weights_of_symplectic_substeps_add_up_to_one():
    """Otherwise the map would be symplectic to round-off only."""
    several = [Fraction(k, n) for n in (3, 7, 11, 1000) for k in (-5, -1, 1, 2, 9)]
    assert {total for lam in several for total in weights(lam)} == {1}
    assert {total for lam in several for total in weights(lam, rounded=True)} > {1}, "the control"


# -- processors -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("id", [t.name for t in GROUPS["processed"]])
def test_steps_between_rows_cost_the_kernel_alone(id):
    """A row costs the processor and its inverse; the last kick of a step is the first of the next."""
    kernel, pre = map(processed.letters, processed.parts_of(BY_NAME[id]))
    kernel, pre = processed.weights(kernel), processed.rows(pre)
    own = sum(b != 0 for b in kernel[1][1:])
    own += kernel[1][0] != 0 and kernel[1][-1] == 0
    row = 2 * sum(b != 0 for _, b in pre) + 2 * (kernel[1][0] != 0)
    pendulum = Hamiltonian(q="q", p="p", H="p**2/2 - cos(q)")
    for every in (1, 5):
        s = integrate(pendulum, id, h=0.05, steps=20, q0=[1.3], p0=[0.4], save_every=every)
        assert s.counts["gradient"] == 20 * own + 20 // every * row


# -- modified kicks ---------------------------------------------------------------------------------------------------


def test_loops_without_a_formula_need_no_hessian():
    made = problem(str(Path(__file__).parents[2] / "examples" / "problems" / "chain.py"), N=30)
    ends = [
        integrate(made.system, "hessian-free-badab", h=h, t_end=1.0, q0=made.q0, p0=made.p0).q[-1]
        for h in (0.1, 0.05, 0.025)
    ]
    ratio = np.abs(ends[0] - ends[1]).max() / np.abs(ends[1] - ends[2]).max()
    assert abs(np.log2(ratio) - 4) < 0.2
    with pytest.raises(InvalidInput, match="loops and no formula"):
        integrate(made.system, "chin-4a", h=0.1, t_end=1.0, q0=made.q0, p0=made.p0)


def trace_error(weight: float, h: float) -> float:
    """tr M - 2 cos h of a step drift, kick, drift on the oscillator whose kick is p - (h - 2 weight h^3) q."""
    drift, kick = np.array([[1.0, h / 2], [0.0, 1.0]]), np.array([[1.0, 0.0], [-(h - 2 * weight * h**3), 1.0]])
    return float(np.trace(drift @ kick @ drift) - 2 * np.cos(h))


def test_takahashi_imada_has_effective_order_four():
    """A trace does not change under conjugation: the order of its error less two is that of the best conjugate."""
    weight = float(next(m for m in METHODS if m.id == "takahashi-imada").data[0][1][2])
    orders = [np.log2(trace_error(w, 0.2) / trace_error(w, 0.1)) for w in (weight, 1.001 * weight)]
    assert orders[0] == pytest.approx(6, abs=0.05)
    assert orders[1] < 5.5, "the control"
    made = Hamiltonian(q="q", p="p", H="p**2/2 + q**2/2")
    first, second = (integrate(made, "takahashi-imada", h=0.2, steps=1, q0=[q], p0=[1 - q]) for q in (1.0, 0.0))
    assert first.q[-1, 0] + second.p[-1, 0] - 2 * np.cos(0.2) == pytest.approx(trace_error(weight, 0.2), rel=1e-6)
