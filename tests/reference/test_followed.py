"""References at any time, followed in long double: uncertainties checked with 240 bits, horizons, second solver."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.measure import global_error as against
from phasebench.benchmarks.measure import truths
from phasebench.benchmarks.measure.quantities import END_STATE
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.user import from_formula
from phasebench.benchmarks.studies import references
from phasebench.integrators import integrate
from phasebench.reference.certificates import followed, horizon, stored
from phasebench.reference.solvers import gauss, taylor

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


def test_a_series_that_misses_the_wall_is_rejected():
    """Both runs agree on a free fall through the wall; the energy shows the error."""
    with pytest.raises(taylor.ReferenceFailed, match="lost the energy"):
        followed._sound(WALL, np.array([[3 - 5.0**2 / 2, -5.0]], dtype=np.longdouble), [5.0], "the run")
    right = np.array([[3 - 1.0 / 2, -1.0]], dtype=np.longdouble)
    assert followed._sound(WALL, right, [1.0], "the run") is right


def test_a_failure_of_both_solvers_is_reported(monkeypatch):
    def cannot(*of):
        raise taylor.ReferenceFailed("no solution")

    monkeypatch.setattr(gauss, "run", cannot)
    with pytest.raises(taylor.ReferenceFailed, match=r"failed to t = 4: .*lost the energy.*; no solution"):
        followed.follow(WALL, [4.0])
    found = against.end_error(WALL, integrate(WALL, "gauss-4", h=0.01, t_end=4.0), 4.0)
    assert found["global_error"] is None
    assert "the reference failed" in found["reference"]["reason"]
