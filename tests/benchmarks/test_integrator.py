"""`Integrator`, one interface to methods, peers and the user's steps; the public functions that use it."""

from __future__ import annotations

import time

import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.problems import problem
from phasebench.integrators import record
from phasebench.integrators.driver import integrate
from phasebench.integrators.errors import InvalidInput
from phasebench.reference.peers import peer
from support.steps import leapfrog

HENON = problem("henon-heiles:box")
VERLET = """
CLAIMS = {"order": 2, "symplectic": True, "energy": "bounded"}
REQUIRES = ("separable",)


def step(system, q, p, h):
    p = p - h / 2 * system.dH_dq(q, p)
    q = q + h * system.dH_dp(q, p)
    return q, p - h / 2 * system.dH_dq(q, p)
"""


@pytest.fixture
def file(tmp_path):
    """A function that writes a text to a file and returns its path."""

    def write(text: str) -> str:
        (tmp_path / "mine.py").write_text(text)
        return str(tmp_path / "mine.py")

    return write


# -- kinds of integrator ----------------------------------------------------------------------------------------------


def test_claims_come_from_each_record(file):
    path = file(VERLET)
    ours, theirs, own = (integrator(x).claims for x in ("stormer-verlet", "rebound-leapfrog", path))
    assert (ours.order, ours.symplectic, ours.reversible, ours.energy) == (2, True, True, record.BOUNDED)
    assert theirs == peer("rebound-leapfrog").claims
    assert (own.order, own.symplectic, own.reversible, own.energy, own.source) == (2, True, None, record.BOUNDED, path)


@pytest.mark.parametrize("every", [1, 7, 0])
def test_user_step_agrees_with_the_method(file, every):
    ours = integrate(HENON, "stormer-verlet", h=0.1, t_end=10, save_every=every)
    for own in (leapfrog, file(VERLET)):
        s = pb.integrate(HENON, own, h=0.1, t_end=10, save_every=every)
        assert (s.status, s.reason) == ("ok", "")
        assert np.array_equal(s.t, ours.t)
        assert np.abs(np.hstack([s.q - ours.q, s.p - ours.p])).max() < 1e-13
        assert s.counts == {"steps": 100, "gradient": 200, "hessian": 0, "iterations": 0, "fallbacks": 0}
    other = pb.integrate(HENON, lambda system, q, p, h: leapfrog(system, q, p, 1.001 * h), h=0.1, t_end=10)
    assert np.abs(other.q[-1] - ours.q[-1]).max() > 1e-4


@pytest.mark.parametrize(
    "call",
    [
        lambda **more: pb.integrate("pendulum", "scheme-i", h=0.1, steps=5, **more).q[-1],
        lambda **more: pb.prepare("pendulum", "scheme-i", **more)(0.1, 5)[0],
        lambda **more: pb.integrator("scheme-i", **more).record.parameters["lam"],
        lambda **more: pb.stability("scheme-i", **more).parameters["lam"],
    ],
)
def test_old_spelling_of_parameters_warns(call):
    new, other = call(parameters={"lam": "1/3"}), call(parameters={"lam": 0.25})
    with pytest.warns(DeprecationWarning, match=r"lam='1/3' is now parameters=\{'lam': '1/3'\}") as seen:
        old = call(lam="1/3")
    assert seen[0].filename == __file__
    assert old == new != other


def test_old_name_of_the_time_limit_warns():
    with pytest.warns(DeprecationWarning, match="timeout= is now time_limit=") as told:
        assert pb.integrate("harmonic-oscillator", "rk4", h=0.1, steps=10, timeout=60.0).status == "ok"
    assert told[0].filename == __file__
    limited = {"t_end": 1.0, "accuracy": 1e-3, "limit": -1.0}
    with pytest.warns(DeprecationWarning, match="limit= is now"), pytest.raises(InvalidInput, match="time_limit"):
        pb.advise("pendulum", **limited)
    with pytest.raises(InvalidInput, match="both are given"):
        pb.advise("pendulum", **limited, time_limit=2.0)


# -- invalid input ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "method", "more", "message"),
    [
        (3, "rk4", {}, "the problem is 3"),
        ("pendulum", 3, {}, "the method is 3"),
        ("pendulum", "rk4", {"tend": 1}, "did you mean t_end"),
        ("pendulum", "scheme-i", {"lamda": 1}, r"unknown argument lamda; did you mean parameters=\{'lam': 1\}"),
        ("pendulum", "scheme-i", {"stepz": 3}, r"unknown argument stepz; did you mean steps\?"),
        ("pendulum", "scheme-i", {"bound": 3}, "unknown argument bound; integrate takes problem, method, h"),
        ("pendulum", "scheme-i", {"parameters": "lam=1"}, "it must map names to values"),
        ("pendulum", leapfrog, {"parameters": {"lam": 1}}, "no parameters such as lam; it takes h"),
        ("pendulum", "heyoka", {"timeout": 3}, "cannot be stopped"),
        ("pendulum", leapfrog, {"tol": 1e-3}, "takes a step h, no tolerance"),
        ("pendulum", leapfrog, {"timeout": 0}, "positive number of seconds"),
        ("pendulum", leapfrog, {"save_every": -1}, "save_every is -1"),
        ("pendulum", leapfrog, {"q0": np.array([1j])}, "must be numbers"),
        ("pendulum", lambda q: q, {}, r"step\(system, q, p, h\)"),
    ],
)
def test_invalid_input_is_named(name, method, more, message):
    with pytest.raises(InvalidInput, match=message):
        pb.integrate(name, method, h=0.1, steps=3, **more)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("raise SystemExit", ["line 2", "SystemExit"]),
        ("q += h * system.dH_dp(q, p); return q, p", ["line 2", "write q = q + ..."]),
        ("q.flags.writeable = True; q += h; return q, p", ["line 2", "WRITEABLE"]),
        ("return q", ["step returned", "must return q, p"]),
        ("return q, p[None]", ["p of shape (1, 2)"]),
        ("return q * 1j, p", ["real numbers"]),
        ("return 'x' * 100", ["str 'x", " ...; it must return q, p"]),
        ("return q, system.dH_dq(q[0], p)", ["line 2", "called with q of shape ()"]),
    ],
)
def test_error_in_a_step_is_named_with_its_line(file, line, words):
    path = file(f"def step(system, q, p, h):\n    {line}\n")
    with pytest.raises(InvalidInput) as caught:
        pb.integrate(HENON, path, h=0.1, steps=3)
    for word in (path, *words):
        assert word in str(caught.value)


# -- failures during a run --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("every", [1, 4, 0])
def test_nonfinite_state_has_diverged(every):
    def step(system, q, p, h):
        return q * 1e200, p

    s = pb.integrate("pendulum", step, h=0.5, steps=8, save_every=every)
    assert s.status == "diverged"
    assert "no longer finite" in s.reason
    assert np.isfinite(s.q).all()
    assert (len(s.t), s.counts["steps"]) == (2 if every == 1 else 1, 1)


def test_time_limit_keeps_the_rows_so_far():
    def slow(system, q, p, h):
        time.sleep(0.01)
        return leapfrog(system, q, p, h)

    s = pb.integrate("pendulum", slow, h=0.1, steps=10_000, save_every=4, time_limit=0.15)
    assert s.status == "timeout"
    assert 4 <= s.counts["steps"] < 20
    n = s.counts["steps"]
    assert np.allclose(s.t, 0.1 * np.array([*range(0, n, 4), n]), rtol=1e-15)
    assert pb.integrate("pendulum", slow, h=0.1, steps=3, time_limit=60).status == "ok"


def test_kepler_part_of_a_bare_system_is_found():
    """A Wisdom-Holman method, which `advise` may name, runs on a Kepler problem given by its formula only."""
    system = pb.Hamiltonian(q="x y", p="u v", H="(u**2 + v**2)/2 - 1/sqrt(x**2 + y**2)")
    start = {"q0": [1.0, 0.0], "p0": [0.0, 1.1]}
    end = pb.integrate(system, "wisdom-holman", h=5.0, t_end=10.0, **start)
    exact = pb.integrate(system, "gauss-8", h=0.05, t_end=10.0, **start)
    np.testing.assert_allclose(end.q[-1], exact.q[-1], atol=1e-12)
    q, _, status = pb.prepare(system, "wisdom-holman", **start)(5.0, 2)
    assert status == "ok"
    np.testing.assert_array_equal(q, end.q[-1])
    with pytest.raises(InvalidInput, match="Kepler part"):
        pb.integrate(pb.Hamiltonian(q="x", p="u", H="u**2/2 + x**4"), "wisdom-holman", h=1, steps=1, q0=[1.0], p0=[0.0])


# -- ensembles and sections --------------------------------------------------------------------------------------------

STARTS = np.array([[0.1], [np.nan], [2.0], [1e3]])


def test_ensemble_and_section_of_a_user_step_are_those_of_the_method():
    still = np.zeros((4, 1))
    wide, few = (np.hstack([STARTS, still]), np.hstack([still, still])), (STARTS[::2], still[:2])
    for method in (leapfrog, "stormer-verlet"):
        found = pb.integrate_ensemble("henon-heiles", method, *wide, h=0.1, steps=90)
        assert found.status.tolist() == ["ok", "invalid", "diverged", "diverged"]
    mine, ours = (
        pb.integrate_ensemble("pendulum", m, *few, h=0.1, steps=50, save_every=7) for m in (leapfrog, "stormer-verlet")
    )
    assert (mine.status.tolist(), mine.Q.shape, mine.counts["steps"]) == (["ok", "ok"], (2, 9, 1), 100)
    np.testing.assert_allclose(mine.Q, ours.Q, atol=1e-12)
    np.testing.assert_array_equal(mine.times, ours.times)
    alone = pb.integrate("pendulum", "stormer-verlet", h=0.1, steps=50, q0=[2.0], p0=[0.0])
    assert np.abs(ours.Q[1, -1] - alone.q[-1]).max() < 1e-14
    mine, ours = (pb.section("pendulum", m, *few, of="q", h=0.1, t_end=20.0) for m in (leapfrog, "stormer-verlet"))
    np.testing.assert_array_equal(mine.orbit, ours.orbit)
    np.testing.assert_allclose(mine.t, ours.t, atol=1e-11)
    # From rest at 1 the period is 6.7: q crosses 0 upwards at 3/4 of each period, three times until t = 20.
    assert pb.section("pendulum", "rk4", [[1.0]], [[0.0]], of="q", h=0.1, t_end=20.0).counts().tolist() == [3]


@pytest.mark.parametrize(
    ("method", "options", "words"),
    [
        ("heyoka", {}, "one orbit at a time"),
        (leapfrog, {"lanes": True}, "does not run in lanes"),
        (leapfrog, {"parameters": {"lam": 1}}, "no parameters"),
        ("rk44", {}, "did you mean rk4"),
    ],
)
def test_method_that_integrates_no_ensemble_is_refused(method, options, words):
    with pytest.raises(InvalidInput, match=words):
        pb.integrate_ensemble("pendulum", method, [[1.0]], [[0.0]], h=0.1, steps=1, **options)


def test_ensembles_and_sections_as_frames_and_figures():
    starts = np.array([[0.0, 0.1], [0.0, 0.2], [9.0, 9.0]]), np.tile([0.3, 0.0], (3, 1))
    found = pb.integrate_ensemble("henon-heiles", "stormer-verlet", *starts, h=0.1, steps=90)
    frame = found.to_frame()
    assert list(frame) == ["t", "q1", "q2", "p1", "p2", "h", "status", "reason"]
    np.testing.assert_array_equal(frame[["q1", "q2"]], found.q)
    assert "2 ok, 1 diverged" in repr(found)
    assert sum(len(line.get_xdata()) for line in found.plot().axes[0].lines) == 3
    crossings = pb.section("henon-heiles", "stormer-verlet", *starts, of="q1", h=0.1, t_end=40.0)
    assert crossings.to_frame()["orbit"].tolist() == crossings.orbit.tolist()
    drawn = np.vstack([line.get_xydata() for line in crossings.plot().axes[0].lines])
    np.testing.assert_array_equal(drawn, np.column_stack([crossings.q[:, 1], crossings.p[:, 1]]))
    with pytest.raises(InvalidInput, match="one degree of freedom"):
        pb.section("pendulum", "rk4", [[1.0]], [[0.0]], of="q", h=0.1, steps=10).plot()


# -- a solution --------------------------------------------------------------------------------------------------------


PENDULUM = pb.Hamiltonian(q="q", p="p", H="p**2/2 - cos(q)")


def swing(**options):
    return pb.integrate(PENDULUM, "stormer-verlet", **{"h": 0.1, "steps": 20, "q0": [1.0], "p0": [0.5]} | options)


def test_error_is_against_a_finer_run():
    s = pb.integrate(PENDULUM, "stormer-verlet", t_end=5.0, q0=[1.0], p0=[0.5], h=0.25)
    exact = pb.integrate(PENDULUM, "gauss-8", t_end=5.0, h=0.05, q0=[1.0], p0=[0.5])
    expected = max(abs(s.q[-1] - exact.q[-1]).max(), abs(s.p[-1] - exact.p[-1]).max())
    found = s.error()
    assert found.error == pytest.approx(expected, abs=1e-13)
    assert 0 < found.uncertainty < 1e-14
    assert (found.horizon, found.source, found.reason) == (5.0, "long double", "")


def test_failed_run_has_no_error():
    away = pb.integrate("henon-heiles:box", "stormer-verlet", h=0.1, t_end=100, q0=[3, 3], p0=[0, 0])
    assert away.status == "diverged"
    with pytest.raises(pb.InvalidInput, match="diverged"):
        away.error()


def test_plot_draws_the_energy_error_and_the_orbit():
    s = swing()
    energy, orbit = s.plot().axes
    np.testing.assert_array_equal(energy.lines[0].get_ydata(), s.energy() - s.energy()[0])
    np.testing.assert_array_equal(orbit.lines[0].get_xydata(), np.hstack([s.q, s.p]))
    wide = pb.integrate("henon-heiles:box", "rk4", h=0.1, steps=9)
    np.testing.assert_array_equal(wide.plot().axes[1].lines[0].get_xydata(), wide.q)


def test_frame_has_the_variables_by_name():
    s = swing()
    frame = s.to_frame()
    assert list(frame) == ["t", "q", "p", "energy"]
    np.testing.assert_array_equal(frame[["t", "q", "p"]].to_numpy(), np.column_stack([s.t, s.q, s.p]))
    np.testing.assert_array_equal(frame["energy"], s.energy())
