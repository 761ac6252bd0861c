r"""Scheme I on the harmonic oscillator, where everything is known: with :math:`z = h\omega`,

.. math::
    \operatorname{tr} M = 2 - \frac{z^2}{1 + \lambda(1 - \lambda)z^2},\qquad
    \text{stable iff } z|1 - 2\lambda| < 2,\qquad p^2 + q^2 + z(1 - 2\lambda)\,pq \text{ invariant}.

Derived from (19) of Wang, Bo & Cai (talk); at lambda = 0, 1 the limit z < 2 of Stormer-Verlet.
"""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.problems import problem
from phasebench.integrators.driver import INACCURATE, OK, UNSTABLE, integrate
from phasebench.integrators.registry import method

LAMBDAS = (-1.0, 0.0, 1 / 3, 0.5, 2.5)
OSCILLATOR = problem("harmonic-oscillator")


def step_matrix(lam, z):
    columns = []
    for q, p in ((1.0, 0.0), (0.0, 1.0)):
        s = integrate(OSCILLATOR, method("scheme-i", lam=lam), h=z, steps=1, q0=[q], p0=[p])
        assert s.status in (OK, INACCURATE, UNSTABLE)  # so long a step need not conserve energy
        columns.append([s.q[-1, 0], s.p[-1, 0]])
    return np.array(columns).T


def trace(lam, z):
    return 2 - z**2 / (1 + lam * (1 - lam) * z**2)


def grows(lam, z, steps=4000):
    s = integrate(OSCILLATOR, method("scheme-i", lam=lam), h=z, steps=steps, q0=[1.0], p0=[0.3])
    return s.status not in (OK, INACCURATE, UNSTABLE) or max(np.abs(s.q).max(), np.abs(s.p).max()) > 1e4


@pytest.mark.parametrize("z", [0.1, 1.0, 1.9])
@pytest.mark.parametrize("lam", LAMBDAS)
def test_trace_and_determinant(lam, z):
    if abs(1 + lam * (1 - lam) * z**2) < 0.05:
        pytest.skip("the step is nearly singular here")
    M = step_matrix(lam, z)
    scale = 1 + np.abs(M).max() ** 2
    assert abs(np.trace(M) - trace(lam, z)) < 2e-14 * scale
    assert abs(np.linalg.det(M) - 1) < 1e-13 * scale
    if lam not in (0.0, 1.0):
        wrong = 2 - z**2 / (1 + lam * (1 + lam) * z**2)
        assert abs(np.trace(M) - wrong) > 2e-14 * scale, "the control: another sign in the denominator"


@pytest.mark.parametrize("lam", [x for x in LAMBDAS if x != 0.5])
def test_stability_limit(lam):
    limit = 2 / abs(1 - 2 * lam)
    assert not grows(lam, 0.99 * limit)
    assert grows(lam, 1.01 * limit)


def test_the_midpoint_rule_is_stable_at_every_step():
    assert not any(grows(0.5, z) for z in (0.5, 2.0, 10.0, 200.0))


@pytest.mark.parametrize("lam", LAMBDAS)
def test_exact_invariant(lam):
    z = 0.5 * min(1.0, 2 / max(abs(1 - 2 * lam), 1e-3))
    s = integrate(OSCILLATOR, method("scheme-i", lam=lam), h=z, steps=100_000, q0=[1.0], p0=[0.3])
    q, p = s.q[:, 0], s.p[:, 0]
    kept = p**2 + q**2 + z * (1 - 2 * lam) * p * q
    assert np.abs(kept - kept[0]).max() < 1e-12 * kept[0]
    if lam != 0.5:
        wrong = p**2 + q**2 - z * (1 - 2 * lam) * p * q
        assert np.ptp(wrong) > 1e-2 * kept[0], "the control: the sign of the mixed term"
