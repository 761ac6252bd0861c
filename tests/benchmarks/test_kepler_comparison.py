"""The Kepler comparison: orbital elements, phases, advance of the perihelion, growth, failed runs."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.studies.kepler import orbit as kepler
from phasebench.benchmarks.studies.kepler import runs
from phasebench.reference.solvers import taylor
from phasebench.reference.solvers.exact import exact as exact_solution

#: Odd multiples of an eighth of an orbit, within 40 orbits: no special phase.
EIGHTHS = [1, 3, 5, 7, 9, 101, 207, 313]


def steps(n):
    """The setting of n steps an orbit."""
    return runs.Setting(f"{n} steps", n)


def build_problem(name, e):
    """The Kepler problem or the perturbed one with mu = 0.002, at eccentricity e."""
    return problem(name, e=e, **({"mu": 0.002} if name == "perturbed-kepler" else {}))


def worst(found, names=("phase", "perihelion", "anomaly")):
    """The largest absolute value among the named errors of a comparison with Kepler's orbit."""
    return max(float(np.abs(getattr(found, n)).max()) for n in names)


@pytest.mark.parametrize("e", [0.0, 0.9])
def test_elements_of_exact_kepler_motion(e):
    p = build_problem("kepler", e)
    truth = kepler.truth(p)
    h = truth.period / 8
    q, v = (np.array(x, dtype=float) for x in exact_solution(p, [h * n for n in EIGHTHS]))
    when = kepler.times(h, EIGHTHS, exactly=False)
    found = kepler.errors(truth, when, q, v)
    assert np.abs(found.phase).max() < 2e-13
    assert np.abs(found.energy).max() < 1e-13
    assert np.abs(found.momentum).max() < 1e-15
    if e:
        assert worst(found) < 2e-13
        assert np.abs(kepler.elements(q, v).eccentricity - e).max() < 1e-14
    else:
        assert np.isnan(found.perihelion).all()
    # Another eccentricity changes only the angular momentum, another speed the energy and the phase.
    assert np.abs(kepler.errors(kepler.truth(build_problem("kepler", e + 0.05)), when, q, v).momentum).max() > 1e-3
    faster = SimpleNamespace(q0=p.q0, p0=(0.0, p.p0[1] * 1.0001), parameters={})
    other = kepler.errors(kepler.truth(faster), when, q, v)
    assert np.abs(other.energy).max() > 1e-4
    assert np.abs(other.phase).max() > 1e-2


@pytest.mark.parametrize(("e", "turn"), [(0.0, 1), (0.9, -1)])
def test_angle_variables_of_the_perturbed_problem(e, turn):
    p = build_problem("perturbed-kepler", e)
    truth = kepler.truth(p)
    h = truth.period / 8
    grid = [h * n for n in EIGHTHS]
    rows = taylor.states(p.system, np.longdouble, p.q0, p.p0, grid).astype(float) * np.array([1, turn, 1, turn])
    start = SimpleNamespace(q0=p.q0, p0=(p.p0[0], turn * p.p0[1]), parameters=p.parameters)
    truth = kepler.truth(start)
    when = kepler.times(h, EIGHTHS, exactly=False)
    found = kepler.errors(truth, when, rows[:, :2], rows[:, 2:])
    # On a nearly circular orbit the error of the pericentre is round-off divided by the eccentricity, 0.002.
    assert worst(found) < (3e-12 if e == 0 else 5e-13)
    assert np.abs(found.phase).max() < 5e-13
    advance = kepler.advances(truth, when, found, -1)["advance"]
    assert abs(advance - truth.advance) < 1e-13 * (1 if e else 10)
    start.parameters = {"mu": 0.0021}
    assert worst(kepler.errors(kepler.truth(start), when, rows[:, :2], rows[:, 2:])) > 1e-2


def test_advance_and_period_in_quadruple_precision():
    import mpmath

    p = build_problem("perturbed-kepler", 0.6)
    advance, period = kepler.exact_orbit(p.q0, p.p0, p.parameters["mu"])
    quad = taylor.extended_types()[1]
    T = float(period)
    with mpmath.workdps(30):
        x, y, v, w = (mpmath.mpf(str(s)) for s in taylor.states(p.system, quad, p.q0, p.p0, [T])[0])
        late = period - mpmath.mpf(T)
        r2, k = x * x + y * y, 2 * mpmath.mpf(p.parameters["mu"]) / 3
        force = 1 / r2**1.5 + 1.5 * k / r2**2.5
        radial = (x * v + y * w) + late * (v * v + w * w - force * r2)
        angle = mpmath.atan2(y, x) + late * (x * w - y * v) / r2
        assert abs(angle - advance) < 1e-26
        assert abs(radial) < 1e-26
    first = kepler.first_order_advance(p.q0[0] * p.p0[1], p.parameters["mu"])
    assert abs(float(advance) - first) > 1e-5


def test_phases_are_unwrapped_over_many_turns():
    p = build_problem("kepler", 0.6)
    truth = kepler.truth(p)
    faster = SimpleNamespace(id="kepler", q0=p.q0, p0=(0.0, p.p0[1] * 0.98), parameters={})
    n = np.arange(1, 401)
    h = truth.period / 2
    q, v = (np.array(x, dtype=float) for x in exact_solution(faster, [h * k for k in n], digits=20))
    when = kepler.times(h, n, exactly=False)
    found = kepler.errors(truth, when, q, v)
    expected = 2 * np.pi * (h * n) * (1 / kepler.truth(faster).period - 1 / truth.period)
    assert expected[-1] > 20 * np.pi
    assert np.abs(found.phase / expected - 1).max() < 1e-11
    assert np.abs(found.perihelion).max() < 1e-14
    assert runs.growth(n / 2, found.phase) == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize("power", [0.5, 1.0, 2.0])
def test_growth_of_an_oscillating_error(power):
    t = np.arange(1, 20_001) / 2
    assert runs.growth(t, 1e-9 * t**power * np.cos(1.7 * t)) == pytest.approx(power, abs=0.05)
    assert runs.growth(t, np.zeros(len(t))) is None


def test_failed_run_has_a_status_and_reason():
    p = build_problem("kepler", 0.9)
    truth = kepler.truth(p)
    run, rows = runs.on_the_way(integrator("stormer-verlet"), p, truth, steps(20), 30)
    assert run["status"] == "collision"
    assert run["reason"]
    assert all(r["orbits"] <= run["reached"] for r in rows)
    p = build_problem("kepler", 0.6)
    run, rows = runs.on_the_way(integrator("explicit-euler"), p, kepler.truth(p), steps(60), 30)
    assert run["status"] == "diverged"
    assert "no bound orbit" in run["reason"]
    assert run["reached"] < 30
    run, rows = runs.on_the_way(integrator("scheme-iii", parameters={"lam": "0"}), p, kepler.truth(p), steps(200), 30)
    assert run["status"] == "ok"
    assert [r["orbits"] for r in rows] == [1.5, 3.5, 10.5, 30.5]


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


def test_perturbation_gives_every_orbit_the_same_advance():
    """mu is proportional to L^4, so the first-order advance is the same; at e = 0.6 it is the talk's."""
    about = {e: runs.orbit("perturbed-kepler", e)[2] for e in runs.ECCENTRICITIES}
    assert about[0.6]["mu"] == 0.0075
    assert [a["first order"] for a in about.values()] == pytest.approx([about[0.6]["first order"]] * len(about))
    assert runs.orbit("kepler", 0.6)[2]["mu"] == 0.0
