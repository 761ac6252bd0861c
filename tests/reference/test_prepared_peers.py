"""Prepared peers reach the end states of `integrate_peer`, from any start, without its overhead."""

from __future__ import annotations

import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.ladder.competitors import peers as competing
from phasebench.benchmarks.measure.integrator import Integrator
from phasebench.benchmarks.problems import problem
from phasebench.integrators.errors import InvalidInput
from phasebench.reference.installed import is_installed
from phasebench.reference.peers import PEERS, floating, integrate_peer
from phasebench.reference.peers.prepared import PreparedPeer, prepare_peer
from support.solutions import last

#: Problem -> span: both kinds of gravity in REBOUND, and a potential.
SPANS = {"kepler": 6.0, "henon-heiles:box": 5.0, "figure-eight": 2.0}
TOL, STEPS = 1e-9, 100
#: Peers that start with the order or polynomial of the previous run, so that results vary within the tolerance.
REMEMBERS = ("rebound-ias15", "rebound-bs")


def runs(name: str):
    """Yield (problem, peer) for the peers that support the problem.

    Packages that are not installed are left out, and heyoka's variants without compact mode, slow to compile.
    """
    made = problem(name)
    for p in competing():
        if is_installed(p.package) and p.lacks(made, made.system) is None and "compact_mode=False" not in p.id:
            yield made, p


def test_every_competing_peer_can_be_prepared():
    assert [p.id for p in competing() if p.prepare is None] == []


@pytest.mark.parametrize("name", SPANS)
def test_prepared_runs_equal_checked_runs(name):
    """Bit by bit, or for `REMEMBERS` within a thousand tolerances. Control: another start gives another end."""
    for made, p in runs(name):
        t_end = SPANS[name]
        tol = max(TOL, p.least) if p.adaptive else None
        size = (t_end,) if p.adaptive else (t_end / STEPS, STEPS)
        steps = None if p.adaptive else STEPS
        expected = last(integrate_peer(made, p, t_end=t_end, steps=steps, tol=tol, save_every=0))
        run, bound = prepare_peer(made, p, tol=tol), 1e3 * TOL if p.id.startswith(REMEMBERS) else 0.0
        for _ in range(2):
            q, v, code = run(*size)
            assert code == run.SOLVED, p.id
            assert np.abs(np.concatenate([q, v]) - expected).max() <= bound, p.id
        q, v, _ = run(*size, q0=np.array(made.q0) * (1 + 1e-3))
        assert np.abs(np.concatenate([q, v]) - expected).max() > max(1e-5, bound), p.id
        q, v, _ = run(*size)
        assert np.abs(np.concatenate([q, v]) - expected).max() <= bound, p.id


def test_a_returned_state_is_not_overwritten():
    for id, size in (("heyoka", (1.0,)), ("rebound-whfast", (0.1, 10)), ("scipy-dop853-numba", (1.0,))):
        run = pb.prepare("kepler", id)
        q, p, _ = run(*size)
        before = q.copy(), p.copy()
        run(*size, q0=[0.5, 0.1])
        assert (q == before[0]).all()
        assert (p == before[1]).all()


def test_a_system_with_a_start_can_be_prepared():
    well = pb.Hamiltonian(q="q", p="p", H="p**2/2 + q**4/4")
    q, p, code = pb.prepare(well, "heyoka", tol=1e-12, q0=[1.0], p0=[0.0])(2.0)
    checked = pb.integrate(well, "heyoka", tol=1e-12, t_end=2.0, q0=[1.0], p0=[0.0])
    assert (code, q[0], p[0]) == (PreparedPeer.SOLVED, checked.q[-1, 0], checked.p[-1, 0])


def test_a_failed_run_has_another_status():
    runaway = pb.Hamiltonian(q="q", p="p", H="p**2/2 - q**4/4")
    for id in ("heyoka", "scipy-dop853-numba"):
        run = pb.prepare(runaway, id, tol=1e-9, q0=[1.0], p0=[1.0])
        assert run(0.5)[2] == run.SOLVED
        assert run(5.0)[2] == run.STALLED == "not-converged"


def test_a_run_backwards_returns():
    for id in ("heyoka", "rebound-ias15"):
        run = pb.prepare("kepler", id)
        q, p, _ = run(1.0)
        back, _, code = run(-1.0, q0=q, p0=p)
        assert code == run.SOLVED
        assert np.abs(back - problem("kepler").q0).max() < 1e-12


@pytest.mark.parametrize(
    ("method", "options", "said"),
    [
        ("heyoka", {"tol": 2.0}, "tol is 2.0"),
        ("heyoka", {"parameters": {"lam": 1}}, "no parameters such as lam"),
        ("rebound-whfast", {"tol": 1e-9}, "steps of fixed size"),
        ("stormer-verlet", {"tol": 1e-9}, "takes a step h, no tolerance"),
        ("heyoka-batch", {}, "no prepared run"),
        (lambda system, q, p, h: (q, p), {}, "no prepared run"),
        ("heyok", {}, "did you mean"),
    ],
)
def test_invalid_preparations_are_refused(method, options, said):
    with pytest.raises(InvalidInput, match=said):
        pb.prepare("kepler", method, **options)


def test_an_unsupported_problem_is_refused():
    with pytest.raises(InvalidInput, match="cannot do this"):
        pb.prepare("henon-heiles:box", "rebound-whfast")


def test_the_floating_point_mode_is_kept():
    """WHFast512, where it runs, flushes denormal numbers to zero."""
    made, p = problem("outer-solar-system"), next(p for p in PEERS if p.id == "rebound-whfast512")
    if Integrator(p).lacks(made):
        pytest.skip("WHFast512 does not run here")
    run = prepare_peer(made, p)
    assert run(100.0, 8)[2] == run.SOLVED
    assert floating.gradual()
