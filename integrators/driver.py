"""The driver: checks the input, lays out the state, runs the kernel in pieces, says how it ended."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from phasebench.integrators.engine.codegen import DOUBLE, MULTIPRECISION
from phasebench.integrators.engine.kernel import kernel, prepare, zeros

from .engine import codegen, solve
from .errors import InvalidInput
from .record import Method
from .registry import method as method_of
from .request import check_timeout, grid, initial, request, spacing

OK, DIVERGED, NOT_CONVERGED, NO_ROOT, COLLISION = "ok", "diverged", "not-converged", "no-root", "collision"
INVALID, TIMEOUT, SKIPPED = "invalid", "timeout", "skipped"
STATUSES = (OK, DIVERGED, NOT_CONVERGED, NO_ROOT, COLLISION, INVALID, TIMEOUT, SKIPPED)

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
    chosen = method_of(method, **(parameters or {}))
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
    lack = chosen.lacks(system)
    if lack:
        raise InvalidInput(lack)
    prepared = prepare(chosen, system, arithmetic)
    return _run(prepared, system, chosen, q, p, h, steps, every, arithmetic, timeout, progress)


@dataclass
class _Layout:
    """A compiled kernel with the arrays of one run."""

    run: Callable
    functions: tuple
    plan: np.ndarray
    table: np.ndarray
    eps: float
    zero: tuple | np.ndarray
    state: np.ndarray
    memory: np.ndarray
    work: np.ndarray
    counts: np.ndarray

    def __call__(self, h, every, Q, P, aux) -> tuple[int, int]:
        """Fill the rows of Q, P, aux; (rows filled, status)."""
        return self.run(
            *self.functions, self.plan, self.table, h, every, self.eps, self.zero, self.state, self.memory, self.work,
            Q, P, aux, self.counts,
        )  # fmt: skip

    def restart(self, q, p) -> None:
        """Forget what was, and start from q, p."""
        for a in (self.state, self.memory, self.counts):
            a.fill(0)
        self.state[0, : len(q)], self.state[1, : len(p)] = q, p


def _lay_out(prepared, system, h, q, p, arithmetic) -> _Layout:
    d, width = system.d, prepared.width
    order = 1 + (prepared.linear or width)
    plan, table = (x(h) if callable(x) else x for x in (prepared.plan, prepared.table))
    as_tuple = codegen.compiled() and codegen.value_kind(d) == "tuple"
    layout = _Layout(
        run=kernel(prepared, d, arithmetic),
        functions=prepared.functions,
        plan=plan,
        table=table,
        eps=codegen.epsilon(arithmetic),
        zero=(0.0,) * d if as_tuple else zeros(d, arithmetic),
        state=zeros((4 + prepared.slots, max(2, d)), arithmetic),
        memory=zeros(((3 * solve.LEVELS + 1) * prepared.slots, width), arithmetic),
        work=zeros((order, order), arithmetic),
        counts=np.zeros(8, dtype=np.int64),
    )
    layout.restart(q, p)
    if prepared.begin is not None:
        value = tuple if as_tuple else np.array
        prepared.begin(layout.table, value(layout.state[0, :d]), value(layout.state[1, :d]))
    return layout


def warm(problem, method: str | Method, *, h: float, steps: int, parameters: dict | None = None) -> Callable[[], tuple]:
    """A function that integrates ``steps`` steps from the initial state, for timing: compiled, no rows, no checks.

    It returns the end state (q, p) as arrays.  Raises what `integrate` raises.
    """
    chosen = method_of(method, **(parameters or {}))
    integrate(problem, chosen, h=h, steps=1)
    h, steps = grid(h, None, steps)
    system, q, p = initial(problem, None, None)
    layout = _lay_out(prepare(chosen, system), system, h, q, p, DOUBLE)
    Q, P, aux = np.zeros((1, system.d)), np.zeros((1, system.d)), np.zeros(1)

    def run():
        layout.restart(q, p)
        layout(h, steps, Q, P, aux)
        return Q[0], P[0]

    return run


def _run(prepared, system, chosen, q, p, h, steps, every, arithmetic, timeout, progress) -> Solution:
    d = system.d
    multi = arithmetic == MULTIPRECISION
    layout = _lay_out(prepared, system, h, q, p, arithmetic)
    state, counts = layout.state, layout.counts

    rows, rest = divmod(steps, every)
    sizes = [every] * rows + ([rest] if rest else [])
    Q, P = zeros((len(sizes) + 1, d), arithmetic), zeros((len(sizes) + 1, d), arithmetic)
    Q[0], P[0] = state[0, :d], state[1, :d]
    aux = np.full(len(sizes), np.nan)
    at, status, reason, begin, spent = 0, OK, "", time.monotonic(), 0.0
    piece_rows = max(1, PIECE // every)
    while at < len(sizes) and status == OK:
        n = min(piece_rows, rows - at) if at < rows else 1
        part = slice(at, at + n)
        step_rows = sizes[at]
        span, whole = (step_rows, 1) if step_rows <= PIECE else (PIECE, -(-step_rows // PIECE))
        for k in range(whole):
            span = min(span, step_rows - k * PIECE)
            outs = (Q[1:][part], P[1:][part], aux[part])
            started = time.perf_counter()
            filled, code = layout(h, span, *outs)
            spent += time.perf_counter() - started
            late = timeout is not None and time.monotonic() - begin > timeout
            if code or late:
                break
        if late and k < whole - 1:
            filled = 0  # the row is of a time between two that are kept
        at += filled
        if not multi:
            bad = np.flatnonzero(~np.isfinite(Q[1:][part][:filled]).all(1) | ~np.isfinite(P[1:][part][:filled]).all(1))
            if len(bad):
                at = at - filled + bad[0]
                status, reason = DIVERGED, "the state is no longer finite"
            elif system.H is not None:
                lost = np.flatnonzero(
                    ~np.isfinite(system.observe(system.H, Q[1:][part][:filled], P[1:][part][:filled]))
                )
                if len(lost):
                    at = at - filled + lost[0]
                    status, reason = DIVERGED, "the energy is no longer finite: the state is outside H's domain"
        if status == OK and code:
            status = DIVERGED if code == solve.NOT_FINITE else NOT_CONVERGED
            reason = (
                "a stage equation has no finite iterate"
                if code == solve.NOT_FINITE
                else ("neither the fixed point nor Newton's method solves the stage equation")
            )
            size, begun = np.abs([Q[at], P[at]]).max(), np.abs([Q[0], P[0]]).max()
            if status == NOT_CONVERGED and size > ESCAPED * (1 + begun):
                status, reason = DIVERGED, f"the state has grown to {size:.3g}"
        elif status == OK and late and at < len(sizes):
            status, reason = TIMEOUT, f"{timeout} s had passed"
        if progress is not None:
            progress(min(steps, at * every))
    done = int(min(steps, at * every))
    Q, P, aux = Q[: at + 1], P[: at + 1], aux[:at]
    index = np.minimum(np.arange(at + 1) * every, steps)
    t = np.array([h * int(i) for i in index], dtype=object if multi else float)
    if status not in (OK, TIMEOUT):
        near = _approach(system, Q[-1:], P[-1:], h)
        if near is not None:
            status, reason = COLLISION, near
        reason += f" after step {done} of {steps} (t = {float(t[-1]):.6g}); " + (
            "a regularized or adaptive method is needed" if status == COLLISION else "take a smaller h"
        )
    elif status == TIMEOUT:
        reason += f" after step {done} of {steps} (t = {float(t[-1]):.6g}); the rows so far are kept"
    elif not multi and system.singular and system.H is not None:
        near = _passed(system, Q, P, h)
        if near is not None:
            status, reason = COLLISION, near
    missed = int(counts[3])
    if prepared.missed and missed and status == OK:
        reason = f"{missed} of {done} steps {prepared.missed}"
        if missed > TOLERATED * done:
            status, reason = NO_ROOT, reason + ": the energy is not kept; take a smaller h"
    evaluations = int(counts[1])
    tally = {
        "steps": done,
        "gradient": evaluations,
        "hessian": evaluations if prepared.hessian else 0,
        "iterations": evaluations if prepared.implicit else 0,
        "fallbacks": int(counts[3]),
        "newton": int(counts[2]),
    }
    return Solution(t, Q, P, status, reason, tally, h, chosen, aux, spent)


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
