"""`Trajectory` calls a kernel in pieces: with a made-up kernel, the pieces, rows and ends of a run."""

from __future__ import annotations

import time

import numpy as np
import pytest

from phasebench.integrators import Hamiltonian, trajectory
from phasebench.integrators.stepping import solve
from phasebench.integrators.systems.hamiltonian import PartitionedSystem
from phasebench.integrators.trajectory import PIECE, Pace, Trajectory, whole_rows

FREE = Hamiltonian(q="q", p="p", H="p**2/2")
#: The same motion without an energy.
MOVED = PartitionedSystem(q="q", p="p", dq=["p"], dp=["0"])
ROOT = Hamiltonian(q="q", p="p", H="p**2/2 + sqrt(q)")


class Kernel:
    """Made-up kernel that counts steps in q; at the step ``end`` it stops with ``code`` or sets q = ``worth``.

    Each step adds ``missing`` to the count of fallbacks.
    """

    def __init__(self, end=None, code=solve.SOLVED, worth=None, missing=0.0):
        self.end, self.code, self.worth, self.missing = end, code, worth, missing
        self.step, self.calls, self.slept = 0, [], 0.0

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


@pytest.fixture
def small(monkeypatch):
    """Limit each call of the kernel to five steps."""
    monkeypatch.setattr(trajectory, "PIECE", 5)


# -- pieces -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("steps", "every"), [(10, 1), (10, 3), (10, 10), (23, 2), (23, 7), (4, 4), (1, 1), (15, 5)])
@pytest.mark.parametrize("piece", [1, 5, 1000])
def test_rows_do_not_depend_on_the_pieces(monkeypatch, steps, every, piece):
    monkeypatch.setattr(trajectory, "PIECE", piece)
    kernel = Kernel()
    t = ran(kernel, steps, every, piece=piece)
    numbers = [*range(0, steps, every), steps]
    assert t.q[:, 0].tolist() == numbers
    assert t.index.tolist() == numbers
    assert t.times.tolist() == [0.5 * n for n in numbers]
    assert t.parameter[:, 0].tolist() == [-n for n in numbers[1:]]
    assert (t.status, t.reason, t.filled, t.reached) == ("ok", "", len(numbers) - 1, steps)
    assert sum(n * size for n, size in kernel.calls) == steps
    assert max(n * size for n, size in kernel.calls) <= piece


def test_rows_that_fit_into_a_piece_take_one_call(small):
    kernel = Kernel()
    ran(kernel, 23, 2, piece=5)
    assert kernel.calls == [(2, 2)] * 5 + [(1, 2), (1, 1)]
    assert whole_rows(23, 2, 0, 5) == 2
    assert whole_rows(23, 2, 10, 5) == 1
    assert whole_rows(23, 2, 11, 5) == 0


def test_the_length_of_pieces_adapts_to_their_duration():
    assert Pace(None).steps == PIECE
    assert Pace(None, 7).steps == 7
    pace = Pace(100.0, 7)
    assert pace.steps == 64
    pace.adapt(0.06)
    assert pace.steps == 64, "long enough to be told the progress"
    pace.adapt(0.04)
    assert pace.steps == 256
    hurried = Pace(0.1)
    hurried.adapt(0.006)
    assert hurried.steps == 64, "a twentieth of the time that there is"
    hurried.adapt(0.004)
    assert hurried.steps == 256
    for _ in range(20):
        hurried.adapt(0.0)
    assert hurried.steps == PIECE


def test_a_pace_is_late_after_its_timeout():
    assert not Pace(None).late
    assert not Pace(60.0).late
    pace = Pace(1e-3)
    time.sleep(2e-3)
    assert pace.late


# -- ends -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("every", "rows"), [(1, 7), (3, 3), (10, 1), (4, 2)])
@pytest.mark.parametrize("worth", [np.nan, np.inf])
def test_rows_end_before_the_first_that_is_not_finite(every, rows, worth):
    t = ran(Kernel(end=7, worth=worth), every=every)
    assert (t.status, t.filled + 1) == ("diverged", rows)
    assert "the state is no longer finite after step" in t.reason
    assert f"after step {every * (rows - 1)} of 10 (t = {0.5 * every * (rows - 1):.6g})" in t.reason
    assert np.isfinite(t.q[: t.filled + 1]).all()


@pytest.mark.parametrize("half", ["q", "p"])
def test_a_row_with_one_infinite_number_is_dropped(half):
    plane = PartitionedSystem(q="x y", p="u v", dq=["u", "v"], dp=["0", "0"])
    t = Trajectory(plane, [0.0, 0.0], [1.0, 1.0], 0.5, 3, 1, "double")

    def kernel(Q, P, parameter, every):
        Q[:], P[:] = 1.0, 1.0
        {"q": Q, "p": P}[half][1, 0] = np.inf
        return len(Q), solve.SOLVED

    t.advance(kernel, Pace(None))
    assert (t.status, t.filled) == ("diverged", 1)


def test_rows_end_before_leaving_the_domain_of_h():
    t = ran(Kernel(end=7, worth=-1.0), system=ROOT)
    assert (t.status, t.filled) == ("diverged", 6)
    assert "outside H's domain after step 6 of 10 (t = 3)" in t.reason
    assert ran(Kernel(end=7, worth=-1.0), system=MOVED).status == "ok"


@pytest.mark.parametrize(
    ("code", "status", "words"),
    [
        (solve.NOT_FINITE, "diverged", "a stage equation has no finite iterate"),
        (solve.STALLED, "not-converged", "neither the fixed point nor Newton's method"),
        (solve.OUT_OF_STEP, "not-converged", "the control of the step has lost"),
    ],
)
@pytest.mark.parametrize(("every", "filled"), [(1, 6), (3, 2), (10, 0)])
def test_the_reason_follows_from_the_code_of_the_kernel(code, status, words, every, filled):
    t = ran(Kernel(end=7, code=code), every=every)
    assert (t.status, t.filled) == (status, filled)
    assert words in t.reason
    assert f"after step {filled * every} of 10" in t.reason
    assert "take a smaller h" in t.reason


def test_the_state_reached_within_a_row_is_kept(small):
    """The first five steps of a row of ten are kept."""
    for kernel in (Kernel(end=7, code=solve.STALLED), Kernel(end=7, worth=np.nan)):
        t = ran(kernel, steps=20, every=10, piece=5)
        assert (t.filled, t.reached) == (1, 5)
        assert t.q[:2, 0].tolist() == [0, 5]
        assert t.times.tolist() == [0, 2.5]
        assert "after step 5 of 20 (t = 2.5)" in t.reason


@pytest.mark.parametrize(("size", "status"), [(2.1e6, "diverged"), (1.9e6, "not-converged")])
def test_a_stop_after_great_growth_is_a_divergence(size, status):
    """From a state of size 1: the limit is a million times one plus that size."""
    t = Trajectory(MOVED, [0.0], [1.0], 0.5, 10, 1, "double")
    t.advance(Kernel(end=1, worth=size), Pace(None, 1))
    t._explain_stop(solve.STALLED)
    assert t.status == status
    assert (f"the state has grown to {size:.3g}" in t.reason) == (status == "diverged")


def test_a_timeout_keeps_the_state_reached():
    kernel = Kernel()
    kernel.slept = 0.02
    t = ran(kernel, steps=10**6, timeout=0.01)
    assert (t.status, t.reached) == ("timeout", 64)
    assert "0.01 s had passed after step 64 of 1000000 (t = 32); what was reached is kept" in t.reason
    assert t.seconds >= 0.02
    last = Kernel()
    last.slept = 0.02
    assert ran(last, steps=64, timeout=0.01).status == "ok", "it is at its end"


def test_seconds_are_those_of_all_pieces():
    kernel = Kernel()
    kernel.slept = 0.01
    assert ran(kernel, steps=8, piece=2).seconds >= 0.01 * len(kernel.calls) > 0.01


# -- steps without a root ---------------------------------------------------------------------------------------------

MISSED = "lack a root"


@pytest.mark.parametrize(
    ("missing", "status", "reason"),
    [
        (0.0, "ok", ""),
        (0.1, "ok", "100 of 1000 steps lack a root"),
        (0.2, "no-root", "200 of 1000 steps lack a root: the"),
    ],
)
def test_steps_without_a_root_are_reported(missing, status, reason):
    t = ran(Kernel(missing=missing), steps=1000, missed=MISSED)
    assert t.status == status
    assert t.reason.startswith(reason)
    assert bool(t.reason) == bool(reason)
    assert ran(Kernel(missing=missing), steps=1000).reason == "", "nothing is promised"


def test_a_run_that_hardly_ever_has_a_root_is_stopped():
    def stopped(missing, steps=5000):
        return ran(Kernel(missing=missing), steps=steps, missed=MISSED, piece=trajectory.FIRST)

    t = stopped(1.0)
    assert (t.status, t.reached) == ("no-root", trajectory.FIRST)
    assert "1000 of the first 1000 steps lack a root: the energy cannot be kept" in t.reason
    assert "stopped after step 1000 of 5000 (t = 500)" in t.reason
    assert stopped(0.94).reached == 5000
    assert stopped(0.96).reached == trajectory.FIRST
    assert "of the first" not in stopped(1.0, steps=900).reason
