"""Stated uncertainties bound the errors of references, horizons are correct, and `check` detects changed ones."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from phasebench.benchmarks.cli import app
from phasebench.benchmarks.problems import labels, problem
from phasebench.benchmarks.studies import references
from phasebench.reference.certificates import check, horizon, make, others, stored
from phasebench.reference.certificates.along import Precision, along
from phasebench.reference.solvers import taylor
from support.references import spoilt

#: Orbits whose error was once far above the uncertainty, which was then the distance of two quadruple-precision runs.
WORST = ("schwarzschild:photon-sphere", "schwarzschild:isco", "toda:three")
#: The orbit for the tests of checks: unstable, and cheap.
ORBIT = "schwarzschild:photon-sphere"
STILL_MORE = Precision(300, "1e-66")


def errors(made, ends, precision=STILL_MORE) -> list[float]:
    """Error of each certified state against a run with more bits."""
    times = [e.t for e in ends]
    rows = taylor.states(made.system, taylor.Bits(precision.bits), made.q0, made.p0, times, precision.tolerance)
    return [stored.distance(e.texts, map(str, row)) for e, row in zip(ends, rows, strict=True)]


# -- uncertainties ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("label", WORST)
def test_the_worst_states_are_within_half_their_uncertainty(label):
    made = problem(label)
    ends = stored.load(made)
    for end, error in zip(ends, errors(made, ends), strict=True):
        assert 2 * error <= end.uncertainty
    assert ends[-1].uncertainty <= 100 * error


@pytest.mark.parametrize("label", WORST[:2])
def test_a_newly_computed_bound_has_its_margin(label):
    made = problem(label)
    ends = stored.load(made)
    times = [e.t for e in ends]
    bounds = make.uncertainties(
        [e.texts for e in ends], times, along(made, times, make.PRECISION, 4), [horizon.UNIT] * len(ends)
    )
    assert all(
        2 * error <= bound <= 1e4 * error for error, bound in zip(errors(made, ends)[2:], bounds[2:], strict=True)
    )
    assert bounds == sorted(bounds)


def test_a_run_with_too_few_bits_is_refused():
    """Also refused: growth of round-off beyond the bits of the run."""
    made = problem(ORBIT)
    ends = stored.load(made)[-1:]
    texts, times = [e.texts for e in ends], [e.t for e in ends]
    few = along(made, times, Precision(120, "1e-34"), 4)
    with pytest.raises(taylor.ReferenceFailed, match="120 bits may be off"):
        make.uncertainties(texts, times, few, [1e-8])
    many = along(made, times, make.PRECISION, 4)
    assert make.uncertainties(texts, times, many, [1e-8])
    with pytest.raises(taylor.ReferenceFailed, match="needs more bits"):
        make.uncertainties(texts, times, many, [1e14])


def test_every_stored_uncertainty_was_measured_in_more_bits():
    for label in labels():
        known = stored.find(problem(label))
        assert known.bits >= 200
        assert [e.uncertainty for e in known.ends] == sorted(e.uncertainty for e in known.ends)


@pytest.mark.parametrize("bits", [150, 300])
def test_numbers_of_many_bits_are_exact(bits):
    """The double nearest 1/3, the rational 1/3 and pi, against mpmath."""
    import mpmath
    import sympy as sp

    from phasebench.reference.solvers.translate import number

    with mpmath.workprec(bits + 40):
        for e, true in (
            (sp.Rational(1, 3), mpmath.mpf(1) / 3),
            (sp.Float(1 / 3), mpmath.mpf(1 / 3)),
            (sp.pi, +mpmath.pi),
        ):
            off = abs(mpmath.mpf(str(number(e, taylor.Bits(bits)))) - true)
            assert off <= 8 * true * mpmath.mpf(2) ** -bits


def test_round_off_off_the_manifold_is_in_a_solvers_uncertainty():
    """Gauss's distance was 0.8 or 1.6 of it, by processor, while only neighbours on the manifold counted."""
    made = problem("spherical-pendulum")
    path = along(made, made.start.times, check.AGAIN)
    on = horizon.neighbour(made, path.grid, path.near)
    off = others._apart_off_manifold(made, path)
    middle = np.searchsorted(path.grid, path.grid[-1] / 4)
    assert off[-1] / off[middle] == pytest.approx(16, rel=0.2)
    assert on[-1] / on[middle] < 6
    said = [gauss for (gauss,) in others.words(made, made.start.times, path, on)]
    assert all(4 * gauss.distance < gauss.uncertainty for gauss in said)
    assert said[-1].uncertainty < 100 * said[-1].distance, "so large an uncertainty would hide a wrong solver"


# -- checks of changed certificates -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def measurements():
    """The measurements of an orbit from which its certificate is checked, computed once for all tests."""
    made, known = problem(ORBIT), stored.find(problem(ORBIT))
    path = along(made, [e.t for e in known.ends], check.AGAIN)
    said = others.words(made, made.start.times, path, horizon.neighbour(made, path.grid, path.near))
    return path, horizon.rounding(made, path.grid, horizon.OTHER), said


@pytest.fixture
def use_measurements(measurements, monkeypatch):
    """Let the check of a certificate use the measurements already made."""
    path, rounding, said = measurements
    monkeypatch.setattr(check, "along", lambda *a: path)
    monkeypatch.setattr(horizon, "rounding", lambda *a: rounding)
    monkeypatch.setattr(others, "words", lambda *a: said)


def at_end(**changed):
    """Function that returns a certificate with fields of its last state changed: name=function of the state."""
    return lambda c: replace(
        c, ends=(*c.ends[:-1], replace(c.ends[-1], **{k: f(c.ends[-1]) for k, f in changed.items()}))
    )


def digit(place: int):
    """Function that returns a certificate with one decimal of q1 in its last state changed by 5."""
    return at_end(q_text=lambda end: (spoilt(end.q_text[0], place), *end.q_text[1:]))


def later(name: str, points: float):
    """Function that returns a certificate with a time of it (``name``) moved by some grid points."""
    return lambda c: replace(c, **{name: getattr(c, name) + points * c.spacing})


CHANGES = {
    "a digit": (digit(20), "digits are off"),
    "the last digit that is known": (digit(22), "digits are off"),
    "a tenth of the uncertainty": (at_end(uncertainty=lambda e: e.uncertainty / 10), "is stated"),
    "3000 uncertainties": (at_end(uncertainty=lambda e: 3000 * e.uncertainty), "is stated"),
    "a later horizon": (later("horizon", 4), "horizon is stated"),
    "an earlier horizon": (later("horizon", -4), "horizon is stated"),
    "the interval's begin": (later("earliest", -4), "earliest is stated"),
    "the interval's end": (later("latest", 4), "latest is stated"),
    "the limit": (lambda c: replace(c, limit=1e-11), "the limit is stated"),
}


@pytest.mark.parametrize("what", CHANGES)
def test_a_changed_certificate_does_not_hold(use_measurements, what):
    made, known = problem(ORBIT), stored.find(problem(ORBIT))
    assert check.examine(made, known).wrong == ()
    change, says = CHANGES[what]
    outcome = check.examine(made, change(known))
    assert not outcome.holds
    assert len(outcome.wrong) == 1
    assert says in outcome.wrong[0]


def test_a_certificate_with_a_missing_state_does_not_hold():
    made = problem("harmonic-oscillator")
    known = stored.find(made)
    outcome = check.examine(made, replace(known, t_end=1.0, ends=known.ends[:1]), grid_points=10)
    assert any("the orbit's times are" in x for x in outcome.wrong)


@pytest.mark.parametrize("what", ["a digit", "a tenth of the uncertainty", "a later horizon"])
def test_command_and_cell_fail_on_a_changed_file(use_measurements, what, tmp_path, monkeypatch):
    """The checksum is valid: the file is not damaged but states something false."""
    all_of, versions = stored.read("schwarzschild")
    change = CHANGES[what][0]
    changed = [change(c) if c.problem == ORBIT else c for c in all_of]
    monkeypatch.setattr(stored, "DIRECTORY", tmp_path)
    for certificates, code in ((all_of, 0), (changed, 1)):
        stored.write("schwarzschild", certificates, versions)
        done = CliRunner().invoke(app, ["certify", ORBIT, "--json"])
        (row,) = json.loads(done.stdout)["references"]
        assert (done.exit_code, bool(row["changed"])) == (code, bool(code))
    assert "stated" in references.stored_states(ORBIT)["changed"]


# -- comparisons ------------------------------------------------------------------------------------------------------


def end(**check_of) -> stored.End:
    """A made-up state of a certificate, with one check by another solver."""
    said = stored.Check("another", **check_of)
    return stored.End(1.0, ("0.78",), ("0.1",), 1e-20, 1e-15, 0.0, (said,))


@pytest.mark.parametrize(
    ("distance", "uncertainty", "compares", "agrees"),
    [
        (2.6e-3, 2.4, False, False),  # IAS15 on the chaotic Henon-Heiles orbit at t = 300
        (1e-3, 0.05, False, False),
        (1e-3, 0.007, True, True),
        (0.5, 0.007, True, False),
        (1.01e-15, 1e-15, True, False),
        (0.99e-15, 1e-15, True, True),
        (1e-20, 0.0, True, True),
        (1.1e-20, 0.0, True, False),
        (0.0, float("nan"), False, False),
    ],
)
def test_a_solver_without_two_digits_is_not_compared(distance, uncertainty, compares, agrees):
    state = end(distance=distance, uncertainty=uncertainty)
    (said,) = state.checks
    assert (state.compares(said), state.agrees(said), state.agree) == (compares, agrees, agrees)


def test_a_vague_check_neither_agrees_nor_disagrees():
    state = stored.load(problem("henon-heiles:chaotic"))[-1]
    gauss, ias15 = state.checks
    assert ias15.uncertainty > state.size
    assert state.compares(gauss)
    assert not state.compares(ias15)
    assert state.agree
    assert not replace(state, checks=(ias15,)).agree


def test_a_solvers_uncertainty_covers_random_round_off():
    """For two runs whose errors are random walks, the difference times `SAFETY` covers the error of one."""
    random = np.random.default_rng(0)
    walks = random.normal(size=(2, 400, 300)).cumsum(axis=2)
    own = np.array([others.uncertainty(np.abs(a - b), 0.0) for a, b in zip(*walks, strict=True)])
    covered = np.mean(np.maximum.accumulate(np.abs(walks[0]), axis=1)[:, -1] <= own[:, -1])
    assert covered > 0.95
    assert np.mean(np.abs(walks[0]).max(axis=1) <= own[:, -1] / 10) < 0.5


# -- horizons ---------------------------------------------------------------------------------------------------------

CHAOTIC = "henon-heiles:chaotic"
GRID = [150.0 * (i + 1) / 200 for i in range(200)]


@pytest.fixture(scope="module")
def chaotic():
    """The growth of rounding errors along the chaotic orbit."""
    return horizon.rounding(problem(CHAOTIC), GRID)


def test_the_horizon_for_exponential_growth():
    """Distances grow as exp(rate t) from normally distributed draws, so the times are known in closed form."""
    rate, grid = 0.1, [0.1 * i for i in range(1, 2400)]
    sizes = np.abs(np.random.default_rng(1).normal(size=1001))
    made = horizon.Rounding(grid, np.ones(len(grid)), horizon.UNIT * sizes[:, None] * np.exp(rate * np.array(grid)))
    scale = np.log(1e-13 / horizon.UNIT)
    span = made.span()
    for t, quantile in zip(span, (0.6745, 2.2414, 0.03134), strict=True):
        assert t == pytest.approx((scale - np.log(quantile)) / rate, abs=1.5)
    low, high = made.band
    assert all(a < t < b for a, t, b in zip(low, span, high, strict=True))
    assert high.horizon - low.horizon == pytest.approx(0.04 / rate + 0.2, abs=0.21)


def test_the_horizon_is_robust_to_displacement_and_order(chaotic):
    """The horizon stays in its band for another displacement and tolerance, which change more than another machine."""
    other = horizon.rounding(problem(CHAOTIC), GRID, horizon.OTHER)
    low, high = chaotic.band
    assert all(a <= t <= b for a, t, b in zip(low, other.span(), high, strict=True))
    assert high.horizon - low.horizon < 3.0
    assert np.abs(other.distances[:, 60] / chaotic.distances[:, 60] - 1).max() < 1e-3


def test_the_interval_of_the_horizon_covers_single_runs(chaotic):
    """Two horizons found earlier from single runs, and runs with other seeds, lie in it."""
    span = chaotic.span()
    assert span.earliest < 110 < 133.5 <= span.latest + 0.75
    again = horizon.rounding(problem(CHAOTIC), GRID, seed=7)
    leaves = [horizon.within(GRID, distance, again.size) for distance in again.distances]
    assert np.mean([span.earliest <= t <= span.latest for t in leaves]) >= 0.85
    assert np.mean([abs(t - span.horizon) < 1.0 for t in leaves]) < 0.5  # control: one run is not the horizon
    assert again.span().horizon == pytest.approx(span.horizon, abs=3.0)


def test_the_stored_horizon_is_that_of_the_problem(chaotic):
    known = stored.find(problem(CHAOTIC))
    low, high = chaotic.band
    assert low.horizon - known.spacing <= known.horizon <= high.horizon + known.spacing
    assert known.limit == horizon.LIMIT == 1e-13
    assert horizon.span(problem("harmonic-oscillator"), 100.0, 10) == (100.0, 100.0, 100.0)


def test_rounding_along_the_way_counts():
    """In a close encounter of three bodies the rounding errors made there dominate those of the start."""
    made = problem("n-body")
    grid = [0.1 * (i + 1) for i in range(60)]
    found = horizon.rounding(made, grid, draws=6)
    assert found.span().horizon < 6
    near = taylor.states(made.system, np.longdouble, made.q0, made.p0, grid)
    start = horizon.neighbour(made, grid, near) * (horizon.UNIT / horizon.SHIFT)
    assert horizon.within(grid, start, found.size) == 6.0
