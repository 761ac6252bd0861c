"""`Integrator`, one interface to methods, peers and the user's steps; the public functions that use it."""

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


@pytest.mark.parametrize("named", ["henon-heiles:box", HENON])
def test_prepared_run_equals_the_integration(named):
    run = pb.prepare(named, "stormer-verlet")
    q, p, status = run(0.1, 20)
    ours = integrate(HENON, "stormer-verlet", h=0.1, steps=20)
    assert status == "ok"
    assert np.abs(np.concatenate([q - ours.q[-1], p - ours.p[-1]])).max() < 1e-14


# -- kinds of integrator ----------------------------------------------------------------------------------------------


def test_properties_by_kind_of_integrator(file):
    path = file(VERLET)
    kinds = [integrator(x) for x in ("rk4", "heyoka", "rebound-leapfrog", path, leapfrog)]
    assert [k.kind for k in kinds] == [OURS, "heyoka", "rebound", YOURS, YOURS]
    assert [k.label for k in kinds] == ["rk4", "heyoka", "rebound-leapfrog", path, "leapfrog"]
    assert [k.name for k in kinds[1:]] == [peer("heyoka").name, peer("rebound-leapfrog").name, path, "leapfrog"]
    assert [k.order for k in kinds] == [4, None, 2, 2, None]
    assert [k.adaptive for k in kinds] == [False, True, False, False, False]
    assert [k.stoppable for k in kinds] == [True, False, False, True, True]
    assert all(integrator(k) == k and integrator(k.record) == k for k in kinds)


def test_claims_come_from_each_record(file):
    path = file(VERLET)
    ours, theirs, own = (integrator(x).claims for x in ("stormer-verlet", "rebound-leapfrog", path))
    assert (ours.order, ours.symplectic, ours.reversible, ours.energy) == (2, True, True, record.BOUNDED)
    assert theirs == peer("rebound-leapfrog").claims
    assert (own.order, own.symplectic, own.reversible, own.energy, own.source) == (2, True, None, record.BOUNDED, path)


def test_loading_imports_only_packages_of_peers(file):
    seen = []
    spied = replace(peer("rebound-leapfrog"), load=seen.append)
    for each in ("rk4", leapfrog, spied):
        integrator(each).load()
    assert seen == ["rebound"]


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


def test_user_step_can_be_pickled(file):
    for own in (leapfrog, file(VERLET)):
        sent = pickle.loads(pickle.dumps(integrator(own)))
        assert (sent.id, sent.order) == (integrator(own).id, integrator(own).order)
        assert sent.run(HENON, h=0.1, steps=3).q[-1].tolist() == pb.integrate(HENON, own, h=0.1, steps=3).q[-1].tolist()


def test_step_can_evaluate_the_energy():
    seen = []

    def step(system, q, p, h):
        seen.append((system.d, system.H(q, p)))
        return leapfrog(system, q, p, h)

    s = pb.integrate(HENON, step, h=0.1, steps=3)
    assert [d for d, _ in seen] == [2, 2, 2]
    assert [H for _, H in seen] == HENON.system.observe(HENON.system.H, s.q, s.p)[:3].tolist()


def test_user_step_on_a_large_system():
    made = problem("nls")  # states of this size are arrays in compiled code
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


def test_peers_and_methods_by_the_public_functions():
    assert np.array_equal(
        pb.integrate("henon-heiles:box", "heyoka", t_end=3.0, tol=1e-12).q,
        integrate_peer(HENON, "heyoka", t_end=3.0, tol=1e-12).q,
    )
    pendulum = pb.Hamiltonian(q="q", p="p", H="p**2/2 - cos(q)")
    assert pb.integrate(pendulum, "heyoka", t_end=3.0, q0=[1.0], p0=[0.0]).status == "ok"
    s = pb.integrate("pendulum", "scheme-i", parameters={"lam": 0.25}, h=0.1, steps=5)
    assert np.array_equal(s.q, integrate(problem("pendulum"), pb.method("scheme-i", lam="1/4"), h=0.1, steps=5).q)
    assert not np.array_equal(s.q, pb.integrate("pendulum", "scheme-i", h=0.1, steps=5).q)


def test_problem_and_step_from_files(file, tmp_path):
    (tmp_path / "pendulum.py").write_text(
        "from phasebench import Hamiltonian\nfrom phasebench.benchmarks.problems.base import Orbit, Problem\n"
        "problem = Problem(id='mine', name='pendulum', source='own', orbits=(Orbit('start', 2, 0),),\n"
        "    system=Hamiltonian(q='q', p='p', H='p**2/2 - cos(q)'))\n"
    )
    s = pb.integrate(tmp_path / "pendulum.py", file(VERLET), h=0.1, steps=5)
    assert s.status == "ok"
    assert s.q[0] == [2.0]


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
def test_parameter_keeps_its_exact_value(value, meaning):
    found = pb.method("scheme-i", lam=value).parameters["lam"]
    assert found == meaning
    assert type(found) is (Fraction if isinstance(meaning, Fraction) or meaning == -1 else float)


@pytest.mark.parametrize("value", [np.bool_(True), np.array([0.5, 1.0]), np.float64("nan"), np.complex128(1)])
def test_parameter_that_is_no_number_is_refused(value):
    with pytest.raises(InvalidInput, match="lam is"):
        pb.method("scheme-i", lam=value)


# -- invalid input ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "method", "more", "message"),
    [
        ("pendulm", "rk4", {}, "did you mean pendulum"),
        (3, "rk4", {}, "the problem is 3"),
        ("pendulum", "rk44", {}, "did you mean rk4"),
        ("pendulum", "heyok", {}, "did you mean heyoka"),
        ("pendulum", 3, {}, "the method is 3"),
        ("pendulum", "rk4", {"tend": 1}, "did you mean t_end"),
        ("pendulum", "scheme-i", {"parameters": {"lamda": 1}}, "has no parameter 'lamda'; it has lam"),
        ("pendulum", "scheme-i", {"lamda": 1}, r"unknown argument lamda; did you mean parameters=\{'lam': 1\}"),
        ("pendulum", "scheme-i", {"stepz": 3}, r"unknown argument stepz; did you mean steps\?"),
        ("pendulum", "scheme-i", {"bound": 3}, "unknown argument bound; integrate takes problem, method, h"),
        ("pendulum", "scheme-i", {"parameters": "lam=1"}, "it must map names to values"),
        ("pendulum", "heyoka", {"parameters": {"lam": 1}}, "no parameters such as lam; it takes h or tol"),
        ("pendulum", leapfrog, {"parameters": {"lam": 1}}, "no parameters such as lam; it takes h"),
        ("pendulum", "heyoka", {"timeout": 3}, "cannot be stopped"),
        ("pendulum", "rk4", {"tol": 1e-3}, "takes a step h, no tolerance"),
        ("pendulum", leapfrog, {"tol": 1e-3}, "takes a step h, no tolerance"),
        ("pendulum", leapfrog, {"timeout": 0}, "positive number of seconds"),
        ("pendulum", leapfrog, {"save_every": -1}, "save_every is -1"),
        ("pendulum", leapfrog, {"q0": np.array([1j])}, "must be numbers"),
        ("pendulum", lambda q: q, {}, r"step\(system, q, p, h\)"),
        ("lotka-volterra", leapfrog, {}, "canonical"),
    ],
)
def test_invalid_input_is_named(name, method, more, message):
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
def test_error_in_a_step_is_named_with_its_line(file, line, words):
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
def test_error_in_a_file_is_named(file, text, words):
    path = file(text)
    with pytest.raises(InvalidInput) as caught:
        pb.integrate(HENON, path, h=0.1, steps=3)
    for word in words:
        assert word in str(caught.value)


def test_missing_file_is_named():
    with pytest.raises(InvalidInput, match=r"there is no file \./none\.py; names of registered methods"):
        pb.integrate(HENON, "./none.py", h=0.1, steps=3)


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


def test_fall_into_the_centre_is_a_collision():
    s = pb.integrate("kepler", leapfrog, h=0.01, t_end=5, q0=[1, 0], p0=[0, 0])
    assert s.status == "collision"
    assert pb.integrate("kepler", leapfrog, h=0.01, t_end=5, q0=[1, 0], p0=[0, 1]).status == "ok"


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


def test_output_of_a_step_goes_to_stderr(capsys):
    def step(system, q, p, h):
        print("hello")
        return q, p

    pb.integrate("pendulum", step, h=0.1, steps=1)
    captured = capsys.readouterr()
    assert (captured.out, captured.err) == ("", "hello\n")


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
