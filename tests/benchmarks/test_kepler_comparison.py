"""The Kepler comparison: elements and phases, the perihelion's advance, growth, runs that fail, the page."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.experiments.kepler import bench_kepler, comparison, kepler
from phasebench.benchmarks.experiments.kepler.page import PAGE
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.problems import problem
from phasebench.integrators.errors import InvalidInput
from phasebench.reference.solvers import taylor
from phasebench.reference.solvers.exact import exact as exact_solution

#: Odd numbers of eighths of an orbit, over 40 orbits: no special phase.
EIGHTHS = [1, 3, 5, 7, 9, 101, 207, 313]


def made(name, e):
    return problem(name, e=e, **({"mu": 0.002} if name == "perturbed-kepler" else {}))


def worst(found, names=("phase", "perihelion", "anomaly")):
    return max(float(np.abs(getattr(found, n)).max()) for n in names)


@pytest.mark.parametrize("e", [0.0, 0.2, 0.9])
def test_elements_of_exact_kepler_motion(e):
    p = made("kepler", e)
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
    # Another eccentricity shows in the angular momentum alone, another speed in the energy and the phase.
    assert np.abs(kepler.errors(kepler.truth(made("kepler", e + 0.05)), when, q, v).momentum).max() > 1e-3
    faster = SimpleNamespace(q0=p.q0, p0=(0.0, p.p0[1] * 1.0001), parameters={})
    other = kepler.errors(kepler.truth(faster), when, q, v)
    assert np.abs(other.energy).max() > 1e-4
    assert np.abs(other.phase).max() > 1e-2


@pytest.mark.parametrize("turn", [1, -1], ids=["prograde", "retrograde"])
@pytest.mark.parametrize("e", [0.0, 0.6, 0.9])
def test_angle_variables_of_the_perturbed_problem(e, turn):
    p = made("perturbed-kepler", e)
    truth = kepler.truth(p)
    h = truth.period / 8
    grid = [h * n for n in EIGHTHS]
    rows = taylor.states(p.system, np.longdouble, p.q0, p.p0, grid).astype(float) * np.array([1, turn, 1, turn])
    start = SimpleNamespace(q0=p.q0, p0=(p.p0[0], turn * p.p0[1]), parameters=p.parameters)
    truth = kepler.truth(start)
    when = kepler.times(h, EIGHTHS, exactly=False)
    found = kepler.errors(truth, when, rows[:, :2], rows[:, 2:])
    # On a nearly circular orbit the pericentre is round-off divided by the eccentricity of 0.002.
    assert worst(found) < (3e-12 if e == 0 else 5e-13)
    assert np.abs(found.phase).max() < 5e-13
    advance = kepler.measured_advance(truth, when[-1], found.perihelion[-1], found.anomaly[-1])
    assert abs(advance - truth.advance) < 1e-13 * (1 if e else 10)
    start.parameters = {"mu": 0.0021}
    assert worst(kepler.errors(kepler.truth(start), when, rows[:, :2], rows[:, 2:])) > 1e-2


def test_the_quadratures_have_converged():
    p = made("perturbed-kepler", 0.9)
    s = integrator("scheme-iii-suzuki-4", lam="0").run(p, h=0.01, steps=500)
    few, many = (kepler.elements(s.q, s.p, 0.002, nodes) for nodes in (kepler.NODES, 3 * kepler.NODES))
    assert all(np.abs(a - b).max() < 1e-14 for a, b in zip(few, many, strict=True))
    rough = kepler.elements(s.q, s.p, 0.002, 6)
    assert np.abs(rough.anomaly - many.anomaly).max() > 1e-10


def test_the_advance_is_that_of_first_order_for_a_weak_term():
    p = made("kepler", 0.6)
    L = p.q0[0] * p.p0[1]
    mus = np.array([1e-2, 1e-3, 1e-4, 1e-5])
    off = [float(kepler.exact_orbit(p.q0, p.p0, mu)[0] / kepler.first_order_advance(L, mu)) - 1 for mu in mus]
    assert np.abs(np.diff(np.log(off)) / np.diff(np.log(mus)) - 1).max() < 0.1
    assert 0 < off[-1] < 1e-4


@pytest.mark.parametrize("e", [0.0, 0.6, 0.9])
def test_advance_and_period_against_an_integration_in_quadruple_precision(e):
    import mpmath

    p = made("perturbed-kepler", e)
    advance, period = kepler.exact_orbit(p.q0, p.p0, p.parameters["mu"])
    quad = taylor.extended()[1]
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


def test_the_advance_of_another_orbit_is_its_own():
    p = made("perturbed-kepler", 0.6)
    truth = kepler.truth(p)
    other = SimpleNamespace(q0=p.q0, p0=(0.0, p.p0[1] * 0.99), parameters=p.parameters)
    n, h = np.arange(1, 101), truth.period / 2
    rows = taylor.states(p.system, np.longdouble, other.q0, other.p0, h * n).astype(float)
    when = kepler.times(h, n, exactly=False)
    found = kepler.errors(truth, when, rows[:, :2], rows[:, 2:])
    advance = kepler.measured_advance(truth, when[-1], found.perihelion[-1], found.anomaly[-1])
    assert abs(advance - kepler.truth(other).advance) < 1e-13
    assert abs(advance - truth.advance) > 1e-4
    away = kepler.truth(other).advance - truth.advance
    told = kepler.advances(truth, when, found, -1)
    assert told == {"advance": advance, "advance error": pytest.approx(away, abs=1e-13)}
    assert kepler.advances(kepler.truth(made("kepler", 0.6)), when, found, -1) == {}


def test_phases_are_unwrapped_over_many_turns():
    p = made("kepler", 0.6)
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
    assert kepler.growth(n / 2, found.phase) == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize("power", [0.5, 1.0, 2.0])
def test_growth_of_an_oscillating_error(power):
    t = np.arange(1, 20_001) / 2
    assert kepler.growth(t, 1e-9 * t**power * np.cos(1.7 * t)) == pytest.approx(power, abs=0.05)
    assert kepler.growth(t, np.zeros(len(t))) is None


def test_a_run_that_fails_says_so():
    p = made("kepler", 0.9)
    truth = kepler.truth(p)
    run, rows = kepler.follow(integrator("stormer-verlet"), p, truth, 20, 30)
    assert run["status"] == "collision"
    assert run["reason"]
    assert all(r["orbits"] <= run["reached"] for r in rows)
    p = made("kepler", 0.6)
    run, rows = kepler.follow(integrator("explicit-euler"), p, kepler.truth(p), 60, 30)
    assert run["status"] == "diverged"
    assert "no bound orbit" in run["reason"]
    assert run["reached"] < 30
    run, rows = kepler.follow(integrator("scheme-iii", lam="0"), p, kepler.truth(p), 200, 30)
    assert run["status"] == "ok"
    assert [r["orbits"] for r in rows] == [1.5, 3.5, 10.5, 30.5]


def test_bad_input_is_named():
    p = made("kepler", 0.6)
    with pytest.raises(InvalidInput, match="per_orbit is 15; it must be even"):
        kepler.follow(integrator("stormer-verlet"), p, kepler.truth(p), 15, 3)
    with pytest.raises(InvalidInput, match="states in the plane"):
        kepler.elements(np.ones((2, 3)), np.ones((2, 3)))
    with pytest.raises(InvalidInput, match="no bound orbit"):
        kepler.exact_orbit((1.0, 0.0), (0.0, 1.5))
    with pytest.raises(InvalidInput, match="no bound orbit"):
        kepler.exact_orbit((0.1, 0.0), (0.0, 1.0), 0.05)
    assert np.isnan(kepler.elements([[1.0, 0.0]], [[0.0, 1.5]]).anomaly).all()


def test_the_page_is_written_from_few_rows(tmp_path, monkeypatch):
    ours = integrator("scheme-iii", lam="0")
    monkeypatch.setattr(comparison, "GROUPS", {"low order": (ours, integrator("heyoka"))})
    monkeypatch.setattr(comparison, "ORBITS", 10)
    monkeypatch.setattr(comparison, "YARDSTICKS", (integrator("heyoka"),))
    comparison._yardstick.cache_clear()
    cells = [c for c in comparison.cells() if (c.key["problem"], c.key["e"]) == ("perturbed-kepler", 0.6)]
    measured = [c() for c in cells]
    comparison._yardstick.cache_clear()
    tables = {n: pd.DataFrame([r for rows in measured for r in rows[n]]) for n in ("kepler", "kepler_growth")}
    assert not bench_kepler.away(tables["kepler_growth"].to_dict("records"))
    failed = tables["kepler"].iloc[-1:].assign(method="nobody", status="diverged", reason="it fell", reached=0.0)
    tables["kepler"] = pd.concat([tables["kepler"], failed])
    said = " ".join(v.text for v in PAGE.judged(tables.get))
    assert "1 of 5 runs do not get through" in said
    assert "heyoka (adaptive)" in set(PAGE.table(tables.get).frame["peers"])
    assert "nobody" in set(PAGE.whole(tables.get)["method"])
    (picture,) = PAGE.figures(tables.get, tmp_path / "figures")
    assert (tmp_path / "figures" / picture.file).exists()
    row = tables["kepler"].set_index(["method", "setting"]).loc[("heyoka", "adaptive")]
    assert abs(row["advance error"]) < 1e-12 < abs(tables["kepler"]["advance error"].iloc[1])
    assert PAGE.judged(lambda name: None) == []


def test_verdicts_of_fabricated_rows():
    rows = [
        {"problem": "kepler", "e": 0.2, "kind": "reference", "phase": 1e-8},
        {"problem": "kepler", "e": 0.2, "kind": "phasebench", "phase": 1e-3},
        {"problem": "kepler", "e": 0.6, "kind": "phasebench", "phase": 1e-9},
    ]
    (said,) = bench_kepler.away(rows)
    assert "e = 0.2" in said
    assert "1.00e-08" in said
    (said,) = bench_kepler.nobody(rows[1:], "phase", "{problem}, e = {e}")
    assert said == "kepler, e = 0.2: the best phase is 1.00e-03"
