"""Declared conservation of energy and quadratic invariants against measurement.

Energy on the Henon-Heiles box orbit; angular momentum, a quadratic invariant, on the perturbed Kepler problem.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from phasebench.benchmarks.measure.battery import SYSTEMS, by_label, variants
from phasebench.benchmarks.measure.drift import drift
from phasebench.benchmarks.problems import problem
from phasebench.integrators.driver import integrate
from phasebench.integrators.record import BOUNDED, DRIFT, EXACT, NONE, ROUND_OFF
from support.one_of_each import kinds
from support.solutions import energy_errors

RECORDS = by_label(variants())
#: One of each kind, and some of a high order.
ALL = kinds(RECORDS.values()) | {x: RECORDS[x] for x in ("extended-midpoint-4", "kahan-li-8", "gauss-8", "hbvm-8-4")}
BOX, KEPLER = problem("henon-heiles:box"), problem("perturbed-kepler")
H, STEPS = 0.1, 20_000
#: From this order on steps are longer by this factor, as round-off would hide the method's error.
HIGH, LONGER = 8, 5
#: Factor for the family "field", whose drift is below round-off for short steps.
FIELD = 25
#: Methods whose defect of symplecticity is of a far higher order than their error.
ALMOST_SYMPLECTIC = {"extended-midpoint-4"}
#: Methods that are another one if H is separable, as it is here: what that one declares is seen.
IF_SEPARABLE = {"pihajoki-2": "stormer-verlet"}


def record_if_separable(label):
    return RECORDS[IF_SEPARABLE.get(label, label)]


def longer(label):
    """Factor by which a method's steps are longer here: more for high orders and for the family "field"."""
    if ALL[label].family == "field":
        return FIELD
    if not ALL[label].one_step:  # high orders of them are stable for short steps only
        return 0.5
    return LONGER if ALL[label].order >= HIGH or label in ALMOST_SYMPLECTIC else 1


@cache
def energies(label):
    """(solution, t, H - H0) of a method on the Henon-Heiles box orbit to t = 2000; H0 = 0.02."""
    s = integrate(BOX, ALL[label], h=H * longer(label), steps=int(STEPS / longer(label)))
    return s, s.t, energy_errors(s)


@cache
def momenta(label):
    """(solution, t, L - L0) of a method on the perturbed Kepler problem to t = 120; the angular momentum L0 is 0.8."""
    s = integrate(KEPLER, ALL[label], h=0.01 * longer(label), steps=int(12_000 / longer(label)))
    L = KEPLER.system.observe(KEPLER.invariants["angular-momentum"], s.q, s.p)
    return s, s.t, L - L[0]


def verdict(declared, s, t, error, value):
    """(whether an invariant's errors confirm the declared class of conservation, description).

    The invariant has the size ``value``; ``t`` and ``error`` are along the solution s.
    """
    unit = np.finfo(float).eps * abs(value)
    greatest = np.abs(error).max()
    if declared in (EXACT, ROUND_OFF):
        return s.status == "ok" and greatest < 1e4 * unit, f"greatest {greatest:.2g}"
    if declared == NONE:
        return greatest > 1e6 * unit, f"greatest {greatest:.2g}"
    if s.status != "ok" or len(t) < 64:
        return declared == DRIFT, f"status {s.status}"
    if greatest > 0.25 * abs(value):
        return declared == DRIFT, f"greatest {greatest:.2g}: the invariant is lost"
    d = drift(t, error)
    # A trend counts if it exceeds its confidence interval and a tenth of the greatest error.
    secular = (d.low > 0 or d.high < 0) and abs(d.value) * t[-1] > 0.1 * greatest and greatest > 1e4 * unit
    return secular == (declared == DRIFT), f"greatest {greatest:.2g}, drift {d.low:.2g} .. {d.high:.2g} times {t[-1]}"


def applies(m, made):
    return m.lacks(made.system) is None


@pytest.mark.parametrize("label", [x for x, m in ALL.items() if applies(m, BOX)])
def test_energy(label):
    right, shown = verdict(record_if_separable(label).energy, *energies(label), 0.02)
    s = energies(label)[0]
    if not right and ALL[label].energy == ROUND_OFF and s.counts["fallbacks"]:
        good = ~np.isnan(s.parameter) if ALL[label].family in ("schemes_iv_v", "equip") else np.ones(len(s.q) - 1, bool)
        error = energies(label)[2][1:][good]
        right, shown = np.abs(error).max() < 1e-15, f"greatest after a root {np.abs(error).max():.2g}"
    assert right, f"declared {ALL[label].energy}, shown: {shown}"


COUPLED = SYSTEMS["coupled"]()[0]
KEEPING = [x for x, m in kinds(RECORDS.values()).items() if m.energy == ROUND_OFF and m.lacks(COUPLED) is None]


@pytest.mark.parametrize("label", [*KEEPING, "implicit-midpoint"])
def test_energy_of_a_system_that_is_not_separable(label):
    """The midpoint rule is the control."""
    system, q, p = SYSTEMS["coupled"]()
    s = integrate(system, ALL[label], h=0.05, steps=500, q0=q, p0=p)
    missed = np.isnan(s.parameter)
    rooted = ~missed if len(missed) and not missed.all() else np.ones(500, bool)  # some methods have no parameter
    assert s.status == "ok"
    assert rooted.mean() > 0.9
    assert (np.abs(energy_errors(s)[1:][rooted]).max() < 2e-14) == (label in KEEPING)


@pytest.mark.parametrize("label", [x for x, m in ALL.items() if applies(m, KEPLER)])
def test_quadratic_invariants(label):
    right, shown = verdict(record_if_separable(label).quadratic, *momenta(label), 0.8)
    assert right, f"declared {ALL[label].quadratic}, shown: {shown}"


def test_control_classes_are_told_apart():
    assert not verdict(BOUNDED, *energies("rk4"), 0.02)[0]
    assert not verdict(ROUND_OFF, *energies("implicit-midpoint"), 0.02)[0]
    assert not verdict(DRIFT, *energies("implicit-midpoint"), 0.02)[0]
    assert not verdict(ROUND_OFF, *momenta("avf"), 0.8)[0]


def test_free_copies_part_if_h_is_not_separable_and_bound_ones_stay():
    system, q, p = SYSTEMS["tao"]()
    free, bound = (integrate(system, id, h=0.01, steps=3000, q0=q, p0=p).energy() for id in ("pihajoki-2", "tao-2"))
    free, bound = (np.abs(E / E[0] - 1) for E in (free, bound))
    assert free.max() > 100 * free[:300].max()
    assert bound.max() < 2 * bound[:300].max() < 1e-4
