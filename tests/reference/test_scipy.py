"""SciPy's solvers as peers: SciPy's own results, compiled and Python right-hand sides, failures, older interfaces."""

from __future__ import annotations

import re
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
from phasebench.reference.peers.prepared import prepare_peer
from phasebench.reference.solvers import taylor

SOLVERS = ("DOP853", "Radau", "LSODA")
KEPLER = problem("kepler")
RUNAWAY = Hamiltonian(q="q", p="p", H="p**2/2 - q**4/4")


@pytest.fixture
def calls(monkeypatch):
    """The calls of Kepler's vector field, the Python one and the compiled one: a list of one number."""
    count, inner = [0], KEPLER.system.vector_field()

    def field(t, y):
        count[0] += 1
        return inner(t, y)

    monkeypatch.setattr(KEPLER.system, "vector_field", lambda: field, raising=False)
    monkeypatch.setattr(peers, "compiled_field", lambda system: field)
    return count


@pytest.mark.parametrize("solver", SOLVERS)
def test_rows_counts_defaults_and_tolerances_are_scipys(solver, calls):
    field, start, t = KEPLER.system.vector_field(), [*KEPLER.q0, *KEPLER.p0], [0.0, 3.0, 6.0, 9.0]
    solve = partial(scipy.integrate.solve_ivp, field, (0, 9.0), start, method=solver)
    mine = integrate_peer(KEPLER, f"scipy-{solver.lower()}", t_end=9.0, steps=3)
    assert np.abs(np.hstack([mine.q, mine.p]).T - solve(t_eval=t).y).max() < 1e-14
    assert mine.counts["steps"] == len(solve().t) - 1
    tol = 1e-7
    calls[0] = 0
    mine = integrate_peer(KEPLER, f"scipy-{solver.lower()}", t_end=9.0, tol=tol)
    assert mine.counts["gradient"] == calls[0] - 1, "one call before the clock starts"
    for atol, same in ((tol, True), (tol / 100, False)):
        theirs = solve(rtol=tol, atol=atol)
        assert (np.abs([*mine.q[-1], *mine.p[-1]] - theirs.y[:, -1]).max() < 1e-14) == same


@pytest.mark.parametrize("sites", [3, codegen.TUPLE_LIMIT + 2])
def test_the_compiled_field_is_that_of_the_system(sites):
    """On tuples and on arrays, for contiguous and for strided states."""
    x, p = [f"q{i}" for i in range(sites)], [f"p{i}" for i in range(sites)]
    springs = " + ".join(f"{a}**2*{b}**2/3" for a, b in pairwise(x))
    system = Hamiltonian(q=x, p=p, H=f"{' + '.join(f'{b}**2/2' for b in p)} + {springs} + q0*p1")
    y = np.random.default_rng(0).normal(size=4 * sites)
    f = peers.compiled_field(system)
    assert f is peers.compiled_field(system)
    for state in (y[: 2 * sites], y[::2]):
        assert (f(0.0, state) == system.vector_field()(0.0, state.copy())).all()
    assert len(f.signatures) == 2


def test_without_compilation_compiled_peers_are_refused_and_fields_are_python(monkeypatch):
    assert right_hand_side(KEPLER.system) is peers.compiled_field(KEPLER.system)
    monkeypatch.setattr(codegen, "compiled", lambda: False)
    assert right_hand_side(SimpleNamespace(vector_field=lambda: "in Python")) == "in Python"
    with pytest.raises(InvalidInput, match="compilation is off"):
        integrate_peer(KEPLER, "scipy-lsoda-numba", t_end=1.0)


@pytest.mark.lowest
def test_a_failure_has_scipys_reason(monkeypatch):
    run = partial(integrate_peer, RUNAWAY, t_end=5.0, steps=10, q0=[1.0], p0=[1.0])
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # LSODA's warning must be caught
        for id, tol, said in (("scipy-lsoda", None, "LSODA.*tolerances too small"), ("scipy-dop853", 1e-5, "step")):
            s = run(id, tol=tol or BY_ID[id].least)
            assert s.status == "diverged"
            assert s.t.tolist() == [0.0, 0.5, 1.0] or tol is None
            assert re.search(said, s.reason)
    for older in map(peers.fast, ("ode", "odeint")):
        assert run(older, tol=1e-6).status == "diverged"
    monkeypatch.setattr(peers, "STEP_LIMIT", 5)
    assert "5 steps" in integrate_peer(KEPLER, "scipy-lsoda", t_end=10.0).reason


# -- older interfaces -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("solver", "same"), [("ode", "scipy-dop853-numba"), ("odeint", "scipy-lsoda-numba")])
def test_older_interfaces_use_the_same_algorithms(solver, same):
    made = problem("henon-heiles:box")
    old, new = (integrate_peer(made, p, t_end=100.0, steps=4, tol=1e-9) for p in (peers.fast(solver), same))
    truth = taylor.reference(made, old.t, certify=False)
    errors = [np.abs(np.hstack([s.q - truth.q, s.p - truth.p])).max() for s in (old, new)]
    assert old.status == "ok"
    assert 1e-12 < errors[0] < 3 * errors[1]
    prepared = prepare_peer(made, peers.fast(solver), tol=1e-9)
    bare = integrate_peer(made, peers.fast(solver), t_end=9.0, tol=1e-9)
    for start, equal in ((None, True), ([0.1, 0.1], False), (None, True)):
        assert (prepared(9.0, q0=start)[0] == bare.q[-1]).all() == equal


@pytest.mark.lowest
@pytest.mark.parametrize("solver", ["ode", "odeint"])
def test_older_interfaces_count_evaluations(solver, calls):
    s = integrate_peer(KEPLER, peers.fast(solver), t_end=1.0, steps=5)
    steps, evaluations = s.counts["steps"], s.counts["gradient"]
    assert evaluations == (calls[0] - 1 if solver == "odeint" else 0), "one call before the clock starts"
    assert 5 <= steps < evaluations if solver == "odeint" else steps == 0
