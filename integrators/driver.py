"""The driver: checks the input, lays out the state, runs the kernel in pieces, says how it ended."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from phasebench.integrators.engine.codegen import DOUBLE, MULTIPRECISION
from phasebench.integrators.engine.kernel import COUNTS, Orbit, Prepared, Samples, entry, kernel, prepare, value, zeros

from .engine import codegen, solve
from .errors import InvalidInput
from .record import Method
from .registry import method as method_of
from .request import check_timeout, grid, initial, request, spacing

OK, DIVERGED, NOT_CONVERGED, NO_ROOT, COLLISION = "ok", "diverged", "not-converged", "no-root", "collision"
INVALID, TIMEOUT, SKIPPED = "invalid", "timeout", "skipped"

#: A state that has grown by this factor has escaped, whatever stopped it in the end.
ESCAPED = 1e6
#: A method that keeps the energy and misses it in a larger share of its steps has the status "no-root".
TOLERATED = 0.1
#: A motion whose direction misses a singularity by less than this angle meets it.
HEAD_ON = 1e-7
#: Steps of one call of a kernel: between calls progress is told and the clock is looked at.
PIECE = 200_000


@dataclass(frozen=True)
class Solution:
    """A trajectory and how it was made.

    Attributes
    ----------
    t : array (n,), the times; t[i] is a step number times h
    q, p : arrays (n, d), the states; row 0 is the initial one
    status, reason : "ok", or what went wrong and what to do; the rows end before it
    counts : steps, evaluations of the gradient and of higher derivatives, stage iterations, Newton solves, fallbacks
    h, method : the step that was taken and the method
    parameter : array (n - 1,), the parameter lambda of Schemes IV and V in the last step of a row (NaN: no root)
    seconds : of the kernel alone (it compiles before the clock starts)
    """

    t: np.ndarray
    q: np.ndarray
    p: np.ndarray
    status: str
    reason: str
    counts: dict[str, int]
    h: float
    method: Method
    parameter: np.ndarray = field(repr=False, default=None)
    seconds: float = 0.0


def integrate(
    problem,
    method: str | Method,
    *,
    h: float | None = None,
    t_end: float | None = None,
    steps: int | None = None,
    q0=None,
    p0=None,
    save_every: int = 1,
    parameters: dict | None = None,
    arithmetic: str = DOUBLE,
    timeout: float | None = None,
    progress: Callable[[int], None] | None = None,
) -> Solution:
    """Integrate ``problem`` with ``method``.

    Parameters
    ----------
    problem : a system, or an object with ``system`` and initial data ``q0``, ``p0``
    method : an id or a method
    h, t_end, steps : two of them; h alone is adjusted so that a whole number of steps ends at t_end
    q0, p0 : arrays (d,), the initial state where not the problem's
    save_every : keep every so many-th state, and the last; 0 keeps the first and the last
    parameters : values of the method's parameters
    arithmetic : "double", or "multiprecision" at the digits of `codegen.precision` (needs NUMBA_DISABLE_JIT=1)
    timeout : seconds after which the integration stops with status "timeout"
    progress : called with the number of steps taken so far

    Returns
    -------
    Solution

    Raises
    ------
    InvalidInput
        For input that cannot be used; what happens on the way (a blow-up, a stage not solved) is a status.
    """
    record = method_of(method, **(parameters or {}))
    multi = arithmetic == MULTIPRECISION
    if multi and codegen.compiled():
        raise InvalidInput("multiprecision runs need a process with NUMBA_DISABLE_JIT=1")
    check_timeout(timeout)
    if multi:
        h = codegen.exactly(t_end, arithmetic) / steps if h is None else codegen.exactly(h, arithmetic)
        steps = steps or round(t_end / h)
        every = spacing(save_every, steps)
        system, q, p = initial(problem, q0, p0, exact=True)
        q, p = codegen.vector(q), codegen.vector(p)
    else:
        system, q, p, h, steps, every = request(
            problem, h=h, t_end=t_end, steps=steps, q0=q0, p0=p0, save_every=save_every
        )
    lack = record.lacks(system)
    if lack:
        raise InvalidInput(lack)
    prepared = prepare(record, system, arithmetic)
    trajectory = _Trajectory(system, q, p, h, steps, every, arithmetic)
    return _run(prepared, trajectory, record, timeout, progress)


@dataclass
class _Run:
    """A compiled kernel with the step, the orbit and the counts of one run."""

    kernel: Callable
    step: tuple
    orbit: Orbit
    counts: np.record

    def __call__(self, Q, P, parameter, every: int) -> tuple[int, int]:
        """Fill rows, each after ``every`` steps; (rows filled, status)."""
        return self.kernel(self.step, self.orbit, Samples(Q, P, parameter, every), self.counts)

    def restart(self, q, p) -> None:
        """Forget what was, and start from q, p."""
        self.orbit.state.fill(0)
        self.orbit.memory.fill(0)
        self.orbit.state[0, : len(q)], self.orbit.state[1, : len(p)] = q, p
        for name in self.counts.dtype.names:
            self.counts[name] = 0


def _lay_out(prepared: Prepared, d: int, h, q, p, arithmetic) -> _Run:
    """The run of a kernel from q, p."""
    order = 1 + (prepared.linear or prepared.width)
    h = float(h) if arithmetic == DOUBLE else h
    step = prepared.step._replace(h=h, eps=codegen.epsilon(arithmetic))
    if prepared.begin is not None:
        step = prepared.begin(step, value(q, d, arithmetic), value(p, d, arithmetic))
    orbit = Orbit(
        state=zeros((4 + prepared.stages, max(2, d)), arithmetic),
        memory=zeros(((3 * solve.LEVELS + 1) * prepared.stages, prepared.width), arithmetic),
        work=zeros((order, order), arithmetic),
        zero=value(zeros(d, arithmetic), d, arithmetic),
    )
    run = _Run(entry(kernel(prepared, d, arithmetic)), step, orbit, np.zeros(1, COUNTS).view(np.recarray)[0])
    run.restart(q, p)
    return run


def warm(problem, method: str | Method, *, h: float, steps: int, parameters: dict | None = None) -> Callable[[], tuple]:
    """A function that integrates ``steps`` steps from the initial state, for timing: compiled, no rows, no checks.

    It returns the end state (q, p) as arrays.  Raises what `integrate` raises.
    """
    record = method_of(method, **(parameters or {}))
    integrate(problem, record, h=h, steps=1)
    h, steps = grid(h, None, steps)
    system, q, p = initial(problem, None, None)
    integration = _lay_out(prepare(record, system), system.d, h, q, p, DOUBLE)
    Q, P, parameter = np.zeros((1, system.d)), np.zeros((1, system.d)), np.zeros((1, 1))

    def run():
        integration.restart(q, p)
        integration(Q, P, parameter, steps)
        return Q[0], P[0]

    return run


class _Trajectory:
    """The rows of a run, filled in pieces: every ``every`` steps one, and the last."""

    def __init__(self, system, q, p, h, steps: int, every: int, arithmetic: str):
        self.system, self.h, self.steps, self.every, self.arithmetic = system, h, steps, every, arithmetic
        n = -(-steps // self.every)
        self.q, self.p = zeros((n + 1, system.d), arithmetic), zeros((n + 1, system.d), arithmetic)
        self.q[0], self.p[0] = q, p
        self.parameter = np.full((n, 1), np.nan)
        self.filled = 0
        self.seconds = 0.0
        self.status, self.reason = OK, ""

    @property
    def done(self) -> int:
        """The number of the step that the last filled row belongs to."""
        return min(self.steps, self.filled * self.every)

    def __bool__(self) -> bool:
        """Whether there is more to integrate."""
        return self.status == OK and self.filled < len(self.parameter)

    def advance(self, run: _Run, deadline: float) -> None:
        """Call the kernel for as many rows as make a piece, or in pieces for one row; look at what came of it."""
        rows, rest = divmod(self.steps, self.every)
        first, n, size = self.filled, min(max(1, PIECE // self.every), rows - self.filled), self.every
        if first == rows:  # the last row, after fewer steps
            n, size = 1, rest
        part = slice(first, first + n)
        left, filled, code, late = size, 0, solve.SOLVED, False
        while left and not code and not late:
            piece = min(left, PIECE) if n == 1 else size
            left -= piece
            began = time.perf_counter()
            filled, code = run(self.q[1:][part], self.p[1:][part], self.parameter[part], piece)
            self.seconds += time.perf_counter() - began
            late = time.monotonic() > deadline
        if left and late:
            filled = 0  # the row is of a time between two that are kept
        self.filled += filled
        self._judge(first)
        if self.status == OK and code:
            self._stopped(code)
        elif late and self:
            self.status = TIMEOUT

    def _judge(self, first: int) -> None:
        """Give up the rows from the first on that is not finite, or whose energy is not."""
        if self.arithmetic == MULTIPRECISION:
            return
        Q, P = self.q[first + 1 : self.filled + 1], self.p[first + 1 : self.filled + 1]
        bad = ~np.isfinite(Q).all(1) | ~np.isfinite(P).all(1)
        reason = "the state is no longer finite"
        if not bad.any() and self.system.H is not None:
            bad = ~np.isfinite(self.system.observe(self.system.H, Q, P))
            reason = "the energy is no longer finite: the state is outside H's domain"
        if bad.any():
            self.filled = first + int(bad.argmax())
            self.status, self.reason = DIVERGED, reason

    def _stopped(self, code: int) -> None:
        """Say why a stage equation was not solved."""
        if code == solve.NOT_FINITE:
            self.status, self.reason = DIVERGED, "a stage equation has no finite iterate"
            return
        if code == solve.OUT_OF_STEP:
            self.status = NOT_CONVERGED
            self.reason = "the control of the step has lost the problem's time scale; take a smaller h"
            return
        size, begun = (np.abs([self.q[i], self.p[i]]).max() for i in (self.filled, 0))
        if size > ESCAPED * (1 + begun):
            self.status, self.reason = DIVERGED, f"the state has grown to {size:.3g}"
        else:
            self.status = NOT_CONVERGED
            self.reason = "neither the fixed point nor Newton's method solves the stage equation"

    def conclude(self, timeout: float | None) -> None:
        """Complete the reason; see whether the motion met a singularity."""
        Q, P = self.q[: self.filled + 1], self.p[: self.filled + 1]
        at = f"after step {self.done} of {self.steps} (t = {float(self.h * self.done):.6g})"
        if self.status == TIMEOUT:
            self.reason = f"{timeout} s had passed {at}; the rows so far are kept"
        elif self.status != OK:
            near = _approach(self.system, Q[-1:], P[-1:], self.h)
            if near is not None:
                self.status, self.reason = COLLISION, f"{near} {at}; a regularized or adaptive method is needed"
            else:
                self.reason += f" {at}; take a smaller h"
        elif self.arithmetic == DOUBLE and self.system.singular and self.system.H is not None:
            near = _passed(self.system, Q, P, self.h)
            if near is not None:
                self.status, self.reason = COLLISION, near

    def count_missed(self, fallbacks: int, missed: str) -> None:
        """Say how many steps lack what the method promises, in the words ``missed``."""
        if not missed or not fallbacks or self.status != OK:
            return
        self.reason = f"{fallbacks} of {self.done} steps {missed}"
        if fallbacks > TOLERATED * self.done:
            self.status, self.reason = NO_ROOT, self.reason + ": the energy is not kept; take a smaller h"


def _run(prepared, trajectory: _Trajectory, record: Method, timeout, progress) -> Solution:
    """Integrate, from the first row of the trajectory."""
    t = trajectory
    run = _lay_out(prepared, t.system.d, t.h, t.q[0], t.p[0], t.arithmetic)
    deadline = np.inf if timeout is None else time.monotonic() + timeout
    while t:
        t.advance(run, deadline)
        if progress is not None:
            progress(t.done)
    t.conclude(timeout)
    counts = run.counts
    t.count_missed(int(counts.fallbacks), prepared.missed)
    evaluations = int(counts.gradient)
    tally = {
        "steps": t.done,
        "gradient": evaluations,
        "hessian": evaluations if prepared.hessian else 0,
        "iterations": evaluations if prepared.implicit else 0,
        "fallbacks": int(counts.fallbacks),
        "newton": int(counts.newton),
    }
    n = t.filled
    index = np.minimum(np.arange(n + 1) * t.every, t.steps)
    times = t.h * (index.astype(object) if t.arithmetic == MULTIPRECISION else index)
    Q, P, parameter = t.q[: n + 1], t.p[: n + 1], t.parameter[:n, 0]
    return Solution(times, Q, P, t.status, t.reason, tally, t.h, record, parameter, t.seconds)


def _travel(system, Q, P, h):
    """(distance to the nearest singularity, length of a step) of each row."""
    distance = np.min([np.abs(system.observe(s, Q, P)) for s in system.singular], axis=0)
    return distance, h * system.speed(Q, P)


def _aim(system, Q, P):
    """The sine of the angle between the velocity and the way to the nearest singularity, of each row.

    A distance that is a function of the rows has no slopes: its motions count as passing by.
    """
    speed = system.speed(Q, P)
    sines = [np.ones(len(Q))]
    for s in system.singular:
        if not hasattr(s, "diff"):
            continue
        slopes = [system.observe(s.diff(x), Q, P) for x in system.q]
        towards = sum(g * system.observe(e, Q, P) for g, e in zip(slopes, system.dq, strict=True))
        with np.errstate(all="ignore"):
            cosine = towards / (speed * np.sqrt(sum(g**2 for g in slopes)))
        sines.append(np.sqrt(np.abs(1 - cosine**2)))
    return np.min(sines, axis=0)


def _approach(system, Q, P, h) -> str | None:
    """Whether the last good state was about to step across a singularity."""
    if not system.singular or Q.dtype == object:
        return None
    distance, length = _travel(system, Q, P, h)
    if length[-1] > distance[-1]:
        return f"the step {length[-1]:.3g} is longer than the distance {distance[-1]:.3g} to the singularity"
    return None


def _passed(system, Q, P, h) -> str | None:
    """Whether a kept step jumped across a singularity: head-on, or with a tenth of the energy lost."""
    distance, length = _travel(system, Q, P, h)
    near = np.flatnonzero(length > distance)
    if not len(near):
        return None
    head_on = near[_aim(system, Q[near], P[near]) < HEAD_ON]
    if len(head_on):
        return f"the motion meets the singularity head-on after t = {head_on[0] * h:.6g}; no step goes through it"
    H = system.observe(system.H, Q, P)
    if np.abs(H[near[0] :] - H[0]).max() <= 0.1 * abs(H[0]):
        return None
    return (
        f"near t = {near[0] * h:.6g} a step of length {length[near[0]]:.3g} crosses the singularity at distance "
        f"{distance[near[0]]:.3g} and the energy is lost; take a smaller h"
    )
