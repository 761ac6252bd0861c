"""Prepared peers as `pb.prepare` makes them: input, states, statuses; `test_peers` has the end states of all."""

from __future__ import annotations

import pytest

import phasebench as pb
from phasebench.benchmarks.ladder.competitors import peers as competing

WELL = pb.Hamiltonian(q="q", p="p", H="p**2/2 + q**4/4")
RUNAWAY = pb.Hamiltonian(q="q", p="p", H="p**2/2 - q**4/4")


def test_every_competing_peer_can_be_prepared():
    assert [p.id for p in competing() if p.prepare is None] == []


def test_a_returned_state_is_not_overwritten():
    for id, size in (("heyoka", (1.0,)), ("rebound-whfast", (0.1, 10)), ("scipy-dop853-numba", (1.0,))):
        run = pb.prepare("kepler", id)
        q, p, _ = run(*size)
        before = q.copy(), p.copy()
        run(*size, q0=[0.5, 0.1])
        assert (q == before[0]).all()
        assert (p == before[1]).all()


def test_a_failed_run_has_another_status():
    for id in ("heyoka", "scipy-dop853-numba"):
        run = pb.prepare(RUNAWAY, id, tol=1e-9, q0=[1.0], p0=[1.0])
        assert run(0.5)[2] == run.SOLVED
        assert run(5.0)[2] == run.STALLED == "not-converged"


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
    with pytest.raises(pb.InvalidInput, match=said):
        pb.prepare("kepler", method, **options)
