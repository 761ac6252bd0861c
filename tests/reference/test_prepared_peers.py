"""Prepared peers: the same end states as their checked runs, from any start, and nothing about the package's call."""

from __future__ import annotations

import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.experiments.trade.field import peers as competing
from phasebench.benchmarks.measure.integrator import Integrator
from phasebench.benchmarks.problems import problem
from phasebench.integrators.errors import InvalidInput
from phasebench.reference.peers import PEERS, floating, integrate_peer
from phasebench.reference.peers.prepared import PreparedPeer, prepare_peer

#: Problem -> its span: both ways in which REBOUND is given gravity, and a potential.
SPANS = {"kepler": 6.0, "henon-heiles:box": 5.0, "figure-eight": 2.0}
TOL, STEPS = 1e-9, 100
#: These start a run with the order or the polynomial of the one before, which changes it within its tolerance.
REMEMBERS = ("rebound-ias15", "rebound-bs")


def runs(name: str):
    """Every competing peer that can do a problem, but for heyoka's unrolled twins, which take long to compile."""
    made = problem(name)
    for p in competing():
        if p.lacks(made, made.system) is None and "compact_mode=False" not in p.id:
            yield made, p


def test_every_peer_that_competes_in_the_trade_has_a_prepared_run():
    assert [p.id for p in competing() if p.prepare is None] == []


@pytest.mark.parametrize("name", SPANS)
def test_a_prepared_run_ends_where_the_checked_one_does_however_often(name):
    """To the last bit; of those that remember within a thousand tolerances, and not where the start is another."""
    for made, p in runs(name):
        t_end = SPANS[name]
        tol = max(TOL, p.least) if p.adaptive else None
        size = (t_end,) if p.adaptive else (t_end / STEPS, STEPS)
        checked = integrate_peer(made, p, t_end=t_end, steps=None if p.adaptive else STEPS, tol=tol, save_every=0)
        expected = np.concatenate([checked.q[-1], checked.p[-1]])
        run, bound = prepare_peer(made, p, tol=tol), 1e3 * TOL if p.id.startswith(REMEMBERS) else 0.0
        for _ in range(2):
            q, v, code = run(*size)
            assert code == run.SOLVED, p.id
            assert np.abs(np.concatenate([q, v]) - expected).max() <= bound, p.id
        q, v, _ = run(*size, q0=np.array(made.q0) * (1 + 1e-3))
        assert np.abs(np.concatenate([q, v]) - expected).max() > max(1e-5, bound), p.id
        q, v, _ = run(*size)
        assert np.abs(np.concatenate([q, v]) - expected).max() <= bound, p.id


def test_the_state_that_was_returned_is_not_overwritten_by_the_next_run():
    for id, size in (("heyoka", (1.0,)), ("rebound-whfast", (0.1, 10)), ("scipy-dop853-numba", (1.0,))):
        run = pb.prepare("kepler", id)
        q, p, _ = run(*size)
        before = q.copy(), p.copy()
        run(*size, q0=[0.5, 0.1])
        assert (q == before[0]).all()
        assert (p == before[1]).all()


def test_a_system_with_a_start_is_prepared_as_a_problem_is():
    well = pb.Hamiltonian(q="q", p="p", H="p**2/2 + q**4/4")
    q, p, code = pb.prepare(well, "heyoka", tol=1e-12, q0=[1.0], p0=[0.0])(2.0)
    checked = pb.integrate(well, "heyoka", tol=1e-12, t_end=2.0, q0=[1.0], p0=[0.0])
    assert (code, q[0], p[0]) == (PreparedPeer.SOLVED, checked.q[-1, 0], checked.p[-1, 0])


def test_a_run_that_fails_has_another_code():
    runaway = pb.Hamiltonian(q="q", p="p", H="p**2/2 - q**4/4")
    for id in ("heyoka", "scipy-dop853-numba"):
        run = pb.prepare(runaway, id, tol=1e-9, q0=[1.0], p0=[1.0])
        assert run(0.5)[2] == run.SOLVED
        assert run(5.0)[2] != run.SOLVED


def test_a_run_backwards_comes_back():
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
        ("heyoka", {"lam": 1}, "no parameters such as lam"),
        ("rebound-whfast", {"tol": 1e-9}, "steps of fixed size"),
        ("stormer-verlet", {"tol": 1e-9}, "takes a step h, no tolerance"),
        ("heyoka-batch", {}, "no prepared run"),
        (lambda system, q, p, h: (q, p), {}, "no prepared run"),
        ("heyok", {}, "did you mean"),
    ],
)
def test_what_cannot_be_prepared_is_refused_in_words(method, options, said):
    with pytest.raises(InvalidInput, match=said):
        pb.prepare("kepler", method, **options)


def test_a_problem_that_a_peer_cannot_do_is_refused():
    with pytest.raises(InvalidInput, match="cannot do this"):
        pb.prepare("henon-heiles:box", "rebound-whfast")


def test_the_environment_of_floating_point_stays():
    """WHFast512 flushes small numbers to zero (where it runs at all)."""
    made, p = problem("outer-solar-system"), next(p for p in PEERS if p.id == "rebound-whfast512")
    if Integrator(p).lacks(made):
        pytest.skip("WHFast512 does not run here")
    run = prepare_peer(made, p)
    assert run(100.0, 8)[2] == run.SOLVED
    assert floating.gradual()
