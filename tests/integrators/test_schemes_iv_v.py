"""Schemes IV and V, their compositions and variants: energy, quadratic invariants, and the root that is taken.

The root is checked against a scan over the parameter, written here in NumPy without code of the package: it follows the
step from lambda = 1/2 outwards on both sides.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import sympy as sp

from phasebench.benchmarks.measure.battery import by_label, variants
from phasebench.benchmarks.problems import problem
from phasebench.integrators.driver import integrate
from phasebench.integrators.families.schemes_iv_v import RADIUS
from phasebench.integrators.systems.hamiltonian import Hamiltonian
from support.solutions import last

EQUIP = by_label([m for m in variants() if m.family == "schemes_iv_v"])
#: Those with one root in a step: the long negative substep of a composition is unstable in the hard cases.
SINGLE = [label for label, m in EQUIP.items() if len({row[2] for row in m.data}) == 1]

#: Cases in which every step has a root near 1/2, and in which some have none: (problem, parameters, h, steps).
EASY = (
    ("henon-heiles:chaotic", {}, 0.05, 400),
    ("henon-heiles:box", {}, 0.05, 400),
    ("pendulum:swinging", {}, 0.1, 400),
    ("perturbed-kepler", {}, 0.02, 800),
)
HARD = (
    ("henon-heiles:box", {}, 0.1, 5000),
    ("henon-heiles:chaotic", {}, 0.2, 2000),
    ("perturbed-kepler", {"e": 0.9}, 0.005, 4000),
    ("pendulum:rotating", {}, 0.3, 200),
)


@cache
def solution(label, name, parameters, h, steps):
    """(problem, solution) of the method with this label on a problem; computed once."""
    made = problem(name, **dict(parameters))
    return made, integrate(made, EQUIP[label], h=h, steps=steps)


def run(label, case):
    """(problem, solution) of a method in a case (problem's name, its parameters, h, steps)."""
    name, parameters, h, steps = case
    return solution(label, name, tuple(parameters.items()), h, steps)


def energy_error(made, s):
    """H - H0 along a solution, evaluated in extended precision so that only the rounding of states shows."""
    q, p = s.q.astype(np.longdouble), s.p.astype(np.longdouble)
    H = sp.lambdify([*made.system.q, *made.system.p], made.system.H, "numpy")(*q.T, *p.T)
    return (H - H[0]).astype(float)


def size_of_terms(made, s):
    """The round-off scale of H: the sizes of its terms and the effect of rounding the state."""
    system = made.system
    parts = [*sp.Add.make_args(sp.expand(system.H)), *(x * system.H.diff(x) for x in (*system.q, *system.p))]
    return np.sum([np.abs(system.observe(t, s.q, s.p)) for t in parts], 0).max()


@pytest.mark.parametrize("case", EASY, ids=lambda c: c[0])
@pytest.mark.parametrize("label", EQUIP)
def test_energy_is_conserved_to_round_off(label, case):
    made, s = run(label, case)
    assert s.status == "ok"
    assert s.counts["fallbacks"] == 0
    assert np.abs(energy_error(made, s)).max() < 16 * np.finfo(float).eps * size_of_terms(made, s)


@pytest.mark.parametrize("case", EASY, ids=lambda c: c[0])
def test_control_the_midpoint_rule_does_not_conserve_energy(case):
    name, parameters, h, steps = case
    made = problem(name, **parameters)
    s = integrate(made, "implicit-midpoint", h=h, steps=steps)
    assert np.abs(energy_error(made, s)).max() > 1e-8


@pytest.mark.parametrize("case", HARD, ids=lambda c: c[0])
@pytest.mark.parametrize("label", SINGLE)
def test_every_step_with_a_root_restores_the_initial_energy(label, case):
    made, s = run(label, case)
    assert len(s.parameter), s.reason
    good = ~np.isnan(s.parameter)
    assert (~good).sum() == s.counts["fallbacks"]
    error = np.abs(energy_error(made, s))[1:]
    unit = np.finfo(float).eps * size_of_terms(made, s)
    assert error[good].max() < 64 * unit
    if not good.all():
        assert error[~good].max() > 64 * unit, "a fallback that keeps the energy is no fallback"
        after = np.flatnonzero(~good[:-1] & good[1:]) + 1
        assert error[after].max() < 64 * unit, "a later step wins the energy back"


@pytest.mark.parametrize("case", [c for c in HARD if c[0] != "perturbed-kepler"], ids=lambda c: c[0])
@pytest.mark.parametrize("label", SINGLE)
def test_hard_cases_run_to_the_end(label, case):
    _, s = run(label, case)
    assert s.status == "ok", s.reason


@pytest.mark.parametrize("label", EQUIP)
def test_angular_momentum_is_conserved_to_round_off(label):
    made, s = run(label, EASY[3])
    L = made.system.observe(made.invariants["angular-momentum"], s.q, s.p)
    assert np.abs(L - L[0]).max() < 2e-14


@pytest.mark.parametrize("label", EQUIP)
def test_quadratic_invariants_are_conserved(label):
    """H is invariant under q -> exp(sD) q, p -> exp(-sD^T) p with D = diag(1, -1), so q . D p is conserved."""
    system = Hamiltonian(
        q="q1 q2", p="p1 p2", H="(p1**2*q1**2 + p2**2*q2**2)/2 + cos(q1*q2) + p1*p2 + p1*q1/3 + (q1*p1)**4/20"
    )
    s = integrate(system, EQUIP[label], h=0.02, steps=300, q0=[0.7, 0.4], p0=[0.3, -0.5])
    assert s.status in ("ok", "no-root")  # a step without a root is symplectic too
    q, p = s.q, s.p
    kept = q[:, 0] * p[:, 0] - q[:, 1] * p[:, 1]
    assert np.abs(kept - kept[0]).max() < 1e-14
    plain = integrate(system, "rk4", h=0.1, steps=60, q0=[0.7, 0.4], p0=[0.3, -0.5])
    moved = plain.q[:, 0] * plain.p[:, 0] - plain.q[:, 1] * plain.p[:, 1]
    assert np.abs(moved - moved[0]).max() > 1e-10, "the control"


class Scan:
    """E(x) = H(step with lambda = 1/2 + x) - H0, followed from x = 0 outwards by Newton's method in NumPy."""

    def __init__(self, system, signs, h):
        y = [*system.q, *system.p]
        self.d, self.signs, self.h = system.d, signs, h
        self.H = sp.lambdify([y], system.H, "numpy")
        gradient = [system.H.diff(x) for x in y]
        self.gradient = sp.lambdify([y], gradient, "numpy")
        self.hessian = sp.lambdify([y], sp.hessian(system.H, y).tolist(), "numpy")
        d = system.d
        self.J = np.block([[np.zeros((d, d)), np.eye(d)], [-np.eye(d), np.zeros((d, d))]])

    def substep(self, y, h, lam, z):
        """Increment of Scheme I from y over h by Newton's method started at z; None if it does not converge."""
        weights = np.repeat([1 - lam, lam], self.d)
        for _ in range(40):
            stage = y + weights * z
            F = z - h * self.J @ np.array(self.gradient(stage), float)
            A = np.eye(2 * self.d) - h * self.J @ np.array(self.hessian(stage), float) * weights
            try:
                move = np.linalg.solve(A, F)
            except np.linalg.LinAlgError:
                return None
            z = z - move
            if not np.isfinite(z).all():
                return None
            if np.abs(move).max() < 1e-14 * (1 + np.abs(z).max()):
                return z
        return None

    def __call__(self, y, H0, x, guesses):
        """(E, increments of the substeps), or None if a substep has no solution."""
        n, found = len(self.signs), []
        for sign, guess in zip(self.signs, guesses, strict=True):
            z = self.substep(y, self.h / n, 0.5 + sign * x, guess)
            if z is None:
                return None
            y = y + z
            found.append(z)
        return self.H(y) - H0, found

    def nearest(self, y, H0, radius, points=400):
        """The root nearest 0 within the radius on either side; inf if there is none."""
        zero = [np.zeros(2 * self.d)] * len(self.signs)
        begin = self(y, H0, 0.0, zero)
        if begin is None:
            return None
        ladder = np.concatenate([np.geomspace(1e-7, 1e-3, 60), np.linspace(1e-3, radius, points)[1:]])
        roots = []
        for side in (1, -1):
            a, (Ea, za) = 0.0, begin
            for b in side * ladder:
                there = self(y, H0, b, za)
                if there is None or max(np.abs(u - v).max() for u, v in zip(there[1], za, strict=True)) > 0.5:
                    break  # the branch of solutions from lambda = 1/2 ends here
                if (there[0] > 0) != (Ea > 0):
                    roots.append(self._bisect(y, H0, a, b, Ea, za))
                    break
                a, (Ea, za) = b, there
        return min(roots, key=abs, default=np.inf)

    def _bisect(self, y, H0, a, b, Ea, za):
        """Root between a and b by bisection."""
        for _ in range(60):
            m = 0.5 * (a + b)
            Em, zm = self(y, H0, m, za)
            if (Em > 0) == (Ea > 0):
                a, za = m, zm
            else:
                b = m
        return 0.5 * (a + b)


SIGNS = {"scheme-iv": (1,), "scheme-v": (-1, 1)}


def sample_steps(s, fallback, most=12):
    """Numbers of some steps with a root (those farthest from 1/2 and others), or without one."""
    lam = s.parameter
    if fallback:
        return np.flatnonzero(np.isnan(lam))[:most]
    known = np.flatnonzero(~np.isnan(lam))
    far = known[np.argsort(-np.abs(lam[known] - 0.5))][: most // 2]
    return np.unique([*far, *known[:: max(1, len(known) // most)]])


@pytest.mark.parametrize("case", EASY + HARD, ids=lambda c: f"{c[0]}-{c[2]}")
@pytest.mark.parametrize("label", SIGNS)
def test_the_root_is_the_one_nearest_one_half(label, case):
    made, s = run(label, case)
    scan = Scan(made.system, SIGNS[label], s.h)
    y = np.hstack([s.q, s.p])
    H0 = scan.H(y[0])
    checked = 0
    for n in sample_steps(s, fallback=False, most=6):
        root = scan.nearest(y[n], H0, RADIUS)
        taken = s.parameter[n] - 0.5
        E0 = abs(scan(y[n], H0, 0.0, [np.zeros(2 * made.system.d)] * len(SIGNS[label]))[0])
        if E0 < 1e-13:
            continue  # at the round-off of H roots cannot be told apart
        checked += 1
        assert abs(abs(root) - abs(taken)) < 1e-4 * (1e-2 + abs(taken)) + 1e-15 / E0, (n, root, taken)
    assert checked >= 5


@pytest.mark.parametrize("case", HARD, ids=lambda c: f"{c[0]}-{c[2]}")
@pytest.mark.parametrize("label", SIGNS)
def test_steps_that_fall_back_have_no_root(label, case):
    made, s = run(label, case)
    steps = sample_steps(s, fallback=True)
    if not len(steps):
        pytest.skip("every step has a root")
    scan = Scan(made.system, SIGNS[label], s.h)
    y = np.hstack([s.q, s.p])
    H0 = scan.H(y[0])
    assert {int(n): scan.nearest(y[n], H0, RADIUS) for n in steps} == {int(n): np.inf for n in steps}


def test_hard_cases_have_fallbacks():
    assert any(run("scheme-iv", case)[1].counts["fallbacks"] for case in HARD)


def unmarked_kepler():
    """The Kepler problem without a declared singularity, so that nothing else ends a run."""
    return Hamiltonian(q="x y", p="u v", H="(u**2 + v**2)/2 - 1/sqrt(x**2 + y**2)", singular=())


@pytest.mark.parametrize("label", SIGNS)
def test_a_run_mostly_without_roots_is_reported(label):
    e = 0.9
    start = {"q0": [1 - e, 0], "p0": [0, ((1 + e) / (1 - e)) ** 0.5]}
    lost = integrate(unmarked_kepler(), label, h=0.3, steps=200, **start)
    assert lost.status == "no-root"
    assert "no parameter" in lost.reason
    assert "smaller h" in lost.reason
    kept = integrate(unmarked_kepler(), label, h=0.001, steps=200, **start)
    assert (kept.status, kept.reason) == ("ok", "")


def test_a_few_steps_without_a_root_are_tolerated():
    found = integrate(problem("henon-heiles:box"), "scheme-iv", h=0.1, t_end=60)
    assert found.status == "ok"
    assert found.reason.startswith(f"{found.counts['fallbacks']} of 600 steps")


@pytest.mark.parametrize(("h", "most"), [(0.01, 2.9), (0.1, 3.3)])
@pytest.mark.parametrize("name", ["pendulum:swinging", "henon-heiles:chaotic", "perturbed-kepler"])
def test_a_followed_root_costs_few_evaluations(name, h, most):
    """Compared with Scheme III, one step of which is one attempt of Scheme V."""
    made = problem(name)
    taken = [integrate(made, id, h=h, steps=1000).counts["gradient"] for id in ("scheme-v", "scheme-iii")]
    assert taken[0] < most * taken[1]


# -- a few steps -------------------------------------------------------------------------------------------------------

BOX = problem("henon-heiles:box")
#: From this state a step of 0.1 has no root for Scheme IV but one for Scheme V.
ROOTLESS = {"q0": [0.1365, 0.0292], "p0": [-0.1373, 0.0245]}


def take_step(id, parameters=None, h=0.1, **start):
    """(end state, lambda of the step, number of fallbacks) of one step of a method."""
    s = integrate(BOX, id, h=h, steps=1, parameters=parameters, **(start or ROOTLESS))
    return last(s), s.parameter[0], s.counts["fallbacks"]


def test_a_step_without_a_root_is_the_midpoint_rule():
    """Schemes with an alternative take its step instead if that has a root."""
    end, lam, fallbacks = take_step("scheme-iv")
    assert np.isnan(lam)
    assert fallbacks == 1
    assert np.abs(end - take_step("implicit-midpoint")[0]).max() < 1e-15
    other, lam, _ = take_step("scheme-v")
    assert np.abs(other - end).max() > 1e-6, "the control"
    for id in ("scheme-iv-v", "scheme-v-iv"):
        found, same, fallbacks = take_step(id)
        assert fallbacks == 0
        assert abs(same - lam) < 1e-9
        assert np.abs(found - other).max() < 1e-15


@pytest.mark.parametrize(("label", "fixed"), [("scheme-iv", "scheme-i"), ("scheme-v", "scheme-iii")])
def test_a_step_equals_the_scheme_with_its_lambda(label, fixed):
    s = integrate(BOX, label, h=0.2, steps=4)
    for n, lam in enumerate(s.parameter):
        end = take_step(fixed, {"lam": lam}, h=0.2, q0=s.q[n], p0=s.p[n])[0]
        assert abs(lam - 0.5) > 1e-4
        assert np.abs(end - [*s.q[n + 1], *s.p[n + 1]]).max() < 1e-15


def test_a_run_continues_after_a_step_without_a_root():
    s = integrate(BOX, "scheme-iv", h=0.1, steps=40)
    assert np.flatnonzero(np.isnan(s.parameter)).tolist() == [24]
    assert s.counts["fallbacks"] == 1
    error = np.abs(energy_error(BOX, s))
    assert error[25] > 1e-8
    assert np.delete(error, 25).max() < 1e-15
    both = integrate(BOX, "scheme-iv-v", h=0.1, steps=40)
    assert both.counts["fallbacks"] == np.isnan(both.parameter).sum() == 0
    assert np.array_equal(both.q[:25], s.q[:25])
    assert np.abs(energy_error(BOX, both)).max() < 1e-15


@pytest.mark.parametrize(
    ("name", "h"), [("henon-heiles:box", 0.1), ("henon-heiles:box", 0.01), ("pendulum:swinging", 0.1)]
)
def test_a_root_is_followed_from_the_first_steps(name, h):
    """Evaluations compared with those of Scheme III."""
    made = problem(name)
    taken = [integrate(made, id, h=h, steps=40).counts["gradient"] for id in ("scheme-v", "scheme-iii")]
    assert taken[0] < 2.65 * taken[1]
