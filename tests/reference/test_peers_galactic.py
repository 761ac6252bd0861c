"""The integrators of galpy and gala as peers: list, orders, steps, restrictions."""

from __future__ import annotations

import inspect
import os
import re
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache, partial

import numpy as np
import pytest

from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian, InvalidInput, integrate
from phasebench.reference.peers import Task, gala, galpy, integrate_peer
from phasebench.reference.peers.galactic import is_henon_heiles, powers
from phasebench.reference.solvers import taylor
from phasebench.reference.solvers.taylor import reference
from support.needs import need

PEERS = {p.id: p for p in (*galpy.PEERS, *gala.PEERS)}
FIXED = [p for p in PEERS.values() if not p.adaptive]
ADAPTIVE = [p for p in PEERS.values() if p.adaptive]
#: Problem -> (end, steps of the coarser run).
SPANS = {
    "kepler": (3.0, 160),
    "perturbed-kepler": (3.0, 160),
    "henon-heiles": (3.0, 24),
    "harmonic-oscillator": (3.0, 20),
    "duffing": (3.0, 48),
    "pendulum": (3.0, 48),
    "toda": (1.0, 64),
    "charged-particle": (3.0, 24),
    "figure-eight": (1.0, 40),
    "outer-solar-system": (4000.0, 40),
}


@lru_cache(maxsize=32)
def truth(name):
    """Reference states at the quarters of a problem's time span."""
    end, steps = SPANS[name]
    return reference(problem(name), [end / steps * (steps // 4) * k for k in range(5)], certify=False)


def solve(name, peer, refinement=1, tol=None):
    """A peer's solution with rows at the quarters of the problem's span; fail if its status is not "ok"."""
    end, steps = SPANS[name]
    steps *= refinement
    s = integrate_peer(problem(name), peer, h=end / steps, steps=steps, save_every=steps // 4, tol=tol)
    assert s.status == "ok", (peer.id, s.reason)
    assert s.seconds > 0
    return s


def error(name, solution) -> float:
    """Largest error of a solution against the reference."""
    rows = truth(name)
    np.testing.assert_allclose(solution.t, rows.t, rtol=1e-14)
    return float(np.abs(np.hstack([solution.q - rows.q, solution.p - rows.p])).max())


def able(peers):
    """Test parameters (peer, problem) for all problems that each peer can integrate."""
    return [
        pytest.param(p, name, id=f"{p.id}:{name}")
        for p in peers
        for name in SPANS
        if p.lacks(problem(name), problem(name).system) is None
    ]


def test_each_integrator_has_a_record():
    need("galpy")
    offered = set(re.findall(r"- +'(\w+)' for", inspect.getdoc(galpy.load().orbit.Orbit.integrate)))
    assert len(offered) > 9
    assert {p.id for p in galpy.PEERS} == {f"galpy-{m.replace('_', '-')}" for m in offered}
    module = pytest.importorskip("gala.integrate")
    classes = {n for n in vars(module) if n.endswith("Integrator")}
    assert classes == {gala.LEAPFROG, gala.RUTH4, gala.RK5, gala.DOPRI853}
    assert {p.id for p in gala.PEERS if not p.id.endswith("cython")} == {
        f"gala-{n.removesuffix('Integrator').lower()}" for n in classes
    }


def test_the_order_equals_the_one_in_the_name():
    named = [(p.order, re.search(r"order (\d+)", p.name)) for p in PEERS.values()]
    said = [(order, int(found.group(1))) for order, found in named if found]
    assert len(said) > 10
    assert all(order == number for order, number in said)


@pytest.mark.parametrize(("peer", "name"), able(FIXED))
def test_a_fixed_step_peer_has_its_order(peer, name):
    need(peer.package)
    runs = [solve(name, peer, k) for k in (1, 2)]
    assert [s.counts["steps"] for s in runs] == [SPANS[name][1], 2 * SPANS[name][1]]
    coarse, fine = (error(name, s) for s in runs)
    assert fine > 1e-14
    assert abs(np.log2(coarse / fine) - peer.order) < 0.25, (coarse, fine)


@pytest.mark.parametrize(("peer", "name"), able(ADAPTIVE))
def test_a_tolerance_is_met(peer, name):
    need(peer.package)
    tight = error(name, solve(name, peer, tol=1e-12))
    assert tight < 2e-9
    if peer.id != "galpy-ias15-c":  # galpy's IAS15 ignores its tolerance
        assert error(name, solve(name, peer, tol=1e-6)) > tight or peer.id == "gala-dopri853"


@pytest.mark.parametrize("peer", PEERS.values(), ids=PEERS)
def test_a_wrong_sign_or_strength_of_the_force_is_seen(peer):
    need(peer.package)
    name = "kepler"
    s = solve(name, peer)
    right = error(name, s)
    for factor in ("-1", "1.01"):
        wrong = Hamiltonian(q="x y", p="u v", H=f"(u**2 + v**2)/2 - ({factor})/sqrt(x**2 + y**2)")
        start = {"q0": problem(name).q0, "p0": problem(name).p0}
        other = integrate_peer(wrong, peer, h=s.h, steps=SPANS[name][1], save_every=SPANS[name][1] // 4, **start)
        assert error(name, other) > 0.02 > 2 * right


@pytest.mark.parametrize("name", ["kepler", "perturbed-kepler", "henon-heiles", "harmonic-oscillator", "duffing"])
@pytest.mark.parametrize(
    ("id", "ours", "other"),
    [
        ("galpy-leapfrog", "stormer-verlet-dkd", "stormer-verlet"),
        ("galpy-leapfrog-c", "stormer-verlet-dkd", "stormer-verlet"),
        ("gala-leapfrog", "stormer-verlet", "stormer-verlet-dkd"),
        ("gala-leapfrog-cython", "stormer-verlet", "stormer-verlet-dkd"),
    ],
)
def test_leapfrog_takes_the_same_steps_as_ours(id, ours, other, name):
    peer = PEERS[id]
    need(peer.package)
    if peer.lacks(problem(name), problem(name).system):
        pytest.skip("not its potential")
    s = integrate_peer(problem(name), peer, h=0.01, steps=300)
    same, different = (integrate(problem(name), m, h=0.01, steps=300) for m in (ours, other))
    bound = 1e-11 if id == "galpy-leapfrog" else 2e-13  # galpy computes the angle by arccos
    assert np.abs(np.hstack([s.q - same.q, s.p - same.p])).max() < bound
    assert np.abs(np.hstack([s.q - different.q, s.p - different.p])).max() > 1e-7


@pytest.mark.parametrize("peer", PEERS.values(), ids=PEERS)
def test_stored_rows_do_not_change_the_steps(peer):
    need(peer.package)
    h, n = 0.0875, 18
    assert int(3 * h / h) == 2  # 3 h / h is rounded below 3, which galpy's C code would truncate to 2
    options = {"h": h, "steps": n, "tol": 1e-12 if peer.adaptive else None}
    whole = integrate_peer(problem("henon-heiles"), peer, **options)
    for every in (3, 5, 0):
        some = integrate_peer(problem("henon-heiles"), peer, **options, save_every=every)
        where = [round(x / h) for x in some.t]
        assert where == [*range(0, n, every or n), n]
        assert np.abs(some.q - whole.q[where]).max() < (1e-10 if peer.adaptive else 1e-14)
    assert (whole.q[0] == problem("henon-heiles").q0).all()


def test_the_number_of_steps_to_a_row_is_not_truncated():
    """galpy's C code would take two steps of 0.1 to a row at 0.3, so rows are requested slightly later."""
    need("galpy")
    assert int(0.3 / 0.1) == 2

    def asked(h, stride):
        """(times requested from galpy, steps between rows, options) for steps h and a row every ``stride`` steps."""
        start, system = np.zeros(2), problem("henon-heiles").system
        return galpy._times("leapfrog_c", False, Task(system, system, start, start, h, [0, stride], [0.0], None))

    _, every, options = asked(0.1, 3)
    assert (every, options) == (3, {"dt": 0.1})
    for h in (0.1, 0.3, 1e-3, 0.7, 2.0 / 3):
        for stride in (1, 2, 3, 7, 1000):
            times, every, _ = asked(h, stride)
            assert int((times[1] - times[0]) / h) == stride == every


@pytest.mark.parametrize(
    ("id", "name", "what"),
    [
        ("galpy-leapfrog-c", "pendulum", "Henon-Heiles"),
        ("galpy-dop853-c", "toda", "Henon-Heiles"),
        ("galpy-leapfrog", "charged-particle", "alone"),
        ("galpy-dop853", "figure-eight", "d is 1, 2 or 3, not 6"),
        ("galpy-odeint", "lotka-volterra", "alone"),
        ("gala-leapfrog", "charged-particle", "p.M"),
        ("gala-ruth4", "double-pendulum", "p.M"),
        ("gala-leapfrog", "lotka-volterra", "p.M"),
        ("gala-ruth4-cython", "perturbed-kepler", "in C"),
        ("gala-dopri853-cython", "pendulum", "in C"),
    ],
)
def test_unsupported_problems_are_refused_with_a_reason(id, name, what):
    with pytest.raises(InvalidInput, match=re.escape(what)):
        integrate_peer(problem(name), PEERS[id], h=0.1, steps=3)


def test_a_substituted_method_is_a_failure():
    need("galpy")
    times = np.array([0.0, 0.1])
    for method, what in (("rk4_c", "using odeint instead"), ("symplec4_c", "using leapfrog instead")):
        rows, _, failure = galpy._integrate(
            method, galpy._python_potential(problem("pendulum").system), [1.0, 0.0], times, {}
        )
        assert rows is None
        assert what in failure


KEPLER_IN_SPACE = Hamiltonian(q="x y z", p="u v w", H="(u**2 + v**2 + w**2)/2 - 3/(2*sqrt(x**2 + y**2 + z**2))")


@pytest.mark.parametrize("id", ["galpy-leapfrog", "galpy-symplec4-c", "gala-leapfrog", "gala-ruth4-cython"])
def test_keplers_problem_in_space(id):
    """A circle of radius 2 in a tilted plane around a mass of 3/2."""
    peer = PEERS[id]
    need(peer.package)
    speed, h = np.sqrt(0.75), 2e-3
    along = np.array([0.6, 0.0, 0.8])
    s = integrate_peer(KEPLER_IN_SPACE, peer, h=h, steps=100, q0=[0.0, 2.0, 0.0], p0=-speed * along)
    angle = s.t * speed / 2
    exact = 2 * (np.cos(angle)[:, None] * [0.0, 1.0, 0.0] - np.sin(angle)[:, None] * along)
    assert np.abs(s.q - exact).max() < 1e-6
    assert np.abs(np.hypot(s.p[:, 1], s.p @ along) - speed).max() < 1e-6


def test_potentials_are_recognized():
    assert powers(problem("perturbed-kepler").system) == ((-1.0, -1.0), (-0.0025, -3.0))
    assert powers(problem("duffing").system) == ((-0.5, 2.0), (0.25, 4.0))
    assert is_henon_heiles(problem("henon-heiles").system)
    for H in ("(u**2 + v**2)/2 + x**2/2 + y**2", "(u**2 + v**2)/2 + x*y", "(u**2 + 2*v**2)/2 - 1/sqrt(x**2 + y**2)"):
        assert not powers(Hamiltonian(q="x y", p="u v", H=H))
    for V, wanted in (
        ("x**2 + y**2", ((1.0, 2.0),)),
        ("sqrt(x**2 + y**2) + 7", ((1.0, 1.0),)),  # a constant adds no force
        ("(x**2 + y**2)**2", ((1.0, 4.0),)),
    ):
        assert powers(Hamiltonian(q="x y", p="u v", H=f"(u**2 + v**2)/2 + {V}")) == wanted
    assert powers(KEPLER_IN_SPACE) == ((-1.5, -1.0),)
    in_four = Hamiltonian(q="x y z w", p="a b c d", H="(a**2 + b**2 + c**2 + d**2)/2 + x**2 + y**2 + z**2 + w**2")
    assert powers(in_four) is None
    assert powers(Hamiltonian(q="x", p="u", H="u**2/2 + x**3")) is None
    for V in ("cos(x)", "exp(-x**2)", "x**2 + exp(-x**2)"):
        assert powers(Hamiltonian(q="x", p="u", H=f"u**2/2 + {V}")) is None
    near = Hamiltonian(q="x y", p="u v", H="(u**2 + v**2)/2 + (x**2 + y**2)/2 + x**2*y - y**3/4")
    assert not is_henon_heiles(near)


@pytest.mark.parametrize("id", [p.id for p in galpy.PEERS if p.adaptive])
def test_galpy_is_not_called_where_it_would_hang(id):
    need("galpy")
    runaway = Hamiltonian(q="q", p="p", H="p**2/2 - q**4/4")
    for system, q, p in (
        (problem("kepler"), [1.0, 0.0], [0.0, 0.0]),
        (runaway, [1.0], [1.0]),
        (problem("henon-heiles"), [0.0, 0.0], [0.1, 0.2]),
        (problem("duffing"), [0.0], [0.4]),
    ):
        s = integrate_peer(system, PEERS[id], t_end=3.0, steps=10, q0=q, p0=p)
        on_a_line = system is problem("duffing") and not id.endswith("-c")  # Python handles lines
        assert s.status == ("ok" if on_a_line else "diverged")
        assert on_a_line or "galpy" in s.reason


QUIET = """
from phasebench.reference.peers import galpy
import numpy as np, signal
potential = galpy.load().potential.toPlanarPotential(galpy.load().potential.KeplerPotential())
try:
    galpy._integrate("leapfrog_c", potential, [1.0, 0.0, 1.2, 0.0], np.array([0.0, 0.1]), {})
    signal.raise_signal(signal.SIGINT)
except KeyboardInterrupt:
    print("interrupted")
"""


@pytest.mark.parametrize(("text", "calls"), [(QUIET, False), ("import galpy", True)], ids=["ours", "its own"])
def test_galpy_makes_no_request_and_leaves_interrupts_alone(tmp_path, text, calls):
    need("galpy")
    trap = """
import socket
def connect(*arguments, **options):
    raise SystemExit("network")
socket.create_connection = connect
"""
    environment = os.environ | {"HOME": str(tmp_path), "USERPROFILE": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", trap + text], capture_output=True, text=True, env=environment)
    assert ("network" in done.stderr) == calls, done.stderr
    assert ("interrupted" in done.stdout) != calls, done.stderr


def test_a_failure_of_galas_c_loop_is_reported():
    need("gala")
    s = integrate_peer(problem("kepler"), "gala-dopri853-cython", t_end=2.0, steps=4, q0=[1.0, 0.0], p0=[0.0, 0.0])
    assert (s.status, len(s.t)) == ("diverged", 1)
    assert (s.counts["steps"], s.counts["gradient"]) == (0, 0)
    assert s.seconds > 0


def test_only_the_main_thread_restores_the_interrupt_handler(monkeypatch):
    """In other threads Python does not allow it."""
    need("galpy")
    put, times, potential = [], np.array([0.0, 0.1]), galpy._builtin_potential(problem("kepler").system)
    monkeypatch.setattr(galpy.signal, "signal", lambda *arguments: put.append(arguments))
    run = partial(galpy._integrate, "leapfrog_c", potential, [1.0, 0.0, 1.2, 0.0], times, {})
    run()
    monkeypatch.undo()
    mine = signal.getsignal(signal.SIGINT)
    signal.signal(signal.SIGINT, mine)
    assert (signal.SIGINT, mine) in put
    monkeypatch.setattr(galpy.signal, "signal", lambda *arguments: put.append(arguments))
    put.clear()
    with ThreadPoolExecutor(1) as pool:
        ran = pool.submit(run)
    monkeypatch.undo()
    signal.signal(signal.SIGINT, mine)
    ran.result()  # raises what the run raised
    assert put == []


@pytest.mark.parametrize(("lost", "hopeless"), [(0.9e-6, False), (1.1e-6, True)])
def test_the_energy_error_at_which_heyoka_gives_up(lost, hopeless, monkeypatch):
    """The limit is 1e-6 (1 + |H|), with |H| = 1/2 here."""
    q, p = (1.0, 0.0), (0.0, 1.0)
    rows = np.array([[*q, *p], [*q, 0.0, np.sqrt(1.0 + 3.0 * lost)]])
    monkeypatch.setattr(taylor, "propagate", lambda ta, times: (rows, 1, None))
    assert (galpy._hopeless.__wrapped__(problem("kepler").system, q, p, 1.0) is not None) == hopeless


def test_dopri853_has_order_8_despite_its_docstring():
    integrators = pytest.importorskip("gala.integrate")
    assert "5th-order accurate" in re.sub(r"\s+", " ", integrators.DOPRI853Integrator.__doc__)
    system, errors = problem("henon-heiles"), []
    q = reference(system, [3.0], certify=False).q[0]
    function = gala._function(system.system, gala.DOPRI853, [0])
    for n in (5, 10):  # SciPy's dop853 restarts at every row, so one step of h each
        options = {"first_step": 3.0 / n, "max_step": 3.0 / n, "rtol": 1e9, "atol": 1e9}
        method = integrators.DOPRI853Integrator(function, **options)
        errors.append(np.abs(method([*system.q0, *system.p0], dt=3.0 / n, n_steps=n).w()[:2, -1] - q).max())
    assert 7.5 < np.log2(errors[0] / errors[1]) < 9.5
