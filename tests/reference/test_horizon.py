"""How long an orbit is followed, how neighbours part, how far other solvers are believed; references at any time."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from phasebench.benchmarks.measure import global_error as against
from phasebench.benchmarks.measure import truths
from phasebench.benchmarks.measure.quantities import END_STATE
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.user import from_formula
from phasebench.benchmarks.studies import references
from phasebench.integrators import Hamiltonian, InvalidInput, integrate
from phasebench.reference.certificates import along, check, followed, horizon, make, others, stored
from phasebench.reference.solvers import gauss, taylor

PRECISION = along.Precision(200, "1e-58")
OSCILLATOR = Hamiltonian(q="q", p="p", H="p**2/2 + q**2/2")


def about(value, rel: float = 1e-6):
    return pytest.approx(value, rel=rel, abs=0)


def fake_problem(system=OSCILLATOR) -> SimpleNamespace:
    """Stand-in for a problem at rest at q = 1."""
    return SimpleNamespace(system=system, q0=(1.0,) * system.d, p0=(0.0,) * system.d)


def path(grid, rows=None) -> along.Along:
    """An orbit on a grid of times, at rest at (1, 0) or with these rows as decimal strings."""
    number = taylor.Bits(PRECISION.bits)
    rows = [[number(x) for x in row] for row in (rows or [["1", "0"]] * len(grid))]
    return along.Along(PRECISION, list(grid), rows, np.array([[1.0, 0.0]] * len(grid)), np.ones(len(grid)))


# -- an orbit on a grid -----------------------------------------------------------------------------------------------


def test_the_grid_divides_the_span_and_contains_the_times(monkeypatch):
    monkeypatch.setattr(
        taylor, "states", lambda system, fp, q, p, times, tol=None: np.array([[t, -2 * t] for t in times])
    )
    found = along.along(fake_problem(), [0.3, 2.0], PRECISION, 4)
    assert found.grid == [0.3, 0.5, 1.0, 1.5, 2.0]
    assert found.size.tolist() == [0.6, 1.0, 2.0, 3.0, 4.0]
    assert found.row(1.5).tolist() == [1.5, -3.0]
    assert along.along(fake_problem(), [0.7], PRECISION, 1).grid == [0.7]
    for times in ([], [0.0, 1.0], [-1.0], [2.0, 1.0], [1.0, 1.0], [1.0, float("inf")], [float("nan"), 1.0]):
        with pytest.raises(InvalidInput, match="positive, finite and increase"):
            make.certify(fake_problem(), times)


def test_distances_and_errors_are_running_maxima():
    rows = np.array([[1.0, 0.1], [0.5, 0.2], [1.2, -0.3]])
    assert path([1.0, 2.0, 3.0]).distances(rows) == about([0.1, 0.5, 0.5])
    digits = [("1.0000000000000000000000000000000001", "0"), ("1", "0"), ("1", "0.0000000000000000000000000000000003")]
    assert make.errors(digits, [1.0, 2.0, 4.0], path([1.0, 2.0, 4.0])) == about([1e-34, 1e-34, 3e-34], rel=1e-9)


def test_growth_is_algebraic_or_exponential():
    """Fitted over the later three quarters of the time until the neighbour is lost; NaN for one that has not moved."""
    grid, size = np.arange(1.0, 101.0), np.ones(100)
    assert horizon.growth(grid, 1e-12 * grid**2, size) == (about(2.0), None)
    exponent, rate = horizon.growth(grid, 1e-12 * np.exp(0.1 * grid), size)
    assert (exponent, rate) == (about(7.5 / np.log(4)), about(0.1))
    lost = np.where(grid <= 40, 1e-12 * grid**2, 1.0)
    assert horizon.growth(grid, lost, size) == (about(2.0), None), "what comes behind does not count"
    assert np.isnan(horizon.growth(grid, np.where(grid <= 60, 0.0, 1e-12), size)[0])
    fine = np.linspace(0.1, 40.0, 400)
    until = np.log(horizon.LOST * 1e-4 / 1e-12) / 0.7
    exponent, rate = horizon.growth(fine, 1e-12 * np.exp(0.7 * fine), np.full(400, 1e-4))
    assert exponent == about(0.7 * until * 0.75 / np.log(4), rel=0.02), "the distance is lost relative to the size"
    assert rate == about(0.7)


def test_rounding_errors_of_start_and_steps_add_up():
    """After n steps, n + 1 numbers have been added, uniform up to one unit: a random walk."""
    made, grid = fake_problem(), [1e-3, 30.0, 300.0]
    ends = taylor.step_ends(OSCILLATOR, np.longdouble, made.q0, made.p0, grid[-1])
    added = np.array([1 + sum(x <= t for x in ends) for t in grid])
    found = horizon.rounding(made, grid, draws=100)
    assert 0.9 < found.distances[:, 0].max() / horizon.UNIT <= 1.001
    spread = np.median(found.distances, axis=0) / horizon.UNIT / np.sqrt(added / 3)
    assert ((spread > 0.5) & (spread < 1.2)).all()


# -- horizons ---------------------------------------------------------------------------------------------------------

CHAOTIC = problem("henon-heiles:chaotic")
GRID = [150.0 * (i + 1) / 200 for i in range(200)]


def test_the_horizon_ends_before_the_limit_is_first_exceeded():
    grid, size = [1.0, 2.0, 3.0, 4.0], np.array([1.0, 1.0, 10.0, 1.0])
    for distances, t in (
        ((0.0, 0.1, 1.0, 0.1), 4.0),  # relative to the size, and the limit itself is within
        ((0.0, 0.2, 0.0, 0.0), 1.0),
        ((0.0, 0.0, 0.5, 0.2), 3.0),
        ((0.2, 0.0, 0.0, 0.0), 0.0),
        ((np.nan, 0.0, 0.0, 0.0), 0.0),
    ):
        assert horizon.within(grid, np.array(distances), size, 0.1) == t


def test_the_horizon_for_exponential_growth():
    """Distances grow as exp(rate t) from normally distributed draws, so the times are known in closed form."""
    rate, grid = 0.1, [0.1 * i for i in range(1, 2400)]
    sizes = np.abs(np.random.default_rng(1).normal(size=1001))
    made = horizon.Rounding(grid, np.ones(len(grid)), horizon.UNIT * sizes[:, None] * np.exp(rate * np.array(grid)))
    span, scale = made.span(), np.log(1e-13 / horizon.UNIT)
    for t, quantile in zip(span, (0.6745, 2.2414, 0.03134), strict=True):
        assert t == pytest.approx((scale - np.log(quantile)) / rate, abs=1.5)
    low, high = made.band
    assert all(a < t < b for a, t, b in zip(low, span, high, strict=True))
    assert high.horizon - low.horizon == pytest.approx(0.04 / rate + 0.2, abs=0.21)
    never = horizon.Rounding([1.0, 2.0], np.ones(2), np.ones((1, 2)))
    assert (never.band[0].horizon, never.band[1].horizon) == (0.0, 1.0)


def test_the_stored_horizon_is_that_of_the_problem_whatever_simulates_it():
    """In its band for another displacement and tolerance; its interval covers single runs, with other seeds too."""
    known, chaotic = stored.find(CHAOTIC), horizon.rounding(CHAOTIC, GRID)
    span, (low, high) = chaotic.span(), chaotic.band
    assert low.horizon - known.spacing <= known.horizon <= high.horizon + known.spacing
    assert known.limit == horizon.LIMIT == 1e-13
    assert high.horizon - low.horizon < 3.0
    other = horizon.rounding(CHAOTIC, GRID, horizon.OTHER)
    assert all(a <= t <= b for a, t, b in zip(low, other.span(), high, strict=True))
    assert np.abs(other.distances[:, 60] / chaotic.distances[:, 60] - 1).max() < 1e-3
    again = horizon.rounding(CHAOTIC, GRID, seed=7)
    leaves = [horizon.within(GRID, distance, again.size) for distance in again.distances]
    assert np.mean([span.earliest <= t <= span.latest for t in leaves]) >= 0.85
    assert np.mean([abs(t - span.horizon) < 1.0 for t in leaves]) < 0.5  # control: one run is not the horizon
    assert again.span().horizon == pytest.approx(span.horizon, abs=3.0)


# -- other solvers ----------------------------------------------------------------------------------------------------


def test_round_off_off_the_manifold_is_in_a_solvers_uncertainty():
    """Gauss's distance was 0.8 or 1.6 of it, by processor, while only neighbours on the manifold counted."""
    made = problem("spherical-pendulum")
    orbit = along.along(made, made.start.times, check.AGAIN)
    on = horizon.neighbour(made, orbit.grid, orbit.near)
    off = horizon.neighbour(made, orbit.grid, orbit.near, everywhere=True)
    middle = np.searchsorted(orbit.grid, orbit.grid[-1] / 4)
    assert off[-1] / off[middle] == pytest.approx(16, rel=0.2)
    assert on[-1] / on[middle] < 6
    said = [gauss for (gauss,) in others.words(made, made.start.times, orbit, on)]
    assert all(4 * gauss.distance < gauss.uncertainty for gauss in said)
    assert said[-1].uncertainty < 100 * said[-1].distance, "so large an uncertainty would hide a wrong solver"


def test_gauss_and_ias15_agree_within_uncertainties_that_say_something():
    made = problem("henon-heiles:box")
    orbit = along.along(made, [2.0, 10.0], PRECISION, 20)
    apart = horizon.neighbour(made, orbit.grid, orbit.near)
    for checks in others.words(made, [2.0, 10.0], orbit, apart):
        assert [c.solver for c in checks] == [others.GAUSS, others.IAS15]
        assert all(c.distance <= c.uncertainty <= 1e3 * c.distance for c in checks)


def test_a_solvers_uncertainty_is_of_the_largest_difference_so_far():
    assert others.uncertainty([1.0, 3.0, 2.0], np.array([0.1, 0.2, 0.3])).tolist() == [4.1, 12.2, 12.3]


# -- references at any time, followed in long double -------------------------------------------------------------------


#: An orbit with an exactly unstable start: both runs make the same first rounding error, which grows.
SPHERE = "schwarzschild:photon-sphere"


@pytest.mark.processor
@pytest.mark.parametrize("label", [SPHERE, "henon-heiles:chaotic"])
def test_uncertainties_at_arbitrary_times_hold(label):
    """The stated uncertainty bounds the error at a few of the times that the experiment's page has."""
    made = problem(label)
    for r in references.errors(made, references.times(made)[:: references.TIMES // 4]):
        assert r["error"] <= r["uncertainty"]
        bare = truths.SAFETY * r["two runs"] + truths.GROWN * r["rounding"]
        assert r["long double"] <= bare, "of the long double run itself, without the rounding to doubles"
        assert r["bits"] == 240
        assert not r["early"] or r["uncertainty"] < 1e-11 * r["size"], "a bound that says something"


def test_control_two_runs_alone_do_not_bound_the_error():
    for r in references.errors(problem(SPHERE), [30.3, 36.0]):
        assert r["long double"] > 20 * truths.SAFETY * r["two runs"]
        assert truths.SAFETY * r["two runs"] + 2.0**-52 * r["size"] < r["error"] <= r["uncertainty"]


@pytest.mark.parametrize(("lam", "t"), [(1.0, 12.0), (2.0, 7.0)])
def test_a_saddle_magnifies_rounding_errors(lam, t):
    """Towards a saddle, q = -p/lam, a displacement u of q or p grows to about u exp(lam t) / 2."""
    made = from_formula(f"p**2/2 - {lam!r}**2*q**2/2", [1.0], [-lam], {})
    expected = horizon.UNIT * np.exp(lam * t) / 2 * max(1.0, lam)
    assert 0.1 * expected < truths.truth(made, END_STATE, t).rounding < 10 * expected


def test_a_stable_orbit_is_exact_to_double_rounding():
    found = truths.truth(problem("harmonic-oscillator"), END_STATE, 33.3)
    assert found.uncertainty < 2 * 2.0**-52 * np.abs(found.values).max()


# -- the horizon -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("t_end", [150.0, 1e4])
def test_the_horizon_is_found_for_any_span(t_end):
    """For an orbit without certificate: within the interval of the stored horizon of the same orbit."""
    made = problem("henon-heiles:chaotic")
    known = stored.find(made)
    assert known.earliest <= followed.reach(against.with_start(made, made.q0, made.p0), t_end) <= known.latest
    assert followed.reach(problem("henon-heiles:box"), 33.3) == 33.3


def test_the_horizon_ends_where_the_runs_part():
    """Runs that differ by more than the limit end the horizon, however small the growth of rounding errors."""
    rows = np.array([[1.0, 0.0]] * 3, dtype=np.longdouble)
    other = rows + np.array([[0.0, 0.0], [2e-13, 0.0], [0.0, 0.0]])
    runs = followed.FollowedOrbit(followed.TAYLOR, np.array([1.0, 2.0, 3.0]), rows, other, [rows])
    assert runs.until() == 1.0
    assert runs._replace(other=rows).until() == 3.0
    assert runs._replace(other=rows, displaced=[rows + 1e-8]).until() == 0.0


# -- second solver ----------------------------------------------------------------------------------------------------

#: A particle and a wall, from rest; at q = 3 the wall's terms are too small for a Taylor series to notice.
WALL = from_formula("p**2/2 + exp(-40*q) + q", [3.0], [0.0], {})


def test_gauss_replaces_a_failing_taylor_series():
    with pytest.raises(taylor.ReferenceFailed, match="lost the energy"):
        followed._taylor(WALL, np.array([4.0]))
    found = truths.truth(WALL, END_STATE, 4.0)
    assert found.source == followed.GAUSS
    q, p = found.values
    assert abs(p**2 / 2 + np.exp(-40 * q) + q - 3.0) < 1e-14
    assert q > 0, "it has bounced"
    assert 0 < found.uncertainty < 1e-13
    # Independent check: at rest at t = T / 2 after the bounce, it falls as it came: q(T - t) = q(t) = 3 - t^2/2.
    again = truths.truth(WALL, END_STATE, 4.0 - 0.5).values
    assert abs(q - (3 - p**2 / 2)) < 1e-13
    assert abs(again[0] - (3 - (4.0 + p - 3.5) ** 2 / 2)) < 1e-13


def test_a_failure_of_both_solvers_is_reported(monkeypatch):
    def cannot(*of):
        raise taylor.ReferenceFailed("no solution")

    monkeypatch.setattr(gauss, "run", cannot)
    with pytest.raises(taylor.ReferenceFailed, match=r"failed to t = 4: .*lost the energy.*; no solution"):
        followed.follow(WALL, [4.0])
    found = against.end_error(WALL, integrate(WALL, "gauss-4", h=0.01, t_end=4.0), 4.0)
    assert found["global_error"] is None
    assert "the reference failed" in found["reference"]["reason"]
