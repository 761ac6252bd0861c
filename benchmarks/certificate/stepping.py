"""A step as a map of states y = (q, p), in doubles or in many digits, and what goes wrong while it is taken.

In many digits q, p and h are MPFR's numbers (gmpy2) in object arrays: a step of plain arithmetic takes them as it
stands.  The step is handed copies, which it may not but can write to: whether it does is a measurement of its own.
"""

from __future__ import annotations

import contextlib
import sys
import traceback
from dataclasses import dataclass, field

import gmpy2
import numpy as np

from phasebench.benchmarks.measure import own_step
from phasebench.integrators.engine.codegen import DOUBLE, MULTIPRECISION, exactly, vector
from phasebench.integrators.errors import InvalidInput

from .battery import Entry
from .subject import Subject

#: The digits of a measurement without round-off.
DIGITS = 40


class StepFailed(Exception):
    """A step that raised, or returned no state."""


class Exact:
    """What a step sees of a system in many digits: `own_step.System` for numbers of MPFR.

    Attributes
    ----------
    d : degrees of freedom
    evaluations : of `dH_dq` and of `dH_dp` so far
    """

    def __init__(self, system):
        self.d, self.evaluations = system.d, [0, 0]
        self._field, self._energy = system.field(MULTIPRECISION), system.energy(MULTIPRECISION)
        self._last: tuple = ((), None)

    def _slopes(self, q, p):
        """(q', p'), those of the last state where it is asked for again."""
        state = (*q, *p)
        if self._last[0] != state:
            self._last = state, self._field(vector(q), vector(p), 0, 0)
        return self._last[1]

    def dH_dq(self, q, p) -> np.ndarray:
        """The gradient by q, (d,)."""
        self.evaluations[0] += 1
        return -self._slopes(q, p)[1]

    def dH_dp(self, q, p) -> np.ndarray:
        """The gradient by p, (d,)."""
        self.evaluations[1] += 1
        return self._slopes(q, p)[0].copy()

    def H(self, q, p):
        """The energy."""
        return self._energy(vector(q), vector(p))[0]


@dataclass
class Stepper:
    """A subject's step on a system.

    Attributes
    ----------
    subject, entry : whose step, and on what
    arithmetic : "double" or "multiprecision"
    taken : steps so far
    """

    subject: Subject
    entry: Entry
    arithmetic: str = DOUBLE
    taken: int = 0
    system: own_step.System | Exact = field(init=False)

    def __post_init__(self):
        whole = self.entry.system
        self.system = own_step.System(whole) if self.arithmetic == DOUBLE else Exact(whole)

    def __call__(self, y: np.ndarray, h) -> np.ndarray:
        """The state after one step from y, array (2 d,); raises StepFailed."""
        d = self.system.d
        return self._state(self.raw(y[:d].copy(), y[d:].copy(), self.number(h)))

    def state(self, y) -> np.ndarray:
        """A state in its arithmetic."""
        return np.array([self.number(x) for x in y], dtype=self.dtype)

    @property
    def dtype(self):
        """Of its states."""
        return float if self.arithmetic == DOUBLE else object

    def number(self, x):
        """A number in its arithmetic."""
        return float(x) if self.arithmetic == DOUBLE else exactly(x, MULTIPRECISION)

    def raw(self, q, p, h):
        """What the subject's step returns for these very arrays."""
        self.taken += 1
        with told(self.subject, f"step {self.taken} on {self.entry.name}"):
            return self.subject.own.step(self.system, q, p, h)

    def _state(self, pair) -> np.ndarray:
        try:
            if self.arithmetic == DOUBLE:
                return np.concatenate(own_step.returned(pair, self.system.d))
            y = np.concatenate([np.asarray(x, dtype=object).reshape(self.system.d) for x in pair])
        except (InvalidInput, ValueError, TypeError) as error:
            raise StepFailed(str(error)) from None
        if not all(isinstance(x, gmpy2.mpfr) for x in y):
            kinds = sorted({type(x).__name__ for x in y})
            raise StepFailed(f"it returned {', '.join(kinds)} where it was given numbers of many digits")
        return y

    def run(self, y, h, steps: int, every: int = 1) -> np.ndarray:
        """The states after every so many steps, the start first, array (rows, 2 d); it ends where one is not finite."""
        y = self.state(y)
        rows = [y]
        for n in range(1, steps + 1):
            y = self(y, h)
            if self.arithmetic == DOUBLE and not np.isfinite(y).all():
                break
            if n % every == 0:
                rows.append(y)
        return np.array(rows)


@contextlib.contextmanager
def told(subject: Subject, what: str):
    """What the user's code raises as StepFailed with file and line; what it prints is no result of ours."""
    try:
        with contextlib.redirect_stdout(sys.stderr), np.errstate(all="ignore"):
            yield
    except (Exception, SystemExit) as error:
        frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename == subject.own.where]
        where = f"{subject.own.where}, line {frames[-1].lineno}: " if frames else ""
        first = (str(error).splitlines() or [""])[0]
        raise StepFailed(f"{what}: {where}{type(error).__name__}: {first}") from None
