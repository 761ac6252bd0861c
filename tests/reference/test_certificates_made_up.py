"""How certificates are made and judged, tested with made-up runs: grids, bounds, other solvers, errors."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from phasebench.integrators import Hamiltonian, InvalidInput
from phasebench.reference import peers
from phasebench.reference.certificates import along, check, horizon, make, others, stored
from phasebench.reference.certificates.rows import row
from phasebench.reference.solvers import gauss, taylor

PRECISION = along.Precision(200, "1e-58")
OSCILLATOR = Hamiltonian(q="q", p="p", H="p**2/2 + q**2/2")


def about(value, rel: float = 1e-6):
    """`pytest.approx` with a relative tolerance only."""
    return pytest.approx(value, rel=rel, abs=0)


def fake_problem(times=(1.0, 2.0, 4.0), d: int = 1) -> SimpleNamespace:
    """Stand-in for a problem with stored times, with the fields that the making of certificates reads."""
    system = OSCILLATOR if d == 1 else Hamiltonian(q="a b", p="c d", H="(c**2 + d**2)/2 + a**2 + b**2")
    start = SimpleNamespace(name="start", times=times)
    q, p = (1.0,) * d, (0.0,) * d
    return SimpleNamespace(id="made", label="made:start", system=system, q0=q, p0=p, start=start, parameters={"k": 2.0})


def path(grid, rows=None, near=None) -> along.Along:
    """An orbit on a grid of times, at rest at (1, 0) or with these rows as decimal strings.

    ``near``: the same orbit in long double.
    """
    number = taylor.Bits(PRECISION.bits)
    rows = [[number(x) for x in row] for row in (rows or [["1", "0"]] * len(grid))]
    near = np.array([[1.0, 0.0]] * len(grid)) if near is None else near
    return along.Along(PRECISION, list(grid), rows, near, np.abs(near).max(axis=1))


def certificate(**changed) -> stored.Certificate:
    """A valid made-up certificate with some fields changed."""
    said = stored.Check("another", 1e-15, 1e-15)
    ends = tuple(stored.End(t, ("1",), ("0",), 4e-34, 1e-19, 0.0, (said,)) for t in (1.0, 2.0, 4.0))
    base = {"problem": "made:start", "orbit": "start", "parameters": {"k": 2.0}, "q0": (1.0,), "p0": (0.0,)}
    base |= {"fingerprint": "x", "t_end": 4.0, "limit": horizon.LIMIT, "bits": 200, "spacing": 0.5, "growth": 1.0}
    span = {"horizon": 3.0, "earliest": 2.0, "latest": 4.0}
    return stored.Certificate(**base | span | {"rate": None, "ends": ends} | changed)


# -- along an orbit ----------------------------------------------------------------------------------------------------


@pytest.fixture
def still(monkeypatch):
    """Replace Taylor runs by ones whose state at a time t is (t, -2 t)."""
    monkeypatch.setattr(
        taylor, "states", lambda system, fp, q, p, times, tol=None: np.array([[t, -2 * t] for t in times])
    )


def test_the_grid_divides_the_span_and_contains_the_times(still):
    found = along.along(fake_problem(), [0.3, 2.0], PRECISION, 4)
    assert found.grid == [0.3, 0.5, 1.0, 1.5, 2.0]
    assert found.size.tolist() == [0.6, 1.0, 2.0, 3.0, 4.0]
    assert found.row(1.5).tolist() == [1.5, -3.0]
    assert along.along(fake_problem(), [1.0], PRECISION, 2).grid == [0.5, 1.0]
    assert along.along(fake_problem(), [0.7], PRECISION, 1).grid == [0.7]


@pytest.mark.parametrize(
    "times", [[], [0.0, 1.0], [-1.0], [2.0, 1.0], [1.0, 1.0], [1.0, float("inf")], [float("nan"), 1.0], [1.0, 3.0, 2.0]]
)
def test_invalid_times_are_refused(still, times):
    with pytest.raises(InvalidInput, match="positive, finite and increase"):
        along.along(fake_problem(), times, PRECISION, 4)
    with pytest.raises(InvalidInput, match="positive, finite and increase"):
        make.certify(fake_problem(), times)


def test_distances_are_running_maxima():
    rows = np.array([[1.0, 0.1], [0.5, 0.2], [1.2, -0.3]])
    assert path([1.0, 2.0, 3.0]).distances(rows) == about([0.1, 0.5, 0.5])


# -- making certificates
# -----------------------------------------------------------------------------------------------

DIGITS = [("1.0000000000000000000000000000000001", "0"), ("1", "0"), ("1", "0.0000000000000000000000000000000003")]


def test_errors_are_running_maxima_of_the_digits_errors():
    rows = path([1.0, 2.0, 4.0])
    assert make.errors(DIGITS, [1.0, 2.0, 4.0], rows) == about([1e-34, 1e-34, 3e-34], rel=1e-9)


def test_a_bound_adds_margin_and_round_off_of_the_run():
    rows, times = path([1.0, 2.0, 4.0]), [1.0, 2.0, 4.0]
    own = 1e-58 * np.array([1.0, 2e20, 9e20])  # growth of a rounding error
    bounds = make.uncertainties(DIGITS, times, rows, horizon.UNIT * own / 1e-58)
    assert bounds == about(make.FACTOR * np.array([1e-34, 1e-34, 3e-34]) + own, rel=1e-9)
    with pytest.raises(taylor.ReferenceFailed, match=r"at t = 2 the run of 200 bits may be off by 1\.1e-37"):
        make.uncertainties(DIGITS, times, rows, horizon.UNIT * np.array([1.0, 1.1e21, 1.0]))


def test_a_certificate_has_the_measurements_at_its_times(monkeypatch):
    grid = [0.5, 1.0, 2.0, 3.0, 4.0]
    near = np.array([[1.0, x] for x in (0.0, 1e-19, 3e-19, 2e-19, 5e-19)])
    distances = horizon.UNIT * np.array([[1.0] * 5, [1.0, 1.0, 5e20, 5e20, 5e20]])
    rounding = horizon.Rounding(grid, np.ones(5), distances)
    monkeypatch.setattr(make, "along", lambda problem, times, precision, points: path(grid, near=near))
    monkeypatch.setattr(make, "_digits", lambda problem, times: DIGITS)
    monkeypatch.setattr(horizon, "rounding", lambda problem, grid: rounding)
    monkeypatch.setattr(horizon, "neighbour", lambda problem, grid, near: 1e-14 * np.array(grid) ** 2)
    monkeypatch.setattr(others, "words", lambda problem, times, path, apart: [(), (), ()])
    found = make.certify(fake_problem(), [1, 2, 4], 8)
    assert (found.t_end, found.spacing, found.bits, found.limit) == (4.0, 0.5, 200, horizon.LIMIT)
    assert (found.growth, found.rate) == (about(2.0), None)
    assert [e.t for e in found.ends] == [1.0, 2.0, 4.0]
    assert [e.long_double for e in found.ends] == about([1e-19, 3e-19, 5e-19], rel=1e-6)
    assert found.ends[1].uncertainty == about(4e-34 + 5e-38, rel=1e-9), "of the draw that grew most"
    assert [e.texts for e in found.ends] == DIGITS
    assert (found.q0, found.p0, found.parameters, found.problem) == ((1.0,), (0.0,), {"k": 2.0}, "made:start")
    assert horizon.Span(found.horizon, found.earliest, found.latest) == rounding.span()


def test_digits_are_those_of_quadruple_precision(monkeypatch):
    monkeypatch.setattr(taylor, "states", lambda *a: [["0.1234567890123456789012345678901234567", "-2"]])
    ((q, p),) = make._digits(fake_problem(), [1.0])
    assert q == "1.234567890123456789012345678901235e-1"
    assert len(q.partition("e")[0].replace(".", "")) == stored.DIGITS == 34
    assert float(p) == -2.0


# -- other solvers
# -----------------------------------------------------------------------------------------------------


def test_a_solvers_uncertainty_adds_two_runs_and_round_off():
    assert others.uncertainty([1.0, 3.0, 2.0], np.array([0.1, 0.2, 0.3])).tolist() == [4.1, 12.2, 12.3]


def test_gauss_refines_taylor_steps_and_its_round_off_walks(monkeypatch):
    seen, grid = [], [1.0, 2.0, 4.0]

    def run(system, q, p, marks, times):
        seen.append(marks)
        return np.array([[1.0, 0.0], [1.0, 0.0], [1.0, 1e-18 * len(seen)]])

    monkeypatch.setattr(taylor, "step_ends", lambda *a: [0.004, 1.0, 4.0])
    monkeypatch.setattr(gauss, "run", run)
    unit = np.array([1.0, 1.0, 10.0])
    far, own = others._gauss(fake_problem(), path(grid), unit)
    for marks, parts in zip(seen, others.PARTS, strict=True):
        steps = np.diff([0.0, *marks])
        assert steps.min() > 0
        assert {0.004, 1.0, 4.0} <= {round(t, 12) for t in marks}
        assert steps.max() <= 1.001 * 4.0 * others.SHARE / parts
        assert sum(t < 0.005 for t in marks) == parts, "a short step is only divided"
        assert len(marks) == parts * (1 + 100 + 300)
    assert far == about([0, 0, 2e-18])
    eps, n = float(gauss.EPS), len(seen[1])
    assert own[:2] == about(eps * np.sqrt(n * np.array([1, 2]) / 3))
    assert own[2] == about(4e-18 + 10 * eps * np.sqrt(n))


def test_gauss_and_ias15_report_at_the_times(monkeypatch):
    grid, given = [0.5, 1.0, 2.0], []

    def far(problem, path, unit):
        given.append(unit)
        return np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0, 6.0])

    monkeypatch.setattr(others, "_gauss", far)
    monkeypatch.setattr(
        others, "_ias15", lambda problem, times, unit: ([np.array([1.0, 0.25]), np.array([1.0, 0.125])], [7, 8])
    )
    said = others.words(fake_problem(), [1.0, 2.0], path(grid), np.array([0.0, 3.0, 20.0]) * horizon.SHIFT)
    assert given[0] == about([1.0, 3.0, 20.0]), "the state's size, or what a neighbour grew by"
    assert [[(c.distance, c.uncertainty) for c in checks] for checks in said] == [
        [(2, 5), (0.25, 7)],
        [(3, 6), (0.25, 8)],
    ]
    monkeypatch.setattr(others, "_ias15", lambda problem, times, unit: None)
    assert [len(checks) for checks in others.words(fake_problem(), [1.0, 2.0], path(grid), np.zeros(3))] == [1, 1]


@pytest.fixture
def ias15(monkeypatch):
    """Replace IAS15 by runs that end at q = (t + tol, 0), p = 0 after 400 steps.

    The fixture is (list of calls, list whose only element is the status that runs return).
    """
    asked, status = [], ["ok"]

    def run(problem, peer, tol, t_end):
        asked.append((tol, t_end))
        q = np.array([[9.0, 9.0], [t_end + tol, 0.0]])
        return SimpleNamespace(status=status[0], q=q, p=0 * q, counts={"steps": 400})

    monkeypatch.setattr(peers, "integrate_peer", run)
    return asked, status


def test_ias15_runs_at_two_tolerances(ias15):
    asked, status = ias15
    rows, own = others._ias15(fake_problem(d=2), [1.0, 2.0], np.array([1.0, 3.0]))
    loose, fine = others.TOLERANCES
    assert asked == [(loose, 1.0), (loose, 2.0), (fine, 1.0), (fine, 2.0)]
    assert [row.tolist() for row in rows] == [[t + fine, 0, 0, 0] for t in (1.0, 2.0)]
    assert own == about(4 * (loose - fine) + 2.0**-52 * 20 * np.array([1, 3]), rel=1e-6)
    status[0] = "diverged"
    assert others._ias15(fake_problem(d=2), [1.0], np.ones(1)) is None
    assert others._ias15(fake_problem(d=1), [1.0], np.ones(1)) is None


def test_the_round_off_of_ias15_is_a_random_walk(ias15, monkeypatch):
    monkeypatch.setattr(others, "TOLERANCES", (1e-11, 1e-11))
    _, own = others._ias15(fake_problem(d=2), [1.0, 2.0], np.array([1.0, 3.0]))
    assert own == about(2.0**-52 * np.sqrt(400) * np.array([1, 3]))


# -- judging
# -----------------------------------------------------------------------------------------------------------


def outcome(known, *errors: float, wrong=()) -> check.Outcome:
    """The outcome of checking a certificate, with these errors of its states and these faults (``wrong``)."""
    return check.Outcome(known, errors, horizon.Span(3.0, 2.0, 4.0), 3.0, 1e-19, 1.0, None, wrong)


def test_a_certificate_holds_if_all_checks_agree():
    known = certificate()
    good = outcome(known, 1e-34, 2e-34, 4e-34)
    assert good.ratios == about((4.0, 2.0, 1.0))
    assert (good.holds, good.disagree) == (True, 0)
    assert not outcome(known, 1.0, 1.0, 1.0, wrong=("something",)).holds
    off = replace(known.ends[1], checks=(stored.Check("another", 1e-10, 1e-15), stored.Check("vague", 1.0, 1.0)))
    bad = outcome(replace(known, ends=(known.ends[0], off, known.ends[2])), 1.0, 1.0, 1.0)
    assert (bad.holds, bad.disagree) == (False, 1)


def test_an_uncertainty_must_be_near_the_error():
    (end, *_) = certificate().ends
    said = [check._bounds((end,), [error]) for error in (4e-34, 4.01e-34, 4.01e-38, 3.99e-38)]
    assert [len(wrong) for wrong in said] == [0, 1, 0, 1]
    assert said[1] == ["at t = 1 the digits are off by 4e-34, and 4e-34 is stated"]


def test_times_must_be_those_of_the_orbit():
    assert check._times(fake_problem(times=(1.0, 2.0)), [1.0, 2.0]) == []
    assert check._times(fake_problem(times=(1.0, 2.0)), [1.0]) == [
        "it is stored at t = [1.0], the orbit's times are [1.0, 2.0]"
    ]


def test_the_horizon_must_be_that_of_the_problem():
    grid = [0.5 * k for k in range(1, 13)]
    distances = np.array([horizon.LIMIT * 10.0 ** (np.array(grid) - 3.2)] * 3)
    rounding = horizon.Rounding(grid, np.ones(12), distances)
    span = rounding.span()
    right = certificate(**span._asdict())
    assert check._spans(right, rounding) == []
    for name in span._fields:
        for t, wrong in ((0.5, 0), (-0.5, 0), (1.0, 1), (-1.0, 1)):
            said = check._spans(replace(right, **{name: getattr(span, name) + t}), rounding)
            assert len(said) == wrong, (name, t)
            assert all(s.startswith(f"{name} is stated as") for s in said)
    assert check._spans(replace(right, limit=1e-12), rounding) == ["the limit is stated as 1e-12 and is 1e-13"]


def test_differences_of_a_recheck_are_reported(monkeypatch):
    grid, known = [1.0, 2.0, 4.0], certificate(horizon=1.0, earliest=1.0)
    near = np.array([[1.0, 0.0], [1.0, 1e-14], [1.0, 1e-12]])
    rounding = horizon.Rounding(grid, np.ones(3), np.full((2, 3), 1e-15))
    again = [(stored.Check("again", 1.0, 1.0),)] * 3
    monkeypatch.setattr(check, "along", lambda problem, times, precision, points: path(grid, near=near))
    monkeypatch.setattr(horizon, "rounding", lambda problem, grid, run: rounding)
    monkeypatch.setattr(horizon, "neighbour", lambda problem, grid, near: np.array(grid) * 1e-14)
    monkeypatch.setattr(others, "words", lambda problem, times, path, apart: again)
    ends = tuple(replace(e, q_text=digits[:1], p_text=digits[1:]) for e, digits in zip(known.ends, DIGITS, strict=True))
    found = check.examine(fake_problem(), replace(known, ends=ends), 4)
    assert found.errors == about((1e-34, 1e-34, 3e-34), rel=1e-9)
    assert (found.long_double, found.leaves) == (about(1e-12), 2.0)
    assert (found.growth, found.span) == (about(1.0), rounding.span())
    assert [e.checks for e in found.certificate.ends] == again
    assert [w.partition(" is stated")[0] for w in found.wrong] == ["horizon", "earliest"], "not so the others"


def test_a_certificate_is_renewed_at_the_orbits_times(monkeypatch):
    known = certificate()
    monkeypatch.setattr(check, "examine", lambda problem, found: outcome(found, 1e-34, 1e-34, 1e-34))
    monkeypatch.setattr(make, "certify", lambda problem, times: known)
    with pytest.raises(InvalidInput, match="made:start states no times"):
        check.renew(fake_problem(times=()))
    monkeypatch.setattr(stored, "find", lambda problem: None)
    assert check.renew(fake_problem()).moved == "new"
    with pytest.raises(InvalidInput, match="no reference of made:start is stored"):
        check.recheck(fake_problem())
    monkeypatch.setattr(stored, "find", lambda problem: known)
    assert check.renew(fake_problem()).moved == ""
    assert check.recheck(fake_problem()).certificate == known
    moved = replace(known.ends[1], q_text=(f"1.{'0' * 30}5",))
    other = replace(known, ends=(known.ends[0], moved, known.ends[2]))
    assert check.describe_change(other, known) == "t = 2 by 5e-31"
    assert check.describe_change(replace(known, ends=known.ends[:2]), known) == "at other times"


def test_the_digits_horizon():
    known = certificate()
    assert known.digits_horizon == 4.0
    for k, holds in ((0, 0.0), (1, 1.0), (2, 2.0)):
        ends = list(known.ends)
        ends[k] = replace(ends[k], uncertainty=1.1 * known.limit)
        assert replace(known, ends=tuple(ends)).digits_horizon == holds


def test_the_change_of_energy_is_relative_to_its_terms():
    assert stored.energy_change(fake_problem(), ["2"], ["0"]) == about((2 - 0.5) / 2)
    assert stored.energy_change(fake_problem(), ["0.5"], ["0.5"]) == about((0.25 - 0.5) / 0.5)
    opposed = SimpleNamespace(system=Hamiltonian(q="q", p="p", H="p**2/2 - q**2/2"), q0=(1.0,), p0=(1.0,))
    assert stored.energy_change(opposed, ["1"], ["3"]) == about(4 / 5)


def test_missing_folders_are_created(tmp_path):
    path = stored.write("made", [certificate()], {"of": "1"}, tmp_path / "some" / "where")
    assert path.parent == tmp_path / "some" / "where"
    assert "made:start" in path.read_text()


# -- random displacements
# ----------------------------------------------------------------------------------------------


class Flow:
    """Stand-in for a Taylor integrator: its time advances and its state does not change."""

    def __init__(self):
        self.state, self.time = np.ones(2, np.longdouble), np.longdouble(0)

    def propagate_until(self, t, max_steps):
        self.time = t


@pytest.fixture
def flow(monkeypatch):
    """Replace Taylor integrators by `Flow`."""
    made = Flow()

    def start(ta, fp, q, p):
        ta.time, ta.state = fp(0), np.array([fp(1), fp(1)])

    monkeypatch.setattr(taylor, "integrator", lambda system, fp, tol=None: made)
    monkeypatch.setattr(taylor, "step_ends", lambda *a: [float(k) for k in range(1, 101) if k <= a[-1]])
    monkeypatch.setattr(taylor, "start", start)
    return made


def test_rounding_errors_of_start_and_steps_add_up(flow):
    """After n steps, n + 1 uniform numbers have been added: a random walk of standard deviation ((n + 1) / 3)^1/2."""
    grid = [0.5, 8.5, 99.5]
    found = horizon.rounding(fake_problem(), grid, draws=300)
    assert found.distances.shape == (300, 3)
    assert (found.size == 1.0).all(), "the run beside them is not displaced"
    assert (np.diff(found.distances, axis=1) >= 0).all()
    assert found.distances[:, 0].max() <= horizon.UNIT * 1.001
    spread = np.sqrt(np.array([1, 9, 100]) / 3)
    median = np.median(found.distances, axis=0) / horizon.UNIT / spread
    assert 1.0 < median[0] < 1.6
    assert 0.9 < median[1] < 2.0
    assert 0.9 < median[2] < 2.0
    again = horizon.rounding(fake_problem(), grid, (2.0**-40, None), draws=300)
    assert np.allclose(again.distances, found.distances, rtol=1e-3, atol=0), "whatever they are displaced by"
    other = horizon.rounding(fake_problem(), grid, seed=2, draws=300)
    assert not np.allclose(other.distances, found.distances, rtol=0.1, atol=0)


def test_a_displaced_run_that_stops_is_a_failure(flow, monkeypatch):
    monkeypatch.setattr(flow, "propagate_until", lambda t, max_steps: setattr(flow, "time", min(t, 1.25)))
    with pytest.raises(taylor.ReferenceFailed, match=r"stopped at t = 1\.25"):
        horizon.rounding(fake_problem(), [1.0, 3.0], draws=2)

    def lost(t, max_steps):
        flow.time, flow.state[0] = t, np.nan

    monkeypatch.setattr(flow, "propagate_until", lost)
    with pytest.raises(taylor.ReferenceFailed, match="stopped at t = 1"):
        horizon.rounding(fake_problem(), [1.0, 3.0], draws=2)


def test_the_horizon_is_a_point_of_the_grid(flow):
    assert horizon.span(fake_problem(), 10.0, 5) == (10.0, 10.0, 10.0)
    within = horizon.Rounding([1.0, 2.0, 3.0], np.ones(3), np.array([[0.0, 0.0, 1.0]]))
    assert within.span().horizon == 2.0
    low, high = within.band
    assert (low.horizon, high.horizon) == (1.0, 3.0)
    never = horizon.Rounding([1.0, 2.0, 3.0], np.ones(3), np.array([[1.0, 1.0, 1.0]]))
    assert (never.band[0].horizon, never.band[1].horizon) == (0.0, 1.0)
    close = horizon.Rounding([1.0, 2.0, 3.0], np.ones(3), np.array([[0.0, 0.99, 1.01]]) * horizon.LIMIT)
    assert (close.band[0].horizon, close.band[1].horizon) == (0.0, 3.0), "two in a hundred of the limit either way"


def test_growth_is_algebraic_or_exponential():
    """Fitted over the later three quarters of the time until the neighbour is lost; NaN for one that has not moved."""
    grid, size = np.arange(1.0, 101.0), np.ones(100)
    assert horizon.growth(grid, 1e-12 * grid**2, size) == (about(2.0), None)
    exponent, rate = horizon.growth(grid, 1e-12 * np.exp(0.1 * grid), size)
    assert (exponent, rate) == (about(7.5 / np.log(4)), about(0.1))
    lost = np.where(grid <= 40, 1e-12 * grid**2, 1.0)
    assert horizon.growth(grid, lost, size) == (about(2.0), None), "what comes behind does not count"
    still = np.where(grid <= 60, 0.0, 1e-12)
    assert np.isnan(horizon.growth(grid, still, size)[0])
    fine = np.linspace(0.1, 40.0, 400)
    for scale in (1.0, 1e-4):
        until = np.log(horizon.LOST * scale / 1e-12) / 0.7
        assert until < fine[-1]
        exponent, rate = horizon.growth(fine, 1e-12 * np.exp(0.7 * fine), np.full(400, scale))
        assert exponent == about(0.7 * until * 0.75 / np.log(4), rel=0.02), "the distance is lost relative to the size"
        assert rate == about(0.7)


# -- the row of a reference --------------------------------------------------------------------------------------------


def test_row_of_a_reference_counts_its_bounds():
    """Three checks bound the error at 8, 2 and 4 times its size; a fourth has too few digits to be compared."""
    stated = certificate()
    vague = stored.Check("vague", 1e-15, 0.5)
    first = replace(stated.ends[0], checks=(*stated.ends[0].checks, vague))
    known = replace(stated, ends=(first, *stated.ends[1:]))
    found = row(outcome(known, 5e-35, 2e-34, 1e-34))
    assert found["least bound"] == about(2.0)
    assert found["largest bound"] == about(8.0)
    assert found["pairs"] == 3
    assert found["no comparison"] == 1
    assert found["unchecked"] == 0
