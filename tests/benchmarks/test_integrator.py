"""One `Integrator`, whatever integrates: a method, a peer, a step of the user's own; and the public face over it."""

from __future__ import annotations

import pickle
import time
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.measure.integrator import OURS, YOURS, integrator
from phasebench.benchmarks.problems import problem
from phasebench.integrators import record
from phasebench.integrators.driver import integrate
from phasebench.integrators.errors import InvalidInput
from phasebench.reference.peers import integrate_peer, peer

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
    """text -> the path of a file with it."""

    def write(text: str) -> str:
        (tmp_path / "mine.py").write_text(text)
        return str(tmp_path / "mine.py")

    return write


def verlet(system, q, p, h):
    p = p - h / 2 * system.dH_dq(q, p)
    q = q + h * system.dH_dp(q, p)
    return q, p - h / 2 * system.dH_dq(q, p)


# -- one run, whatever it is ------------------------------------------------------------------------------------------


def test_what_an_integrator_is(file):
    path = file(VERLET)
    kinds = [integrator(x) for x in ("rk4", "heyoka", "rebound-leapfrog", path, verlet)]
    assert [k.kind for k in kinds] == [OURS, "heyoka", "rebound", YOURS, YOURS]
    assert [k.label for k in kinds] == ["rk4", "heyoka", "rebound-leapfrog", path, "verlet"]
    assert [k.order for k in kinds] == [4, None, 2, 2, None]
    assert [k.adaptive for k in kinds] == [False, True, False, False, False]
    assert [k.stoppable for k in kinds] == [True, False, False, True, True]
    assert all(integrator(k) == k and integrator(k.record) == k for k in kinds)


def test_what_is_claimed_is_what_each_says_of_itself(file):
    path = file(VERLET)
    ours, theirs, own = (integrator(x).claims for x in ("stormer-verlet", "rebound-leapfrog", path))
    assert (ours.order, ours.symplectic, ours.reversible, ours.energy) == (2, True, True, record.BOUNDED)
    assert theirs == peer("rebound-leapfrog").claims
    assert (own.order, own.symplectic, own.reversible, own.energy, own.source) == (2, True, None, record.BOUNDED, path)


def test_loading_imports_the_package_of_a_peer_alone(file):
    seen = []
    spied = replace(peer("rebound-leapfrog"), load=seen.append)
    for each in ("rk4", verlet, spied):
        integrator(each).load()
    assert seen == ["rebound"]


@pytest.mark.parametrize("every", [1, 7, 0])
def test_a_step_of_ones_own_is_what_the_method_is(file, every):
    ours = integrate(HENON, "stormer-verlet", h=0.1, t_end=10, save_every=every)
    for own in (verlet, file(VERLET)):
        s = pb.integrate(HENON, own, h=0.1, t_end=10, save_every=every)
        assert (s.status, s.reason) == ("ok", "")
        assert np.array_equal(s.t, ours.t)
        assert np.abs(np.hstack([s.q - ours.q, s.p - ours.p])).max() < 1e-13
        assert s.counts == {"steps": 100, "gradient": 200, "hessian": 0, "iterations": 0, "fallbacks": 0}
    other = pb.integrate(HENON, lambda system, q, p, h: verlet(system, q, p, 1.001 * h), h=0.1, t_end=10)
    assert np.abs(other.q[-1] - ours.q[-1]).max() > 1e-4


def test_a_step_of_ones_own_can_be_sent_to_another_process(file):
    for own in (verlet, file(VERLET)):
        sent = pickle.loads(pickle.dumps(integrator(own)))
        assert (sent.id, sent.order) == (integrator(own).id, integrator(own).order)
        assert sent.run(HENON, h=0.1, steps=3).q[-1].tolist() == pb.integrate(HENON, own, h=0.1, steps=3).q[-1].tolist()


def test_a_step_sees_the_energy_of_the_system():
    seen = []

    def step(system, q, p, h):
        seen.append((system.d, system.H(q, p)))
        return verlet(system, q, p, h)

    s = pb.integrate(HENON, step, h=0.1, steps=3)
    assert [d for d, _ in seen] == [2, 2, 2]
    assert [H for _, H in seen] == HENON.system.observe(HENON.system.H, s.q, s.p)[:3].tolist()


def test_large_systems_and_plain_files_are_stepped_too():
    made = problem("nls")  # its states are arrays in compiled code
    ours, control = (integrate(made, id, h=1e-3, steps=5) for id in ("rk4", "explicit-euler"))

    def rk4(system, q, p, h):
        def slope(y):
            return np.array([system.dH_dp(*y), -system.dH_dq(*y)])

        y = np.array([q, p])
        a = slope(y)
        b = slope(y + h / 2 * a)
        c = slope(y + h / 2 * b)
        return tuple(y + h / 6 * (a + 2 * b + 2 * c + slope(y + h * c)))

    s = pb.integrate(made, rk4, h=1e-3, steps=5)
    assert np.abs([s.q - ours.q, s.p - ours.p]).max() < 1e-12
    assert np.abs([s.q - control.q, s.p - control.p]).max() > 1e-9


def test_peers_and_methods_through_the_face():
    assert np.array_equal(
        pb.integrate("henon-heiles:box", "heyoka", t_end=3.0, tol=1e-12).q,
        integrate_peer(HENON, "heyoka", t_end=3.0, tol=1e-12).q,
    )
    pendulum = pb.Hamiltonian(q="q", p="p", H="p**2/2 - cos(q)")
    assert pb.integrate(pendulum, "heyoka", t_end=3.0, q0=[1.0], p0=[0.0]).status == "ok"
    s = pb.integrate("pendulum", "scheme-i", lam=0.25, h=0.1, steps=5)
    assert np.array_equal(s.q, integrate(problem("pendulum"), pb.method("scheme-i", lam="1/4"), h=0.1, steps=5).q)
    assert not np.array_equal(s.q, pb.integrate("pendulum", "scheme-i", h=0.1, steps=5).q)


def test_a_problem_may_be_a_file_beside_a_step(file, tmp_path):
    (tmp_path / "pendulum.py").write_text(
        "from phasebench import Hamiltonian\nfrom phasebench.benchmarks.problems.base import Orbit, Problem\n"
        "problem = Problem(id='mine', name='pendulum', source='own', orbits=(Orbit('start', 2, 0),),\n"
        "    system=Hamiltonian(q='q', p='p', H='p**2/2 - cos(q)'))\n"
    )
    s = pb.integrate(tmp_path / "pendulum.py", file(VERLET), h=0.1, steps=5)
    assert s.status == "ok"
    assert s.q[0] == [2.0]


@pytest.mark.parametrize(
    ("value", "meaning"),
    [
        (np.float64(1 / 3), 1 / 3),
        (np.float32(0.1), float(np.float32(0.1))),
        (np.float16(0.5), 0.5),
        (np.int64(-1), -1),
        (np.longdouble(1) / 3, Fraction(*(np.longdouble(1) / 3).as_integer_ratio())),
        (Fraction(1, 3), Fraction(1, 3)),
        ("1/3", Fraction(1, 3)),
        (0.1, 0.1),
    ],
)
def test_a_parameter_is_the_number_that_it_is_given_as(value, meaning):
    found = pb.method("scheme-i", lam=value).parameters["lam"]
    assert found == meaning
    assert type(found) is (Fraction if isinstance(meaning, Fraction) or meaning == -1 else float)


@pytest.mark.parametrize("value", [np.bool_(True), np.array([0.5, 1.0]), np.float64("nan"), np.complex128(1)])
def test_a_parameter_that_is_no_number_is_refused(value):
    with pytest.raises(InvalidInput, match="lam is"):
        pb.method("scheme-i", lam=value)


# -- what cannot be used ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "method", "more", "message"),
    [
        ("pendulm", "rk4", {}, "did you mean pendulum"),
        (3, "rk4", {}, "the problem is 3"),
        ("pendulum", "rk44", {}, "did you mean rk4"),
        ("pendulum", "heyok", {}, "did you mean heyoka"),
        ("pendulum", 3, {}, "the method is 3"),
        ("pendulum", "rk4", {"tend": 1}, "did you mean t_end"),
        ("pendulum", "scheme-i", {"lamda": 1}, "has no parameter 'lamda'; it has lam"),
        ("pendulum", "heyoka", {"lam": 1}, "no parameters such as lam; it takes h or tol"),
        ("pendulum", verlet, {"lam": 1}, "no parameters such as lam; it takes h"),
        ("pendulum", "heyoka", {"timeout": 3}, "cannot be stopped"),
        ("pendulum", "rk4", {"tol": 1e-3}, "takes a step h, no tolerance"),
        ("pendulum", verlet, {"tol": 1e-3}, "takes a step h, no tolerance"),
        ("pendulum", verlet, {"timeout": 0}, "positive number of seconds"),
        ("pendulum", verlet, {"save_every": -1}, "save_every is -1"),
        ("pendulum", verlet, {"q0": np.array([1j])}, "must be numbers"),
        ("pendulum", lambda q: q, {}, r"step\(system, q, p, h\)"),
        ("lotka-volterra", verlet, {}, "canonical"),
    ],
)
def test_what_cannot_be_used_is_named(name, method, more, message):
    with pytest.raises(InvalidInput, match=message):
        pb.integrate(name, method, h=0.1, steps=3, **more)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("return 1 / 0", ["line 2", "ZeroDivisionError"]),
        ("raise SystemExit", ["line 2", "SystemExit"]),
        ("q += h * system.dH_dp(q, p); return q, p", ["line 2", "write q = q + ..."]),
        ("q.flags.writeable = True; q += h; return q, p", ["line 2", "WRITEABLE"]),
        ("pass", ["step returned None"]),
        ("return q", ["step returned", "must return q, p"]),
        ("return q, p, h", ["must return q, p"]),
        ("return q[:1], p", ["q of shape (1,); it must be (2,)"]),
        ("return q, p[None]", ["p of shape (1, 2)"]),
        ("return q * 1j, p", ["real numbers"]),
        ("return q, 'p'", ["real numbers"]),
        ("return q, system.dH_dq(q[0], p)", ["line 2", "called with q of shape ()"]),
        ("return q, system.dV(q)", ["line 2", "AttributeError", "dV"]),
    ],
)
def test_what_is_wrong_in_a_step_is_named_with_its_line(file, line, words):
    path = file(f"def step(system, q, p, h):\n    {line}\n")
    with pytest.raises(InvalidInput) as caught:
        pb.integrate(HENON, path, h=0.1, steps=3)
    for word in (path, *words):
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x = 1\n", ["no function 'step'"]),
        ("step = 3\n", ["'step' that is a int"]),
        ("def step(:\n", ["line 1", "SyntaxError"]),
        ("import no_such_module\n", ["line 1", "ModuleNotFoundError"]),
        ("def step(q, p):\n    return q, p\n", ["step(system, q, p, h)"]),
        (VERLET + "CLAIMS = 2\n", ["CLAIMS is 2"]),
        (VERLET + "CLAIMS = {'order': 2.5}\n", ["order = 2.5", "positive integer"]),
        (VERLET + "CLAIMS = {'order': True}\n", ["positive integer"]),
        (VERLET + "CLAIMS = {'symplectic': 'yes'}\n", ["True or False"]),
        (VERLET + "CLAIMS = {'energy': 'good'}\n", ["one of preserved"]),
        (VERLET + "CLAIMS = {'simplectic': True}\n", ["did you mean symplectic"]),
        (VERLET + "REQUIRES = 3\n", ["REQUIRES is 3"]),
        (VERLET + "REQUIRES = 'seperable'\n", ["did you mean separable"]),
        (VERLET + "REQUIRES = 'Kepler part'\n", ["requires", "'Kepler part'"]),
    ],
)
def test_what_is_wrong_with_a_file_is_named(file, text, words):
    path = file(text)
    with pytest.raises(InvalidInput) as caught:
        pb.integrate(HENON, path, h=0.1, steps=3)
    for word in words:
        assert word in str(caught.value)


def test_a_file_that_is_not_there_is_named():
    with pytest.raises(InvalidInput, match=r"there is no file \./none\.py; names of registered methods"):
        pb.integrate(HENON, "./none.py", h=0.1, steps=3)


# -- what happens on the way ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("every", [1, 4, 0])
def test_a_state_that_is_no_longer_finite_has_diverged(every):
    def step(system, q, p, h):
        return q * 1e200, p

    s = pb.integrate("pendulum", step, h=0.5, steps=8, save_every=every)
    assert s.status == "diverged"
    assert "no longer finite" in s.reason
    assert np.isfinite(s.q).all()
    assert (len(s.t), s.counts["steps"]) == (2 if every == 1 else 1, 1)


def test_a_fall_into_the_centre_is_a_collision():
    s = pb.integrate("kepler", verlet, h=0.01, t_end=5, q0=[1, 0], p0=[0, 0])
    assert s.status == "collision"
    assert pb.integrate("kepler", verlet, h=0.01, t_end=5, q0=[1, 0], p0=[0, 1]).status == "ok"


def test_a_time_limit_keeps_the_rows_so_far():
    def slow(system, q, p, h):
        time.sleep(0.01)
        return verlet(system, q, p, h)

    s = pb.integrate("pendulum", slow, h=0.1, steps=10_000, save_every=4, timeout=0.15)
    assert s.status == "timeout"
    assert 4 <= s.counts["steps"] < 20
    n = s.counts["steps"]
    assert np.allclose(s.t, 0.1 * np.array([*range(0, n, 4), n]), rtol=1e-15)
    assert pb.integrate("pendulum", slow, h=0.1, steps=3, timeout=60).status == "ok"


def test_what_a_step_prints_is_no_output(capsys):
    def step(system, q, p, h):
        print("hello")
        return q, p

    pb.integrate("pendulum", step, h=0.1, steps=1)
    captured = capsys.readouterr()
    assert (captured.out, captured.err) == ("", "hello\n")
