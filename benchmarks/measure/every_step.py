"""Runs an integrator once and observes every step in bounded memory: few saved rows, errors over all steps.

A method of this project fills a buffer of rows, one piece of the run after another.  The energy and the invariants are
evaluated on each piece; every Nth row is kept, and the row of the worst energy error, so that the run can be judged.  A
user's own step is observed as it returns.  A peer runs in one piece and returns as many rows as fit in memory.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from phasebench.integrators import driver
from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.driver import DIVERGED, OK, TIMEOUT, Solution
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.outcome import solver_failure, travel
from phasebench.integrators.record import Method
from phasebench.integrators.request import LARGEST, check_timeout, grid, request
from phasebench.integrators.stepping.kernel import prepare
from phasebench.integrators.trajectory import PIECE, Pace, Trajectory
from phasebench.reference.peers import Peer

from .integrator import Integrator
from .own_step import OwnStep, check_pair

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem
    from phasebench.integrators.outcome import SolverFailure
    from phasebench.integrators.prepared import Layout
    from phasebench.integrators.systems.hamiltonian import PartitionedSystem

    from .own_step import System

#: Largest number of components of q in the kept rows by default, and in the buffer.
KEPT, BUFFER = 1_000_000, 400_000
#: A run of more than `SHORT` seconds is timed again in `PARTS` parts of `SHARE` of its steps, a shorter one in full.
SHORT, PARTS, SHARE = 0.25, 6, 1 / 200


class Extreme:
    """The deviation of a series of numbers from its first finite value, updated as the run goes on.

    Attributes
    ----------
    first : the first finite value, or None
    worst, end : the largest absolute, and the last signed deviation; None until there are two finite values
    """

    def __init__(self) -> None:
        self.first: float | None = None
        self.worst: float | None = None
        self.end: float | None = None

    def see(self, values: np.ndarray) -> None:
        """Update with the next values along the run, array (n,); non-finite ones are left out."""
        good = values[np.isfinite(values)]
        if self.first is None and len(good):
            self.first, good = float(good[0]), good[1:]
        if len(good):
            self.worst = max(self.worst or 0.0, float(np.abs(good - self.first).max()))
            self.end = float(good[-1] - self.first)


class Extremes:
    """The deviations (`Extreme`) of the ``energy`` and the ``invariants`` of a problem from their first values."""

    def __init__(self, problem: Problem) -> None:
        self.problem, self.energy = problem, Extreme()
        self.invariants = {name: Extreme() for name in problem.invariants}

    def see(self, Q: np.ndarray, P: np.ndarray) -> None:
        """Update with the next states, arrays (n, d)."""
        if self.problem.system.has_energy:
            self.energy.see(self.problem.system.energies(Q, P))
        for name, extreme in self.invariants.items():
            extreme.see(self.problem.invariant(name, Q, P))


class WatchedRun(NamedTuple):
    """A run of which every step was observed: its solution, and the deviations over all steps."""

    solution: Solution
    extremes: Extremes


def watch(
    problem: Problem,
    integrator: Integrator,
    *,
    every: int | None = None,
    tol: float | None = None,
    timeout: float | None = None,
    **common: Any,
) -> WatchedRun:
    """Run an integrator once on a problem, save some rows, and evaluate the energy and the invariants at every step.

    Of a peer, an integrator of another package, only the rows that it returns are evaluated.  ``every`` keeps every Nth
    row, None as many as there is room for; the other arguments are those of `Integrator.run`.
    """
    extremes = Extremes(problem)
    record = integrator.record
    if isinstance(record, Peer):
        return WatchedRun(_of_peer(problem, integrator, extremes, tol, common), extremes)
    if tol is not None:
        raise InvalidInput(f"'{integrator.id}' takes a step h, no tolerance")
    keep = _spacing(problem, every, common)
    run = _of_method if isinstance(record, Method) else _of_step
    return WatchedRun(run(problem, record, extremes, keep, timeout, common), extremes)


def _spacing(problem: Problem, every: int | None, common: dict) -> int:
    """The number of steps between saved rows; raises InvalidInput if the rows do not fit in memory."""
    d = problem.system.d
    _, steps = grid(common["h"], common["t_end"], common["steps"], common.get("t0", 0.0))
    if every is None:
        return max(1, -(-steps * d // KEPT))
    if (rows := 1 + -(-steps // every)) * d > LARGEST:
        raise InvalidInput(f"{rows:.3g} rows of d = {d} do not fit in memory; keep fewer with --every")
    return min(every, steps)


# -- methods of this project ------------------------------------------------------------------------------------------


class ThinnedTrajectory(Trajectory):
    """A trajectory that passes the states (n, d) after all steps to ``seen``, and saves every Nth."""

    def __init__(
        self,
        seen: Callable[[np.ndarray, np.ndarray], None],
        system: PartitionedSystem,
        q: np.ndarray,
        p: np.ndarray,
        h: float,
        steps: int,
        every: int,
        *words: str | SolverFailure,
        t0: float = 0.0,
    ) -> None:
        super().__init__(system, q, p, h, steps, every, DOUBLE, *words, t0=t0)
        self.seen = seen
        n = min(steps, PIECE, max(1, BUFFER // system.d))
        self._buffer = np.zeros((n + 1, system.d)), np.zeros((n + 1, system.d)), np.full((n, 1), np.nan)
        self._last = np.array([q, p], dtype=float)
        seen(self.q[:1], self.p[:1])

    def __bool__(self) -> bool:
        """True while steps are left to integrate and the run has not failed."""
        return self.status == OK and self.reached < self.steps

    def advance(self, run: Layout, pace: Pace) -> None:
        """Integrate one piece of the run into a buffer, pass its rows to ``seen``, and save every Nth."""
        n = min(len(self._buffer[2]), pace.steps, self.steps - self.reached)
        kept = self.q, self.p, self.parameter, self.filled
        self.q, self.p, self.parameter, self.filled = *self._buffer, 0
        try:
            filled, code = self._call(run, n, 1, pace)
            good, reason = self._find_flaw(1, filled)
        finally:
            self.q, self.p, self.parameter, self.filled = kept
        if good:
            self._keep(good)
        if good < filled:
            self.status, self.reason = DIVERGED, reason
        elif code:
            self._close()
            self._explain_stop(code)
        else:
            self._check_fallbacks(run)
            if self.reached < self.steps and pace.late and self.status == OK:
                self.status = TIMEOUT
        if self.reached == self.steps or self.status != OK:
            self._close()

    def _keep(self, n: int) -> None:
        """Pass the first n states of the buffer to the function ``seen``, and save every Nth state of the run."""
        Q, P, parameter = (x[1 : n + 1] if x is not self._buffer[2] else x[:n] for x in self._buffer)
        self.seen(Q, P)
        begin = self.reached
        at = np.arange(-(begin + 1) % self.every, n, self.every)
        rows = slice(self.filled + 1, self.filled + 1 + len(at))
        self.q[rows], self.p[rows], self.parameter[self.filled : self.filled + len(at)] = Q[at], P[at], parameter[at]
        self.filled += len(at)
        if self.every > 1:
            for i in self._telling(Q, P):
                self.looks.append((begin + 1 + i, Q[i].copy(), P[i].copy()))
        self.reached += n
        self._last[:] = Q[-1], P[-1]

    def _telling(self, Q: np.ndarray, P: np.ndarray) -> list[int]:
        """The indices of the largest energy error, and of the first state that a step could take into a singularity."""
        found = []
        if self.system.has_energy:
            start = self.system.energies(self.q[:1], self.p[:1])[0]
            found.append(int(np.abs(self.system.energies(Q, P) - start).argmax()))
        if self.system.singularities:
            distance, length = travel(self.system, Q, P, self.h)
            found += np.flatnonzero(length > distance)[:1].tolist()
        return found

    def _close(self) -> None:
        """Save the last state reached, too, if it is not saved yet."""
        if self.reached > self.filled * self.every:
            self.filled += 1
            self.q[self.filled], self.p[self.filled] = self._last


def _of_method(
    problem: Problem, record: Method, extremes: Extremes, every: int, timeout: float | None, common: dict
) -> Solution:
    check_timeout(timeout)
    asked = request(problem, **common, save_every=every, tangent=record.tangent)
    system = asked.system
    lack = record.lacks(system)
    if lack:
        raise InvalidInput(lack)
    kernel = prepare(record, system, DOUBLE)
    words = kernel.missed, solver_failure(record.family, system.d)
    size = asked.h, asked.steps, asked.every
    trajectory = ThinnedTrajectory(extremes.see, system, asked.q, asked.p, *size, *words, t0=asked.t0)
    return driver._run(kernel, trajectory, record, timeout, None, problem)


# -- others -----------------------------------------------------------------------------------------------------------


def _of_step(
    problem: Problem, record: OwnStep, extremes: Extremes, every: int, timeout: float | None, common: dict
) -> Solution:
    d = problem.system.d
    rows = np.empty((2, max(1, min(PIECE, BUFFER // d)), d))
    filled = 0

    def flush() -> None:
        nonlocal filled
        extremes.see(rows[0, :filled].copy(), rows[1, :filled].copy())
        filled = 0

    def step(system: System, q: np.ndarray, p: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray]:
        nonlocal filled
        q, p = check_pair(record.step(system, q, p, h), d)
        rows[:, filled] = q, p
        filled += 1
        if filled == rows.shape[1]:
            flush()
        return q, p

    first = request(problem, **common, save_every=0)
    extremes.see(first.q[None], first.p[None])
    whole = Integrator(replace(record, step=step)).run(problem, **common, save_every=every, timeout=timeout)
    flush()
    return replace(whole, method=record)


def _of_peer(problem: Problem, integrator: Integrator, extremes: Extremes, tol: float | None, common: dict) -> Solution:
    d, every = problem.system.d, 1
    if common["h"] is not None or common["steps"] is not None:
        _, steps = grid(common["h"], common["t_end"], common["steps"], common.get("t0", 0.0))
        every = max(1, -(-steps * d // (LARGEST // 4)))
    solution = integrator.run(problem, **common, tol=tol, save_every=every)
    extremes.see(solution.q, solution.p)
    return solution


def seconds(
    problem: Problem, integrator: Integrator, watched: WatchedRun, *, tol: float | None = None, **common: Any
) -> float:
    """Return the seconds of a run without output after compilation, for comparison with other integrators.

    A short run is repeated without output.  For a run of more than `SHORT` seconds those of the observed run are
    multiplied by the ratio of the times that short parts of it take without and with observation.
    """
    solution = watched.solution
    steps, h = solution.counts["steps"], solution.h
    if isinstance(integrator.record, Peer):
        steps = len(solution.t) - 1
        if steps == 1:
            return solution.seconds
    if solution.seconds <= SHORT:
        return integrator.run(problem, **common, tol=tol, save_every=0).seconds
    part: dict[str, Any] = {"h": h, "t_end": None, "steps": max(1, int(steps * SHARE)), "tol": tol}
    bare = rows = 0.0
    for k in range(PARTS):
        # A later state may be off the constraints by more than a start may be.
        row = 0 if problem.system.constrained else k * (len(solution.t) - 1) // PARTS
        start = {"q0": solution.q[row], "p0": solution.p[row]}
        rows += watch(problem, integrator, **part, **start).solution.seconds
        bare += integrator.run(problem, **part, **start, save_every=0).seconds
    return solution.seconds * bare / rows
