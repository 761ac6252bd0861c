"""Printed numbers: the solar system's orbits, measures against closed forms, verdicts that change with their rows."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.experiments.printed_numbers import (
    bench_printed_numbers,
    brouwer,
    claims,
    minimum_norm,
    page,
    planets,
    timed,
)
from phasebench.benchmarks.experiments.printed_numbers.minimum_norm import LEAPFROG, MINIMUM_NORM, MOMENTA, POSITIONS
from phasebench.benchmarks.measure.energy import energy_error
from phasebench.benchmarks.page.page import ANSWER, CLAIM, ROWS
from phasebench.benchmarks.page.verdict import FINDING, MISSING, PASS
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.solar_system import PLANETS
from phasebench.integrators.driver import integrate

SOLAR = problem("solar-system")


def start():
    """The initial state, arrays (1, 27)."""
    return np.array([SOLAR.q0]), np.array([SOLAR.p0])


# -- the problem ------------------------------------------------------------------------------------------------------


def test_the_solar_system_has_the_published_elements():
    given = [float(row[1]) for row in PLANETS.values()]
    np.testing.assert_allclose(SOLAR.bodies.semi_axes(), given, rtol=1e-14)
    perihelia = np.degrees(planets.longitudes(SOLAR, *start())[:, 0])
    off = (perihelia - [float(row[5]) for row in PLANETS.values()] + 180) % 360 - 180
    assert np.abs(off).max() < 0.25  # projected into the ecliptic: inc^2 / 4
    assert np.abs(off[2]) < 1e-6, "the Earth's orbit lies in the ecliptic"


#: The rates of the mean longitudes that JPL publishes beside the elements, degrees a century; not used in the problem.
RATES = (149472.67411175, 58517.81538729, 35999.37244981, 19140.30268499, 3034.74612775, 1222.49362201, 428.48202785)
RATES += (218.45945325,)


def test_published_rates_of_longitudes_are_the_orbits_mean_motions():
    """Kepler's third law gives JPL's rates from its semi-major axes: a wrong digit of an axis shows."""
    G, masses = SOLAR.bodies.units.G, np.array(SOLAR.bodies.masses)
    a = np.array(SOLAR.bodies.semi_axes())
    motions = np.degrees(np.sqrt(G * (1 + masses[1:]) / a**3)) * 36525
    np.testing.assert_allclose(motions[:4], RATES[:4], rtol=2e-5)
    np.testing.assert_allclose(motions[4:], RATES[4:], rtol=3e-3)


def test_the_earth_is_where_it_was_at_j2000():
    """The Astronomical Almanac: longitude 100.38 degrees, 0.98333 AU from the Sun, shortly before the perihelion."""
    earth = np.array(SOLAR.q0[9:12]) - SOLAR.q0[:3]
    assert np.degrees(np.arctan2(earth[1], earth[0])) == pytest.approx(100.38, abs=0.02)
    assert np.linalg.norm(earth) == pytest.approx(0.98333, abs=2e-4)


def test_the_barycentre_of_the_solar_system_rests():
    masses = np.repeat(SOLAR.bodies.masses, 3)
    assert np.abs(np.sum((masses * SOLAR.q0).reshape(-1, 3), axis=0)).max() < 1e-17
    assert np.abs(np.sum(np.reshape(SOLAR.p0, (-1, 3)), axis=0)).max() < 1e-19
    assert np.abs(np.sum(np.reshape(SOLAR.q0, (-1, 3)), axis=0)).max() > 1e-3, "the control: unweighted"


def test_wisdom_holman_keeps_the_planets_for_a_decade():
    s = integrate(SOLAR, "wisdom-holman", h=6.0, steps=600, save_every=60)
    assert s.status == "ok"
    assert 1e-11 < energy_error(SOLAR, s.q, s.p) < 1e-8


# -- measures ---------------------------------------------------------------------------------------------------------


def test_perihelia_turn_with_the_planes():
    """A rotation about the ecliptic's axis adds to every longitude, a scaling to none."""
    q, p = start()
    c, s = np.cos(0.3), np.sin(0.3)
    turn = np.kron(np.eye(9), [[c, -s, 0], [s, c, 0], [0, 0, 1]])
    before, after = planets.longitudes(SOLAR, q, p), planets.longitudes(SOLAR, q @ turn.T, p @ turn.T)
    np.testing.assert_allclose((after - before - 0.3 + np.pi) % (2 * np.pi), np.pi, atol=1e-12)


def test_a_rate_is_in_seconds_of_arc_a_year():
    t = np.linspace(0, 1000 * planets.YEAR, 50)
    assert planets.rate(t, 1.0 + np.radians(5.0 / 3600) * t / planets.YEAR) == pytest.approx(5.0, rel=1e-9)


def rms_of_oscillator(id: str, h: float, steps: int) -> float:
    """The rms of Delta H on the harmonic oscillator: z'(M'M - 1)z / 2 for Gaussian z, from the step's matrix alone."""
    lam = 0.19318332750378357396
    substeps = [("A", 0.5), ("B", 1.0), ("A", 0.5)]
    if id == MINIMUM_NORM:
        substeps = [("A", lam), ("B", 0.5), ("A", 1 - 2 * lam), ("B", 0.5), ("A", lam)]
    step = np.eye(2)
    for letter, c in substeps:
        step = (np.array([[1, c * h], [0, 1]]) if letter == "A" else np.array([[1, 0], [-c * h, 1]])) @ step
    M = np.linalg.matrix_power(step, steps)
    S = M.T @ M - np.eye(2)
    return float(np.sqrt((2 * np.trace(S @ S) + np.trace(S) ** 2) / 4))


@pytest.mark.parametrize("id", [LEAPFROG, MINIMUM_NORM])
@pytest.mark.parametrize("first", [POSITIONS, MOMENTA])
def test_rms_on_the_oscillator_is_that_of_the_step_matrix(id, first):
    d, weights = minimum_norm.jumps("oscillator", id, first, 1.0, 8)
    assert np.sqrt(weights @ d**2) == pytest.approx(rms_of_oscillator(id, 1 / 8, 8), rel=1e-9)
    assert weights @ np.expm1(-d) == pytest.approx(0, abs=1e-12)


def test_the_rule_for_averages_has_the_moments():
    q, p, weights = minimum_norm.states("anharmonic")
    x = np.linspace(-8, 8, 20001)
    density = np.exp(-minimum_norm.potential("anharmonic", x))
    assert weights @ q**2 == pytest.approx((density @ x**2) / density.sum(), rel=1e-4)
    assert weights @ p**4 == pytest.approx(3.0, rel=1e-9)


def test_exponents_of_random_walks_and_of_lines():
    random = np.random.default_rng(1)
    a, low, high = brouwer.exponent(np.cumsum(random.normal(size=(64, 100)), axis=1))
    assert low < 0.5 < high
    assert abs(a - 0.5) < 0.12
    line, low, high = brouwer.exponent(np.outer(random.uniform(1, 2, 64), np.arange(1, 101)))
    assert line == pytest.approx(1.0)
    assert low == pytest.approx(high)


def test_short_runs_grow_by_round_off_and_by_truncation(monkeypatch):
    monkeypatch.setattr(brouwer, "STARTS", 4)
    ours, control = (np.abs(brouwer.errors(*run, orbits=100)).max() for run in (("gauss-8", None), brouwer.CONTROL))
    assert ours < 1e-14
    assert control > 1e-12


# -- verdicts ---------------------------------------------------------------------------------------------------------


def evaluation_rows() -> pd.DataFrame:
    """The best needs more at 1e-8 and fewer at 1e-14."""
    at = {planets.BEST: ((2000, 1e-7), (4000, 1e-15)), "wisdom-holman": ((1000, 1e-9), (8000, 1e-14))}
    return pd.DataFrame(
        [
            {"method": id, "evaluations": n, "energy error": e, "position error": e}
            for id, members in at.items()
            for n, e in members
        ]
    )


def test_the_preference_is_judged_at_the_smallest_error():
    rows = evaluation_rows()
    data = {planets.EVALUATIONS: rows}.get
    found = claims.preference(data)
    assert (found.outcome, found.measured) == (PASS, 2.0)
    larger = claims.everywhere(data)
    assert (larger.outcome, larger.measured.low) == (FINDING, 0.25)
    assert claims.by_state(data).outcome == FINDING
    rows.loc[rows["evaluations"] == 8000, "evaluations"] = 3999
    assert claims.preference(data).outcome == FINDING
    rows.loc[rows["method"] == planets.BEST, "evaluations"] = 10
    assert (claims.everywhere(data).outcome, claims.by_state(data).outcome) == (PASS, PASS)


def perihelion_rows(corrected: float, saba: float = 1e-9) -> pd.DataFrame:
    """Rate errors of WHFast 1e-6, with the corrector and of SABAC2 as given; energies 1e-9 and 1e-12."""
    size = {planets.PLAIN: (1e-9, 1e-6), planets.CORRECTED: (1e-12, corrected), "rebound-saba-cm-2": (1e-12, saba)}
    return pd.DataFrame(
        [
            {"method": id, "planet": name, "energy error": e, "rate error": r, "uncertainty": 1e-11}
            for id, (e, r) in size.items()
            for name in PLANETS
        ]
    )


@pytest.mark.parametrize(("corrected", "outcome"), [(-1e-6, PASS), (2e-6, PASS), (-2e-7, FINDING)])
def test_correctors_are_judged_by_the_rates(corrected, outcome):
    data = {planets.PERIHELIA: perihelion_rows(corrected)}.get
    assert claims.inner(data).outcome == claims.giants(data).outcome == outcome
    assert claims.energies(data).measured == pytest.approx(1000)
    assert claims.energies(data).outcome == PASS
    alike = perihelion_rows(corrected).assign(**{"energy error": 1e-9})
    assert claims.energies({planets.PERIHELIA: alike}.get).outcome == FINDING
    assert claims.same_energy(data).outcome == PASS
    assert claims.same_energy({planets.PERIHELIA: perihelion_rows(1e-6, 1e-6)}.get).outcome == FINDING


def norm_rows(ratio: float) -> pd.DataFrame:
    """Rms errors h^2 of leapfrog and h^2 / ratio of the other."""
    return pd.DataFrame(
        [
            {"potential": name, "method": id, "first": first, "length": length, "h": 1 / n, "rms": s / n**2, "off": 0.0}
            for name in minimum_norm.POTENTIALS
            for id, s in ((LEAPFROG, 1.0), (MINIMUM_NORM, 1 / ratio))
            for first in (POSITIONS, MOMENTA)
            for length in minimum_norm.LENGTHS
            for n in (4, 8, 16, 32, 64)
        ]
    )


def test_steps_and_efficiency_follow_from_the_ratio():
    data = {minimum_norm.TABLE: norm_rows(9.0)}.get
    assert claims.anharmonic(data).measured.low == pytest.approx(9.0)
    assert claims.step(data).measured.high == pytest.approx(3.0)
    assert claims.efficiency(data).measured.low == pytest.approx(50.0)
    assert {f(data).outcome for f in (claims.anharmonic, claims.step, claims.efficiency)} == {PASS}
    far = {minimum_norm.TABLE: norm_rows(40.0)}.get
    four = (claims.anharmonic, claims.gaussian, claims.step, claims.efficiency)
    assert {f(far).outcome for f in four} == {FINDING}
    assert claims.gaussian(data).outcome == PASS


def law_rows(a: float) -> pd.DataFrame:
    """A row of IAS15 with an exponent and an interval of 0.05 on both sides."""
    row = {"integrator": "rebound-ias15", "tolerance": np.nan, "starts": 24, "orbits": 10, "rms": 1e-14, "bias": 0.1}
    return pd.DataFrame([row | {"exponent": a, "low": a - 0.05, "high": a + 0.05}])


@pytest.mark.parametrize(("a", "outcome"), [(0.5, PASS), (0.46, PASS), (0.44, FINDING), (0.56, FINDING)])
def test_brouwers_law_is_judged_on_both_sides(a, outcome):
    assert claims.ias15({brouwer.TABLE: law_rows(a)}.get).outcome == outcome
    assert claims.heyoka({brouwer.TABLE: law_rows(a)}.get) is None
    assert claims.heyoka({brouwer.TABLE: law_rows(a).assign(integrator="heyoka")}.get).outcome == outcome


def timed_rows(gain: float) -> dict[str, pd.DataFrame]:
    """Rows of WHFast512 and of TRACE with the same gain."""
    vectors = [{"corrector": "without", "h": 3.0, "gain": gain, "low": gain, "high": gain}]
    ids = ((timed.TRACE, 1.0), *((id, gain) for id in timed.RIVALS))
    encounters = [{"integrator": id, "times TRACE": x, "energy error": 1e-5} for id, x in ids]
    return {timed.VECTORS: pd.DataFrame(vectors), timed.ENCOUNTERS: pd.DataFrame(encounters)}


def test_speed_ups_are_met_within_a_factor():
    known, slow = timed_rows(7.0).get, timed_rows(1.0).get
    assert claims.vectors(known).outcome == PASS
    assert claims.mercurius(timed_rows(12.0).get).outcome == PASS
    assert claims.trace(timed_rows(15.0).get).outcome == PASS
    assert {f(slow).outcome for f in (claims.vectors, claims.mercurius, claims.trace)} == {FINDING}


def test_the_page_has_every_printed_number_and_tells_what_is_missing():
    data = {minimum_norm.TABLE: norm_rows(9.0), **timed_rows(5.0)}.get
    frame = page.table(data).frame
    assert len(frame) == len(claims.PRINTED) + 1 <= ROWS
    assert (frame["outcome"] == MISSING).sum() == len(claims.PRINTED) - 7
    assert len(page.answer(data).split()) <= ANSWER
    assert page.answer(lambda name: None) is page.table(lambda name: None) is None
    for one in claims.PRINTED:
        found = one.verdict(data)
        assert found is None or len(found.claim.split()) <= CLAIM


def test_checks_find_what_is_wrong():
    assert not bench_printed_numbers.rates_off(perihelion_rows(1e-6).to_dict("records"))
    rough = perihelion_rows(1e-6).assign(uncertainty=1e-7)
    assert len(bench_printed_numbers.rates_off(rough.to_dict("records"))) == len(rough)
    rows = [{"integrator": "heyoka", "tolerance": tol, "exponent": a} for tol, a in ((None, 0.5), (1e-9, 1.0))]
    assert not bench_printed_numbers.exponents_off(rows)
    assert len(bench_printed_numbers.exponents_off([row | {"exponent": 0.7} for row in rows])) == 1
    good = norm_rows(9.0).to_dict("records")
    assert not bench_printed_numbers.rules_off(good)
    assert len(bench_printed_numbers.rules_off([row | {"off": 0.01} for row in good])) == len(good)


def test_heavier_giants_are_the_giants_of_the_solar_system():
    made = timed.heavier()
    assert made.bodies.names == ("sun", *timed.GIANTS)
    assert made.bodies.masses[1] == pytest.approx(timed.HEAVIER / PLANETS["jupiter"][0])
