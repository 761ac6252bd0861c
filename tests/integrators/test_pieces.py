"""`Trajectory` calls a kernel in pieces: with a made-up kernel, the pieces, rows and ends of a run."""

from __future__ import annotations

import time

import numpy as np
import pytest

from phasebench.integrators import Hamiltonian, trajectory
from phasebench.integrators.stepping import solve
from phasebench.integrators.systems.hamiltonian import PartitionedSystem
from phasebench.integrators.trajectory import Pace, Trajectory

#: A free motion without an energy.
MOVED = PartitionedSystem(q="q", p="p", dq=["p"], dp=["0"])
ROOT = Hamiltonian(q="q", p="p", H="p**2/2 + sqrt(q)")


class Kernel:
    """Made-up kernel that counts steps in q; at the step ``end`` it stops with ``code`` or sets q = ``worth``.

    Each step adds ``missing`` to the count of fallbacks.
    """

    def __init__(self, end=None, code=solve.SOLVED, worth=None, missing=0.0, slept=0.0):
        self.end, self.code, self.worth, self.missing = end, code, worth, missing
        self.step, self.calls, self.slept = 0, [], slept

    @property
    def counts(self):
        return np.rec.array([(self.missing * self.step,)], dtype=[("fallbacks", float)])[0]

    def __call__(self, Q, P, parameter, every):
        self.calls.append((len(Q), every))
        time.sleep(self.slept)
        for row in range(len(Q)):
            for _ in range(every):
                self.step += 1
                if self.step == self.end and self.code:
                    return row, self.code
            Q[row], P[row], parameter[row] = self.step, 1.0, -self.step
            if self.worth is not None and self.end <= self.step < self.end + every:
                Q[row] = self.worth
        return len(Q), solve.SOLVED


def ran(kernel, steps=10, every=1, system=MOVED, timeout=None, missed="", piece=None):
    """The trajectory of a kernel from q = 0, p = 1 with h = 1/2, run to its end."""
    t = Trajectory(system, [0.0], [1.0], 0.5, steps, every, "double", missed)
    pace = Pace(timeout)
    pace.steps = piece or pace.steps
    while t:
        t.advance(kernel, pace)
    t.conclude(timeout, int(kernel.counts.fallbacks))
    return t


@pytest.mark.parametrize(("steps", "every"), [(10, 1), (10, 3), (23, 7), (4, 4), (15, 5)])
@pytest.mark.parametrize("piece", [1, 5, 1000])
def test_rows_do_not_depend_on_the_pieces(monkeypatch, steps, every, piece):
    monkeypatch.setattr(trajectory, "PIECE", piece)
    kernel = Kernel()
    t = ran(kernel, steps, every, piece=piece)
    numbers = [*range(0, steps, every), steps]
    assert t.q[:, 0].tolist() == t.index.tolist() == numbers
    assert t.times.tolist() == [0.5 * n for n in numbers]
    assert t.parameter[:, 0].tolist() == [-n for n in numbers[1:]]
    assert (t.status, t.reason, t.filled, t.reached) == ("ok", "", len(numbers) - 1, steps)
    assert sum(n * size for n, size in kernel.calls) == steps
    assert max(n * size for n, size in kernel.calls) <= piece


@pytest.mark.parametrize(("every", "filled"), [(1, 6), (3, 2), (10, 0), (4, 1)])
@pytest.mark.parametrize(
    ("kernel", "system", "status"),
    [
        ({"worth": np.nan}, MOVED, "diverged"),
        ({"worth": np.inf}, MOVED, "diverged"),
        ({"worth": -1.0}, ROOT, "diverged"),
        ({"worth": -1.0}, MOVED, "ok"),
        ({"code": solve.NOT_FINITE}, MOVED, "diverged"),
        ({"code": solve.STALLED}, MOVED, "not-converged"),
        ({"code": solve.OUT_OF_STEP}, MOVED, "not-converged"),
    ],
)
def test_rows_end_before_the_first_bad_one(kernel, system, status, every, filled):
    """That is not finite, outside the domain of H, or not reached."""
    t = ran(Kernel(end=7, **kernel), every=every, system=system)
    assert t.status == status
    if status != "ok":
        assert t.filled == filled
        assert f"after step {filled * every} of 10 (t = {0.5 * every * filled:.6g})" in t.reason


def test_the_state_reached_within_a_row_is_kept(monkeypatch):
    monkeypatch.setattr(trajectory, "PIECE", 5)
    for kernel in (Kernel(end=7, code=solve.STALLED), Kernel(end=7, worth=np.nan)):
        t = ran(kernel, steps=20, every=10, piece=5)
        assert (t.filled, t.reached, t.q[:2, 0].tolist(), t.times.tolist()) == (1, 5, [0, 5], [0, 2.5])


@pytest.mark.parametrize(("size", "status"), [(2.1e6, "diverged"), (1.9e6, "not-converged")])
def test_a_stop_after_great_growth_is_a_divergence(size, status):
    """From a state of size 1: the limit is a million times one plus that size."""
    t = Trajectory(MOVED, [0.0], [1.0], 0.5, 10, 1, "double")
    t.advance(Kernel(end=1, worth=size), Pace(None, 1))
    t._explain_stop(solve.STALLED)
    assert t.status == status


def test_a_timeout_keeps_the_state_reached():
    t = ran(Kernel(slept=0.02), steps=10**6, timeout=0.01)
    assert (t.status, t.reached, "after step 64 of 1000000 (t = 32)" in t.reason) == ("timeout", 64, True)
    assert t.seconds >= 0.02
    assert ran(Kernel(slept=0.02), steps=64, timeout=0.01).status == "ok", "it is at its end"


@pytest.mark.parametrize(("missing", "status", "noted"), [(0.0, "ok", 0), (0.1, "ok", 100), (0.2, "no-root", 200)])
def test_steps_without_a_root_are_reported(missing, status, noted):
    t = ran(Kernel(missing=missing), steps=1000, missed="lack a root")
    assert t.status == status
    assert t.reason.startswith(f"{noted} of 1000 steps lack a root" if noted else "")
    assert bool(t.reason) == bool(noted)
    assert ran(Kernel(missing=missing), steps=1000).reason == "", "nothing is promised"


@pytest.mark.parametrize(
    ("missing", "steps", "reached"),
    [(1.0, 5000, trajectory.FIRST), (0.96, 5000, trajectory.FIRST), (0.94, 5000, 5000), (1.0, 900, 900)],
)
def test_a_run_that_hardly_ever_has_a_root_is_stopped(missing, steps, reached):
    t = ran(Kernel(missing=missing), steps=steps, missed="lack a root", piece=trajectory.FIRST)
    assert (t.status, t.reached) == ("no-root", reached)
