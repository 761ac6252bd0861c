"""SciPy's solvers as peers: accuracy, compiled and Python right-hand sides, SciPy's own results, failures."""

from __future__ import annotations

import sys
import warnings
from functools import partial
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.integrate

from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian, InvalidInput
from phasebench.integrators.compile import codegen
from phasebench.reference.peers import BY_ID, integrate_peer
from phasebench.reference.peers import scipy as peers
from phasebench.reference.peers.field import right_hand_side
from support.references import error

SOLVERS = ("DOP853", "Radau", "LSODA")
IDS = [p.id for p in peers.PEERS]
T_END = 10.0
#: Smallest tolerances tested; smaller ones take Radau too many steps.
TIGHT = {"DOP853": 1e-12, "Radau": 1e-9, "LSODA": 1e-11}


def test_every_solver_has_both_right_hand_sides():
    wanted = [f"scipy-{s.lower()}{suffix}" for s in SOLVERS for suffix in ("", "-numba")]
    assert wanted == IDS
    for p in peers.PEERS:
        assert ("compiled by Numba" in p.name) == p.id.endswith("-numba") != ("Python right-hand side" in p.name)
        assert p.claims.source.startswith("https://docs.scipy.org/")
    assert all("differences" in BY_ID[f"scipy-{s}"].about for s in ("radau", "lsoda", "radau-numba"))


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("name", ["henon-heiles:box", "lotka-volterra", "perturbed-kepler"])
def test_a_looser_tolerance_is_cheaper_and_less_accurate(solver, name):
    made, id = problem(name), f"scipy-{solver.lower()}-numba"
    tight, loose = (integrate_peer(made, id, t_end=T_END, steps=7, tol=tol) for tol in (TIGHT[solver], 1e-4))
    assert (tight.status, loose.status) == ("ok", "ok")
    assert error(tight, made) < 1e4 * TIGHT[solver]
    assert error(loose, made) > 100 * error(tight, made)
    for count in ("steps", "gradient"):
        assert 0 < loose.counts[count] < tight.counts[count] / 2


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("name", ["kepler", "lotka-volterra", "fpu"])
def test_both_right_hand_sides_take_the_same_steps(solver, name):
    made = problem(name)
    t_end = 0.5 if name == "fpu" else 5.0
    a, b = (integrate_peer(made, f"scipy-{solver.lower()}{x}", t_end=t_end, steps=5, tol=1e-6) for x in ("", "-numba"))
    assert a.counts == b.counts
    assert np.abs(a.q - b.q).max() < 1e-12
    other = integrate_peer(made, f"scipy-{solver.lower()}", t_end=t_end, steps=5, tol=1.1e-6)
    assert np.abs(a.q - other.q).max() > 1e-12


@pytest.mark.parametrize("sites", [3, codegen.TUPLE_LIMIT + 2])
def test_the_compiled_field_is_that_of_the_system(sites):
    """On tuples and on arrays, for contiguous and for strided states."""
    x = [f"q{i}" for i in range(sites)]
    springs = " + ".join(f"{a}**2*{b}**2/3" for a, b in pairwise(x))
    p = [f"p{i}" for i in range(sites)]
    system = Hamiltonian(q=x, p=p, H=f"{' + '.join(f'{b}**2/2' for b in p)} + {springs} + q0*p1")
    y = np.random.default_rng(0).normal(size=4 * sites)
    f = peers.compiled_field(system)
    assert f is peers.compiled_field(system)
    for state in (y[: 2 * sites], y[::2]):
        assert (f(0.0, state) == system.vector_field()(0.0, state.copy())).all()
    assert len(f.signatures) == 2


def test_a_right_hand_side_is_compiled_if_possible(monkeypatch):
    system, y = problem("pendulum").system, np.array([0.4, 0.9])
    assert right_hand_side(system) is peers.compiled_field(system)
    assert right_hand_side(system)(0.0, y) == pytest.approx([0.9, -np.sin(0.4)], abs=1e-15)
    monkeypatch.setattr(codegen, "compiled", lambda: False)
    assert right_hand_side(SimpleNamespace(vector_field=lambda: "in Python")) == "in Python"


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_tolerance_is_relative_and_absolute(solver):
    made, tol = problem("kepler"), 1e-7
    mine = integrate_peer(made, f"scipy-{solver.lower()}", t_end=3.0, tol=tol, save_every=0)
    field, start = made.system.vector_field(), [*made.q0, *made.p0]
    for atol, same in ((tol, True), (tol / 100, False)):
        theirs = scipy.integrate.solve_ivp(field, (0, 3.0), start, method=solver, rtol=tol, atol=atol)
        assert (np.abs([*mine.q[-1], *mine.p[-1]] - theirs.y[:, -1]).max() < 1e-14) == same


@pytest.mark.parametrize("solver", SOLVERS)
def test_defaults_and_rows_equal_scipys(solver):
    made = problem("kepler")
    t = [0.0, 3.0, 6.0, 9.0]
    mine = integrate_peer(made, f"scipy-{solver.lower()}", t_end=9.0, steps=3)
    start, field = [*made.q0, *made.p0], made.system.vector_field()
    theirs = scipy.integrate.solve_ivp(field, (0, 9.0), start, method=solver, t_eval=t)
    assert np.abs(np.hstack([mine.q, mine.p]).T - theirs.y).max() < 1e-14
    assert mine.status == "ok"
    own = scipy.integrate.solve_ivp(field, (0, 9.0), start, method=solver)
    assert mine.counts["steps"] == len(own.t) - 1


@pytest.mark.parametrize(("t_end", "rows", "steps"), [(1e-3, 4, 1), (10.0, 200, 90)])
def test_several_rows_within_a_step_lie_on_the_orbit(t_end, rows, steps):
    """With all rows in a single step, or a few rows in each step."""
    made = problem("kepler")
    solution = integrate_peer(made, "scipy-dop853", t_end=t_end, steps=rows, tol=1e-9)
    assert (solution.status, len(solution.t)) == ("ok", rows + 1)
    assert solution.counts["steps"] <= steps < rows
    assert error(solution, made) < 1e-6


def test_all_evaluations_are_counted(monkeypatch):
    made, calls = problem("kepler"), [0]
    inner = made.system.vector_field()

    def field(t, y):
        calls[0] += 1
        return inner(t, y)

    monkeypatch.setattr(made.system, "vector_field", lambda: field, raising=False)
    for solver in SOLVERS:
        calls[0] = 0
        count = integrate_peer(made, f"scipy-{solver.lower()}", t_end=T_END, tol=1e-6).counts["gradient"]
        assert count == calls[0] - 1, solver  # one call before the clock starts


@pytest.mark.parametrize("id", IDS)
def test_a_divergence_has_a_reason_and_keeps_earlier_rows(id):
    runaway = Hamiltonian(q="q", p="p", H="p**2/2 - q**4/4")
    solution = integrate_peer(runaway, id, t_end=5.0, steps=10, q0=[1.0], p0=[1.0], tol=1e-5)
    assert (solution.status, solution.t.tolist()) == ("diverged", [0.0, 0.5, 1.0])
    assert np.isfinite(solution.q).all()
    assert "step" in solution.reason
    assert "t = 1 of 5" in solution.reason


def test_lsoda_explains_its_failure():
    runaway = Hamiltonian(q="q", p="p", H="p**2/2 - q**4/4")
    least = BY_ID["scipy-lsoda"].least
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # the warning must be caught
        solution = integrate_peer(runaway, "scipy-lsoda", t_end=5.0, steps=10, q0=[1.0], p0=[1.0], tol=least)
    assert solution.status == "diverged"
    assert "LSODA" in solution.reason
    assert "tolerances too small" in solution.reason


def test_a_run_of_too_many_steps_is_stopped(monkeypatch):
    monkeypatch.setattr(peers, "STEP_LIMIT", 5)
    solution = integrate_peer(problem("kepler"), "scipy-lsoda", t_end=T_END)
    assert solution.status == "diverged"
    assert "5 steps" in solution.reason


@pytest.mark.parametrize("id", IDS)
def test_the_least_tolerance_is_scipys(id):
    least = BY_ID[id].least
    with pytest.raises(InvalidInput, match="none below"):
        integrate_peer(problem("kepler"), id, t_end=1.0, tol=least / 1.01)
    for tol, warned in ((least, False), (least / 1.01, True)):
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            scipy.integrate.DOP853(lambda t, y: -y, 0.0, [1.0], 1.0, rtol=tol, atol=tol)
        assert bool(told) == warned


def test_without_compilation_compiled_peers_are_refused(monkeypatch):
    monkeypatch.setattr(codegen, "compiled", lambda: False)
    with pytest.raises(InvalidInput, match="compilation is off"):
        integrate_peer(problem("kepler"), "scipy-lsoda-numba", t_end=1.0)


def python_calls(work):
    """How many Python functions the second call of ``work`` calls, which is prepared by the first."""
    work()
    seen, before = [], sys.getprofile()
    sys.setprofile(lambda frame, event, argument: seen.append(event == "call"))
    try:
        work()
    finally:
        sys.setprofile(before)
    return sum(seen)


@pytest.mark.parametrize(("solver", "same"), [("ode", "scipy-dop853-numba"), ("odeint", "scipy-lsoda-numba")])
def test_older_interfaces_use_the_same_algorithms_with_less_python(solver, same):
    made = problem("henon-heiles:box")
    old = integrate_peer(made, peers.fast(solver), t_end=100.0, steps=4, tol=1e-9)
    new = integrate_peer(made, BY_ID[same], t_end=100.0, steps=4, tol=1e-9)
    assert old.status == "ok"
    assert 1e-12 < error(old, made) < 3 * error(new, made)
    for_one, for_other = (
        python_calls(partial(integrate_peer, made, p, t_end=100.0, tol=1e-9, save_every=0))
        for p in (peers.fast(solver), BY_ID[same])
    )
    assert for_one < for_other


@pytest.mark.lowest
@pytest.mark.parametrize("solver", ["ode", "odeint"])
def test_older_interfaces_report_failure(solver):
    escape = Hamiltonian(q="q", p="p", H="p**2/2 - q**4/4")
    found = integrate_peer(escape, peers.fast(solver), t_end=50.0, tol=1e-6, q0=[1.0], p0=[1.0], save_every=0)
    assert found.status == "diverged"
