"""galpy and gala as peers: which potentials they have, steps, rows, and where they would go wrong."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest

from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian
from phasebench.reference.peers import PEERS, Task, galpy, integrate_peer
from phasebench.reference.peers.forms import is_henon_heiles, powers
from support.needs import need

HENON = problem("henon-heiles")
IN_SPACE = Hamiltonian(q="x y z", p="u v w", H="(u**2 + v**2 + w**2)/2 - 3/(2*sqrt(x**2 + y**2 + z**2))")
IN_FOUR = Hamiltonian(q="x y z w", p="a b c d", H="(a**2 + b**2 + c**2 + d**2)/2 + x**2 + y**2 + z**2 + w**2")


def plane(V, T="(u**2 + v**2)/2"):
    return Hamiltonian(q="x y", p="u v", H=f"{T} + {V}")


def line(V):
    return Hamiltonian(q="x", p="u", H=f"u**2/2 + {V}")


@pytest.mark.parametrize(
    ("system", "wanted"),
    [
        (problem("perturbed-kepler").system, ((-1.0, -1.0), (-0.0025, -3.0))),
        (problem("duffing").system, ((-0.5, 2.0), (0.25, 4.0))),
        (IN_SPACE, ((-1.5, -1.0),)),
        (plane("x**2 + y**2"), ((1.0, 2.0),)),
        (plane("sqrt(x**2 + y**2) + 7"), ((1.0, 1.0),)),  # a constant adds no force
        (plane("(x**2 + y**2)**2"), ((1.0, 4.0),)),
        (IN_FOUR, None),
        (plane("x**2/2 + y**2"), None),
        (plane("x*y"), None),
        (plane("-1/sqrt(x**2 + y**2)", "(u**2 + 2*v**2)/2"), None),
        (line("x**3"), None),
        (line("cos(x)"), None),
        (line("exp(-x**2)"), None),
        (line("x**2 + exp(-x**2)"), None),
    ],
)
def test_sums_of_powers_of_the_distance_are_recognized(system, wanted):
    assert (powers(system) or None) == wanted


def test_galpy_refuses_a_fourth_dimension():
    assert "not 4" in PEERS["galpy-leapfrog"].lacks(IN_FOUR, IN_FOUR)


def test_henon_and_heiles_is_recognized():
    well = "(x**2 + y**2)/2"
    assert is_henon_heiles(HENON.system)
    assert is_henon_heiles(plane(f"{well} + x**2*y - y**3/3"))
    for rest in ("- x**2*y + y**3/3", "+ x**2*y - y**3/4", "+ x**2*y", "+ x**2 + x**2*y - y**3/3"):
        assert not is_henon_heiles(plane(f"{well} {rest}"))


@pytest.mark.parametrize("id", ["galpy-leapfrog", "galpy-symplec4-c", "gala-leapfrog", "gala-ruth4-cython"])
def test_keplers_problem_in_space(id):
    """A circle of radius 2 in a tilted plane around a mass of 3/2."""
    need(PEERS[id].package)
    speed, along = np.sqrt(0.75), np.array([0.6, 0.0, 0.8])
    s = integrate_peer(IN_SPACE, id, h=2e-3, steps=100, q0=[0.0, 2.0, 0.0], p0=-speed * along)
    angle = s.t * speed / 2
    exact = 2 * (np.cos(angle)[:, None] * [0.0, 1.0, 0.0] - np.sin(angle)[:, None] * along)
    assert np.abs(s.q - exact).max() < 1e-6
    assert np.abs(np.hypot(s.p[:, 1], s.p @ along) - speed).max() < 1e-6


# -- galpy ------------------------------------------------------------------------------------------------------------


def test_the_number_of_steps_to_a_row_is_not_truncated():
    """galpy's C code would take two steps of 0.1 to a row at 0.3, so rows are requested slightly later."""
    need("galpy")
    assert int(0.3 / 0.1) == 2
    start = np.zeros(2)
    for h in (0.1, 0.3, 1e-3, 0.7, 2.0 / 3):
        for stride in (1, 2, 3, 7, 1000):
            task = Task(HENON.system, HENON.system, start, start, h, [0, stride], [0.0], None)
            times, every, options = galpy._times("leapfrog_c", False, task)
            assert int((times[1] - times[0]) / h) == stride == every
            assert options == {"dt": h}


def test_a_substituted_method_is_a_failure():
    need("galpy")
    potential = galpy._python_potential(problem("pendulum").system)
    for method, what in (("rk4_c", "using odeint instead"), ("symplec4_c", "using leapfrog instead")):
        rows, _, failure = galpy._integrate(method, potential, [1.0, 0.0], np.array([0.0, 0.1]), {})
        assert rows is None
        assert what in failure


@pytest.mark.parametrize("id", [p.id for p in galpy.PEERS if p.adaptive])
def test_galpy_is_not_called_where_it_would_hang(id):
    need("galpy")
    on_a_line = not id.endswith("-c")  # Python handles lines
    for name, q, p, good in (
        ("kepler", [1.0, 0.0], [0.0, 0.0], False),
        ("henon-heiles", [0.0, 0.0], [0.1, 0.2], False),
        ("duffing", [0.0], [0.4], on_a_line),
    ):
        s = integrate_peer(problem(name), id, t_end=3.0, steps=10, q0=q, p0=p)
        assert s.status == ("ok" if good else "diverged")
        assert good or "galpy" in s.reason


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
TRAP = """
import socket
def connect(*arguments, **options):
    raise SystemExit("network")
socket.create_connection = connect
"""


@pytest.mark.parametrize(("text", "calls"), [(QUIET, False), ("import galpy", True)], ids=["ours", "its own"])
def test_galpy_makes_no_request_and_leaves_interrupts_alone(tmp_path, text, calls):
    need("galpy")
    environment = os.environ | {"HOME": str(tmp_path), "USERPROFILE": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", TRAP + text], capture_output=True, text=True, env=environment)
    assert ("network" in done.stderr) == calls, done.stderr
    assert ("interrupted" in done.stdout) != calls, done.stderr
