"""The rows (stored states) of a run, filled by several kernel calls; rows reached are kept however the run ends."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .compile import machine
from .compile.codegen import MULTIPRECISION
from .outcome import (
    COLLISION,
    DIVERGED,
    NO_ROOT,
    NOT_CONVERGED,
    OK,
    TIMEOUT,
    UNSOLVED,
    describe_approach,
    describe_crossing,
    describe_escape,
    judge,
)
from .stepping import codes
from .stepping.kernel import zeros

if TYPE_CHECKING:
    from .outcome import SolverFailure
    from .prepared import Layout
    from .systems.hamiltonian import PartitionedSystem
    from .values.kinds import Number

#: A state that has grown by this factor has escaped, whatever stopped it in the end.
ESCAPED = 1e6
#: A method that keeps the energy and misses it in a larger share of its steps has the status "no-root".
TOLERATED = 0.1
#: One that misses it in this share of its first steps is stopped.
HOPELESS, FIRST = 0.95, 1000
#: Steps of one call of a kernel: between calls progress is told and the clock is looked at.
PIECE = 200_000


class Pace:
    """The number of steps in one kernel call: few at first if there is a time limit, then more.

    A kernel is a compiled loop over steps; the clock is looked at between its calls.

    Attributes
    ----------
    steps : the number of steps in the next call
    tell : called between calls with the number of steps so far
    """

    def __init__(self, timeout: float | None, first: int = PIECE, tell: Callable[[int], None] | None = None) -> None:
        self.tell = tell or (lambda steps: None)
        self.timeout = np.inf if timeout is None else timeout
        self.deadline = time.monotonic() + self.timeout
        self.steps = first if timeout is None else 64

    @property
    def late(self) -> bool:
        """True if the time limit has passed."""
        return time.monotonic() > self.deadline

    def adapt(self, seconds: float) -> None:
        """Quadruple the steps of the next call if the last one took few ``seconds`` compared with the time limit."""
        if seconds < min(0.05, self.timeout / 20):
            self.steps = min(PIECE, 4 * self.steps)


def _leading(good: np.ndarray) -> int:
    """The number of leading True values of a boolean array."""
    return len(good) if good.all() else int(good.argmin())


def whole_rows(steps: int, every: int, filled: int, most: int) -> int:
    """The number of complete rows that one kernel call of at most ``most`` steps can fill.

    The run has ``steps`` steps and a row after every ``every`` steps; ``filled`` rows are already filled.
    """
    return min(most // every, steps // every - filled)


class Trajectory:
    """The rows (stored states) of a run, one after every ``every`` steps and the last, with the status so far.

    Attributes
    ----------
    q, p : arrays (n + 1, d); row 0 is the initial state
    parameter : array (n, 1), for methods that choose a parameter in each step to keep the energy: that of the last
        step before each row after the first; else NaN
    filled : the number of filled rows after the initial state
    reached : the number of the step that the last filled row belongs to
    status, reason : the status so far, "ok" unless the run has stopped, and its reason
    seconds : time spent in the kernel
    """

    def __init__(
        self,
        system: PartitionedSystem,
        q: Sequence[Any] | np.ndarray,
        p: Sequence[Any] | np.ndarray,
        h: Number,
        steps: int,
        every: int,
        arithmetic: str,
        missed: str = "",
        unsolved: SolverFailure = UNSOLVED,
        t0: float = 0.0,
    ) -> None:
        self.system, self.h, self.steps, self.every, self.arithmetic = system, h, steps, every, arithmetic
        self.t0 = t0
        self.missed, self.unsolved = missed, unsolved  # what a fallback is, and a stage not solved, in words
        n = -(-steps // self.every)
        self.q, self.p = zeros((n + 1, system.d), arithmetic), zeros((n + 1, system.d), arithmetic)
        self.q[0], self.p[0] = q, p
        self.parameter = np.full((n, 1), np.nan)
        self.filled = 0
        self.reached = 0  # the number of the step that the last filled row belongs to
        self.looks: list[tuple] = []  # (step, q, p) between rows
        self.seconds = 0.0
        self.status, self.reason, self.advice = OK, "", ""

    def __bool__(self) -> bool:
        """True if the run is "ok" so far and has rows to fill."""
        return self.status == OK and self.filled < len(self.parameter)

    @property
    def index(self) -> np.ndarray:
        """The step numbers of the filled rows."""
        numbers = np.arange(self.filled + 1) * self.every
        numbers[-1] = self.reached
        return numbers

    @property
    def times(self) -> np.ndarray:
        """The times of the filled rows."""
        return self.t0 + self.h * (self.index.astype(object) if self.arithmetic == MULTIPRECISION else self.index)

    def advance(self, run: Layout, pace: Pace) -> None:
        """Make a kernel call by ``run`` (several, for a row of many steps), check new rows, update the status."""
        n = whole_rows(self.steps, self.every, self.filled, pace.steps)
        code = self._rows(run, n, pace) if n > 1 else self._row(run, pace)
        if self.status == OK and code:
            self._explain_stop(code)
        elif self.status == OK and self.reached < self.steps:
            self._check_fallbacks(run)
            if pace.late and self.status == OK:
                self.status = TIMEOUT

    def _call(self, run: Layout, n: int, every: int, pace: Pace) -> tuple[int, int]:
        """Fill the next n rows, ``every`` steps apart, by one kernel call; returns (rows filled, status code)."""
        part = slice(self.filled, self.filled + n)
        began, waited = time.perf_counter(), machine.waited()
        filled, code = run(self.q[1:][part], self.p[1:][part], self.parameter[part], every)
        waited = machine.waited() - waited
        took = time.perf_counter() - began - waited
        pace.deadline += waited
        self.seconds += took
        pace.adapt(took)
        return filled, code

    def _rows(self, run: Layout, n: int, pace: Pace) -> int:
        filled, code = self._call(run, n, self.every, pace)
        bad, reason = self._find_flaw(self.filled + 1, filled)
        if bad < filled:
            self.status, self.reason = DIVERGED, reason
        self.filled += bad
        self.reached = self.filled * self.every
        return code

    def _row(self, run: Layout, pace: Pace) -> int:
        """Fill one row by several kernel calls; store the last good state if the run stops. Returns the status code."""
        row, end = self.filled + 1, min(self.steps, (self.filled + 1) * self.every)
        began, code = self.reached, codes.SOLVED
        while self.reached < end:
            good = self.q[row].copy(), self.p[row].copy()
            piece = min(end - self.reached, pace.steps)
            filled, code = self._call(run, 1, piece, pace)
            bad, reason = self._find_flaw(row, filled)
            if not bad:
                self.q[row], self.p[row] = good
                if filled:
                    self.status, self.reason = DIVERGED, reason
                break
            self.reached += piece
            if self.reached < end:
                pace.tell(self.reached)
                self.looks.append((self.reached, self.q[row].copy(), self.p[row].copy()))
                self._check_fallbacks(run)
            if pace.late or self.status != OK:
                break
        self.filled += self.reached > began
        return code

    def _find_flaw(self, first: int, n: int) -> tuple[int, str]:
        """Check the n rows from ``first`` on; returns (how many are good, the reason why the next one is not, or "").

        A row is good if its state and energy, and those of the rows before it, are finite.
        """
        if self.arithmetic == MULTIPRECISION:
            return n, ""
        Q, P = self.q[first : first + n], self.p[first : first + n]
        good, reason = _leading(np.isfinite(Q).all(1) & np.isfinite(P).all(1)), ""
        if good < n:
            reason = "the state is no longer finite"
        if self.system.has_energy and good:
            known = _leading(np.isfinite(self.system.energies(Q[:good], P[:good])))
            if known < good:
                good, reason = known, "the energy is no longer finite: the state is outside H's domain"
        return good, reason

    def _explain_stop(self, code: int) -> None:
        """Set status and reason from the code of a kernel that stopped early."""
        if code == codes.NOT_FINITE:
            self.status, self.reason = DIVERGED, "a stage equation has no finite iterate"
            return
        if code == codes.OUT_OF_STEP:
            self.status = NOT_CONVERGED
            self.reason = "the control of the step has lost the problem's time scale; take a smaller h"
            return
        size, begun = (np.abs([self.q[i], self.p[i]]).max() for i in (self.filled, 0))
        if size > ESCAPED * (1 + begun):
            self.status, self.reason = DIVERGED, f"the state has grown to {size:.3g}"
        else:
            self.status = NOT_CONVERGED
            self.reason, self.advice = self.unsolved

    def _check_fallbacks(self, run: Layout) -> None:
        """Stop the run if nearly all steps so far are fallbacks, which lack what the method promises."""
        fallbacks = int(run.counts.fallbacks)
        if self.missed and self.reached >= FIRST and fallbacks > HOPELESS * self.reached:
            self.status = NO_ROOT
            self.reason = f"{fallbacks} of the first {self.reached} steps {self.missed}: the energy cannot be kept on "
            self.reason += "this orbit; take another method, or a smaller h; stopped"

    def conclude(self, timeout: float | None, fallbacks: int) -> None:
        """Complete status and reason at the end of a run; judge the energy error and steps across singularities.

        ``timeout`` is the time limit in seconds; ``fallbacks`` is the number of steps that lack what the method
        promises.
        """
        at = f"after step {self.reached} of {self.steps} (t = {float(self.t0 + self.h * self.reached):.6g})"
        if self.status in (OK, TIMEOUT):
            if self.status == TIMEOUT:
                self.reason = f"{timeout} s had passed {at}; what was reached is kept"
            self._count_missed(fallbacks)
            if self.arithmetic != MULTIPRECISION:
                self._judge()
            return
        _, Q, P = self._seen_rows()
        near = describe_approach(self.system, Q, P, self.h)
        if near is not None:
            self.status, self.reason = COLLISION, f"{near} {at}; a regularized or adaptive method is needed"
        elif self.status == DIVERGED and self.arithmetic != MULTIPRECISION:
            self.reason += f" {at}; take a smaller h{describe_escape(self.system, Q, P)}"
        else:
            self.reason += f" {at}" if self.status == NO_ROOT else f" {at}; take a smaller h{self.advice}"

    def _seen_rows(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(t, Q, P) of the rows, and of the states between rows at which a kernel call ended, in order of time."""
        Q, P = self.q[: self.filled + 1], self.p[: self.filled + 1]
        if not self.looks:
            return self.times, Q, P
        seen, q, p = (np.array(x) for x in zip(*self.looks, strict=True))
        index, which = np.unique(np.concatenate([self.index, seen]), return_index=True)
        return self.t0 + self.h * index, np.concatenate([Q, q])[which], np.concatenate([P, p])[which]

    def _judge(self) -> None:
        """Set the status if a step crossed a singularity or the energy error shows that the rows are not the orbit."""
        t, Q, P = self._seen_rows()
        near = describe_crossing(self.system, t, Q, P, self.h)
        if near is not None:
            self.status, self.reason = COLLISION, near
            return
        if self.status == NO_ROOT:  # that explains the energy
            return
        found = judge(self.system, t, Q, P)
        self.status = self.status if found.status == OK else found.status
        self.reason = "; ".join(filter(None, (self.reason, found.reason)))

    def _count_missed(self, fallbacks: int) -> None:
        """Write into the reason how many steps were fallbacks; if they are many, set the status "no-root"."""
        if not self.missed or not fallbacks or self.status != OK:
            return
        self.reason = f"{fallbacks} of {self.reached} steps {self.missed}"
        if fallbacks > TOLERATED * self.reached:
            self.status, self.reason = NO_ROOT, self.reason + ": the energy is not kept; take a smaller h"
