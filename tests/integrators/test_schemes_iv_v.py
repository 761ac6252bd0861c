"""Schemes IV and V and their variants: steps without a root, and the root that is taken."""

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
from support.solutions import energy_errors, last

EQUIP = by_label([m for m in variants() if m.family == "schemes_iv_v"])
#: Those with one root in a step: the long negative substep of a composition is unstable in the hard cases.
SINGLE = [label for label, m in EQUIP.items() if len({row[2] for row in m.data}) == 1]

#: Cases in which some steps have no root: (problem, h, steps).
HARD = (("henon-heiles:box", 0.1, 5000), ("pendulum:rotating", 0.3, 200))


@cache
def run(label, case):
    """(problem, solution) of the method with this label in a case; computed once."""
    name, h, steps = case
    return problem(name), integrate(problem(name), EQUIP[label], h=h, steps=steps)


def size_of_terms(made, s):
    """The round-off scale of H: the sizes of its terms and the effect of rounding the state."""
    system = made.system
    parts = [*sp.Add.make_args(sp.expand(system.H)), *(x * system.H.diff(x) for x in (*system.q, *system.p))]
    return np.sum([np.abs(system.observe(t, s.q, s.p)) for t in parts], 0).max()


@pytest.mark.parametrize("case", HARD, ids=lambda c: c[0])
@pytest.mark.parametrize("label", SINGLE)
def test_every_step_with_a_root_restores_the_initial_energy(label, case):
    made, s = run(label, case)
    assert len(s.parameter), s.reason
    good = ~np.isnan(s.parameter)
    assert (~good).sum() == s.counts["fallbacks"]
    error = np.abs(energy_errors(s))[1:]
    unit = np.finfo(float).eps * size_of_terms(made, s)
    assert error[good].max() < 64 * unit
    if not good.all():
        assert error[~good].max() > 64 * unit, "a fallback that keeps the energy is no fallback"
        after = np.flatnonzero(~good[:-1] & good[1:]) + 1
        assert error[after].max() < 64 * unit, "a later step wins the energy back"


#: A scheme -> the one with a fixed lambda that is its step; the distances of lambda from 1/2 at which it is looked at.
FIXED = {"scheme-iv": "scheme-i", "scheme-v": "scheme-iii"}
LADDER = np.array([0.0, *np.geomspace(1e-7, RADIUS, 60)])


def brackets(label, made, s, n):
    """(|H - H0| after step n with lambda = 1/2, where H - H0 first changes sign as lambda moves away on either side).

    The places are intervals (from, to) of |lambda - 1/2|.
    """
    H0, found = made.system.energies(s.q[:1], s.p[:1])[0], []
    for side in (1, -1):
        errors = []
        for x in LADDER:
            parameters, start = {"lam": 0.5 + side * x}, {"q0": s.q[n], "p0": s.p[n]}
            end = integrate(made, FIXED[label], h=s.h, steps=1, parameters=parameters, **start)
            if not end.counts["steps"]:
                break  # the branch of solutions from lambda = 1/2 ends here
            errors.append(made.system.energies(end.q[-1:], end.p[-1:])[0] - H0)
            if (errors[-1] > 0) != (errors[0] > 0):
                found.append((LADDER[len(errors) - 2], x))
                break
    return abs(errors[0]), found


@pytest.mark.parametrize("label", FIXED)
def test_the_root_is_the_one_nearest_one_half_and_steps_that_fall_back_have_none(label):
    made, s = run(label, HARD[0])
    away = np.abs(s.parameter - 0.5)
    checked = 0
    for n in [*np.argsort(-np.nan_to_num(away))[:4], *range(0, 200, 50)]:
        E0, found = brackets(label, made, s, n)
        if E0 > 1e-12 and not np.isnan(away[n]):  # at the round-off of H roots cannot be told apart
            low, high = min(found)
            assert 0.9 * low <= away[n] <= 1.1 * high, n
            checked += 1
    assert checked >= 5
    fallbacks = np.flatnonzero(np.isnan(away))[:3]
    assert label != "scheme-iv" or len(fallbacks) == 3
    assert not any(brackets(label, made, s, n)[1] for n in fallbacks)


def unmarked_kepler():
    return Hamiltonian(q="x y", p="u v", H="(u**2 + v**2)/2 - 1/sqrt(x**2 + y**2)", singular=())


@pytest.mark.parametrize("label", FIXED)
def test_a_run_mostly_without_roots_is_reported(label):
    e = 0.9
    start = {"q0": [1 - e, 0], "p0": [0, ((1 + e) / (1 - e)) ** 0.5]}
    lost = integrate(unmarked_kepler(), label, h=0.3, steps=200, **start)
    assert lost.status == "no-root"
    assert "no parameter" in lost.reason


@pytest.mark.parametrize(("h", "most"), [(0.01, 2.9), (0.1, 3.3)])
@pytest.mark.parametrize("name", ["henon-heiles:chaotic", "perturbed-kepler"])
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
