"""References at any time, followed in long double: uncertainties checked with 240 bits, horizons, second solver."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.measure import global_error as against
from phasebench.benchmarks.measure import truths
from phasebench.benchmarks.measure.quantities import END_STATE
from phasebench.benchmarks.problems import labels, problem
from phasebench.benchmarks.problems.user import from_formula
from phasebench.benchmarks.studies import references
from phasebench.integrators import integrate
from phasebench.reference.certificates import followed, horizon, stored
from phasebench.reference.solvers import gauss, taylor

#: An orbit with an exactly unstable start: both runs make the same first rounding error, which grows.
SPHERE = "schwarzschild:photon-sphere"
SAMPLE = (SPHERE, "henon-heiles:chaotic", "schwarzschild:isco", "quadrupole-boson:h20")
#: H of a particle and a wall; at q = 3 the wall's terms are too small for a Taylor series to notice.
WALL = "p**2/2 + exp(-40*q) + q"


@pytest.mark.processor
@pytest.mark.parametrize("label", SAMPLE)
def test_uncertainties_at_arbitrary_times_hold(label):
    """The stated uncertainty bounds the error at a few of the times that the experiment's page has."""
    made = problem(label)
    rows = references.errors(made, references.times(made)[:: references.TIMES // 4])
    for r in rows:
        assert r["error"] <= r["uncertainty"]
        bare = truths.SAFETY * r["two runs"] + truths.GROWN * r["rounding"]
        assert r["long double"] <= bare, "of the long double run itself, without the rounding to doubles"
        assert r["bits"] == 240
        assert not r["early"] or r["uncertainty"] < 1e-11 * r["size"], "a bound that says something"


def test_control_two_runs_alone_do_not_bound_the_error():
    rows = references.errors(problem(SPHERE), [30.3, 36.0])
    assert all(r["long double"] > 20 * truths.SAFETY * r["two runs"] for r in rows)
    assert all(r["error"] > truths.SAFETY * r["two runs"] + 2.0**-52 * r["size"] for r in rows)
    assert all(r["error"] <= r["uncertainty"] for r in rows)


def test_arbitrary_times_are_not_certified_ones():
    for label in labels():
        made = problem(label)
        at = references.times(made)
        assert len(at) == len(set(at)) == 20
        assert not set(at) & set(made.start.times)
        assert 0 < at[0] < at[-1] < made.start.times[-1]
    assert references.times(problem("kepler")) != references.times(problem(SPHERE))


@pytest.mark.parametrize(("lam", "t"), [(1.0, 12.0), (2.0, 7.0)])
def test_a_saddle_magnifies_rounding_errors(lam, t):
    """Towards a saddle, q = -p/lam, a displacement u of q or p grows to about u exp(lam t) / 2."""
    made = from_formula(f"p**2/2 - {lam!r}**2*q**2/2", [1.0], [-lam], {})
    grown = truths.truth(made, END_STATE, t).rounding
    expected = horizon.UNIT * np.exp(lam * t) / 2 * max(1.0, lam)
    assert 0.1 * expected < grown < 10 * expected


def test_a_stable_orbit_is_exact_to_double_rounding():
    made = problem("harmonic-oscillator")
    found = truths.truth(made, END_STATE, 33.3)
    assert found.uncertainty < 2 * 2.0**-52 * np.abs(found.values).max()


# -- the horizon -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("t_end", [150.0, 1e4])
def test_the_horizon_is_found_for_any_span(t_end):
    """For an orbit without certificate: within the interval of the stored horizon of the same orbit."""
    made = problem("henon-heiles:chaotic")
    known = stored.find(made)
    reach = followed.reach(against.with_start(made, made.q0, made.p0), t_end)
    assert known.earliest <= reach <= known.latest


def test_a_regular_orbit_is_followed_to_the_end():
    assert followed.reach(problem("henon-heiles:box"), 33.3) == 33.3


def test_the_horizon_ends_where_the_runs_part():
    """Control: runs that differ by more than the limit end the horizon, however small the growth of rounding errors."""
    rows = np.array([[1.0, 0.0]] * 3, dtype=np.longdouble)
    other = rows + np.array([[0.0, 0.0], [2e-13, 0.0], [0.0, 0.0]])
    runs = followed.FollowedOrbit(followed.TAYLOR, np.array([1.0, 2.0, 3.0]), rows, other, [rows])
    assert runs.until() == 1.0
    assert runs._replace(other=rows).until() == 3.0
    assert runs._replace(other=rows, displaced=[rows + 1e-8]).until() == 0.0


# -- second solver
# -----------------------------------------------------------------------------------------------------


def wall(q: float):
    """The problem of the wall (a potential `WALL` of one coordinate), started at rest at q."""
    return from_formula(WALL, [q], [0.0], {})


def test_gauss_replaces_a_failing_taylor_series():
    made = wall(3.0)
    with pytest.raises(taylor.ReferenceFailed, match="lost the energy"):
        followed._taylor(made, np.array([4.0]))
    found = truths.truth(made, END_STATE, 4.0)
    assert found.source == followed.GAUSS
    q, p = found.values
    assert abs(p**2 / 2 + np.exp(-40 * q) + q - 3.0) < 1e-14
    assert q > 0, "it has bounced"
    assert 0 < found.uncertainty < 1e-13
    # Independent check: at rest at t = T / 2 after the bounce, it falls as it came: q(T - t) = q(t) = 3 - t^2/2.
    again = truths.truth(made, END_STATE, 4.0 - 0.5).values
    rest = 4.0 + p
    assert abs(q - (3 - p**2 / 2)) < 1e-13
    assert abs(again[0] - (3 - (rest - 3.5) ** 2 / 2)) < 1e-13


def test_a_series_that_misses_the_wall_is_rejected():
    """Both runs agree on a free fall through the wall; the energy shows the error."""
    made = wall(3.0)
    lost = np.array([[3 - 5.0**2 / 2, -5.0]], dtype=np.longdouble)
    with pytest.raises(taylor.ReferenceFailed, match="lost the energy"):
        followed._sound(made, lost, [5.0], "the run")
    right = np.array([[3 - 1.0 / 2, -1.0]], dtype=np.longdouble)
    assert followed._sound(made, right, [1.0], "the run") is right


def test_a_failure_of_both_solvers_is_reported(monkeypatch):
    def cannot(*of):
        raise taylor.ReferenceFailed("no solution")

    monkeypatch.setattr(gauss, "run", cannot)
    with pytest.raises(
        taylor.ReferenceFailed, match=r"the reference failed to t = 4: .*lost the energy.*; no solution"
    ):
        followed.follow(wall(3.0), [4.0])
    fall = integrate(wall(3.0), "gauss-4", h=0.01, t_end=4.0)
    found = against.end_error(wall(3.0), fall, 4.0)
    assert found["global_error"] is None
    assert "the reference failed" in found["reference"]["reason"]


def test_gauss_accepts_displaced_starts():
    made = problem("harmonic-oscillator")
    moved = gauss.run(made.system, made.q0, made.p0, [0.5, 1.0], [1.0], lambda y: y * (1 + 2.0**-40))
    still = gauss.run(made.system, made.q0, made.p0, [0.5, 1.0], [1.0])
    assert moved[0] == pytest.approx(still[0] * (1 + 2.0**-39), rel=1e-14, abs=1e-14)
    assert np.abs(moved - still).max() > 1e-12
