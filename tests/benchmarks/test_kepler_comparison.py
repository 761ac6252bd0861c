"""The Kepler comparison: orbital elements, phases, advance of the perihelion, growth, failed runs."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.studies.kepler import orbit as kepler
from phasebench.benchmarks.studies.kepler import runs
from phasebench.reference.solvers.exact import exact as exact_solution

#: Odd multiples of an eighth of an orbit, within 40 orbits: no special phase.
EIGHTHS = [1, 3, 5, 7, 9, 101, 207, 313]


@pytest.mark.parametrize("e", [0.0, 0.9])
def test_elements_of_exact_kepler_motion(e):
    p = problem("kepler", e=e)
    truth = kepler.truth(p)
    h = truth.period / 8
    q, v = (np.array(x, dtype=float) for x in exact_solution(p, [h * n for n in EIGHTHS]))
    when = kepler.times(h, EIGHTHS, exactly=False)
    found = kepler.errors(truth, when, q, v)
    assert np.abs(found.phase).max() < 2e-13
    assert np.abs(found.energy).max() < 1e-13
    assert np.abs(found.momentum).max() < 1e-15
    if e:
        assert np.abs([found.perihelion, found.anomaly]).max() < 2e-13
        assert np.abs(kepler.elements(q, v).eccentricity - e).max() < 1e-14
    else:
        assert np.isnan(found.perihelion).all()
    # Another eccentricity changes only the angular momentum, another speed the energy and the phase.
    assert np.abs(kepler.errors(kepler.truth(problem("kepler", e=e + 0.05)), when, q, v).momentum).max() > 1e-3
    faster = SimpleNamespace(q0=p.q0, p0=(0.0, p.p0[1] * 1.0001), parameters={})
    other = kepler.errors(kepler.truth(faster), when, q, v)
    assert np.abs(other.energy).max() > 1e-4
    assert np.abs(other.phase).max() > 1e-2


@pytest.mark.parametrize(
    ("method", "e", "n", "status", "reason"),
    [
        ("stormer-verlet", 0.9, 20, "collision", ""),
        ("explicit-euler", 0.6, 60, "diverged", "no bound orbit"),
        ("scheme-iii", 0.6, 200, "ok", ""),
    ],
)
def test_failed_run_has_a_status_and_reason(method, e, n, status, reason):
    made, values = problem("kepler", e=e), {"lam": "0"} if method == "scheme-iii" else {}
    chosen, setting = integrator(method, parameters=values), runs.Setting(f"{n} steps", n)
    run, rows = runs.on_the_way(chosen, made, kepler.truth(made), setting, 30)
    assert (run["status"], bool(run["reason"])) == (status, status != "ok")
    assert reason in run["reason"]
    assert all(r["orbits"] <= run["reached"] for r in rows)
    assert status != "ok" or [r["orbits"] for r in rows] == [1.5, 3.5, 10.5, 30.5]


# -- perturbed initial states -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("others", "found"),
    [
        ([2e-9, 3e-9, 4e-9, 5e-9, 6e-9, 7e-9, 8e-9, 9e-9], ((5e-9, 2e-9, 8e-9), 9)),
        ([9e-9] + [1.1e-9] * 7, ((1.1e-9, 1.1e-9, 1.1e-9), 9)),
        ([1.04e-9, 1.02e-9, 9e-9, 9e-9], ((1.02e-9, 1e-9, 1.04e-9), 3)),
        ([1.06e-9, 1e-9, 2e-9], ((1.03e-9, 1e-9, 2e-9), 4)),
        ([], ((1e-9, 1e-9 / 30, 3e-8), 1)),
    ],
    ids=["spread", "an outlier", "truncation", "hardly truncation", "too dear"],
)
def test_median_phase_error_from_draws(others, found):
    ((value, low, high), count), taken = runs.median_phase(1e-9, iter(others)), found
    assert (value, low, high) == pytest.approx(taken[0])
    assert count == taken[1]
