"""A step as a map of states y = (q, p), in doubles or in many digits; its failures are raised as `StepFailed`.

In many digits q, p and h are MPFR numbers (gmpy2) in object arrays, which a step of plain arithmetic accepts unchanged.
The step gets copies of q and p, so that writing to them does no harm; `behaviour` measures whether it does.
"""

from __future__ import annotations

import contextlib
import sys
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import gmpy2
import numpy as np

from phasebench.benchmarks.measure import own_step
from phasebench.benchmarks.measure.coefficients import LAST_DIGIT
from phasebench.benchmarks.measure.particle_step import Particle
from phasebench.integrators.compile.codegen import DOUBLE, MULTIPRECISION, to_number, vector
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.systems.hamiltonian import PartitionedSystem
from phasebench.integrators.values.kinds import Number

from .battery import Entry
from .subject import Subject

#: A unit of the last of 15 digits is 1 to 10 times `LAST_DIGIT` of the number: about this many.
TYPED = 3
#: The digits of a measurement without round-off.
DIGITS = 40


class StepFailed(Exception):
    """A step that raised, or returned no state.

    ``place`` is the file and line of the user's code; ``numerical`` is True for a division by zero, stages that do not
    converge and the like, not for a bug; ``mistaken`` if it may have taken one of its arguments for another.
    """

    place = ""
    numerical = mistaken = False


class Exact:
    """The system as it is passed to a step in many digits: like `own_step.System`, but with MPFR numbers."""

    def __init__(self, system: PartitionedSystem) -> None:
        self.d, self.evaluations, self.whole = system.d, [0, 0], system
        self._field, self._energy = system.field(MULTIPRECISION), system.energy(MULTIPRECISION)
        self._last: tuple = ((), None)

    @cached_property
    def particle(self) -> Particle:
        """The system as a charged particle with fields E and B, for a step written in positions and velocities."""
        return Particle(self.whole, MULTIPRECISION, self.evaluations)

    def _slopes(
        self, q: Sequence[Number] | np.ndarray, p: Sequence[Number] | np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """(q', p') at a state; kept for the next call, which may be at the same state."""
        state = (*q, *p)
        if self._last[0] != state:
            self._last = state, self._field(vector(q), vector(p), 0, 0)
        return self._last[1]

    def dH_dq(self, q: Sequence[Number] | np.ndarray, p: Sequence[Number] | np.ndarray) -> np.ndarray:
        """The gradient of H with respect to q in many digits, array (d,)."""
        self.evaluations[0] += 1
        return -self._slopes(q, p)[1]

    def dH_dp(self, q: Sequence[Number] | np.ndarray, p: Sequence[Number] | np.ndarray) -> np.ndarray:
        """The gradient of H by p in many digits, array (d,)."""
        self.evaluations[1] += 1
        return self._slopes(q, p)[0].copy()

    def H(self, q: Sequence[Number] | np.ndarray, p: Sequence[Number] | np.ndarray) -> Number:
        """The energy H(q, p)."""
        return self._energy(vector(q), vector(p))[0]


class Changed(Exact):
    """`Exact` whose gradients have other last digits: as if each coefficient before one were rounded otherwise."""

    begun = 0

    def _other(self) -> Number:
        n = sum(self.evaluations) - self.begun
        return 1 + to_number((1 if n * (n + 1) // 2 % 2 else -1) * TYPED * LAST_DIGIT, MULTIPRECISION)

    def dH_dq(self, q: Sequence[Number] | np.ndarray, p: Sequence[Number] | np.ndarray) -> np.ndarray:
        """The gradient of H by q, array (d,)."""
        return self._other() * super().dH_dq(q, p)

    def dH_dp(self, q: Sequence[Number] | np.ndarray, p: Sequence[Number] | np.ndarray) -> np.ndarray:
        """The gradient of H by p, array (d,)."""
        return self._other() * super().dH_dp(q, p)


@dataclass
class Stepper:
    """An integrator's step on one system, as a function (y, h) -> y of states y = (q, p), arrays (2 d,)."""

    subject: Subject
    entry: Entry
    arithmetic: str = DOUBLE
    taken: int = 0
    system: own_step.System | Exact = field(init=False)

    def __post_init__(self) -> None:
        whole = self.entry.system
        self.system = own_step.System(whole) if self.arithmetic == DOUBLE else Exact(whole)

    def __call__(self, y: np.ndarray, h: Number) -> np.ndarray:
        """Move y to the constraints, if any, and return the state after one step h from it; raises StepFailed."""
        return self.advance(self.retract(y), h)

    def retract(self, y: np.ndarray) -> np.ndarray:
        """The state on the constraints of the system near y, array (2 d,); y itself where there are none."""
        system = self.entry.system
        if not system.constrained:
            return y
        return np.concatenate(system.retract(y[: system.d], y[system.d :], self.arithmetic))

    def advance(self, y: np.ndarray, h: Number) -> np.ndarray:
        """The state after one step h from y itself, which is not moved to constraints; raises StepFailed."""
        d = self.system.d
        return self._state(self.raw(y[:d].copy(), y[d:].copy(), self.number(h)))

    def state(self, y: Sequence[Number] | np.ndarray) -> np.ndarray:
        """Convert a state to doubles or to numbers of many digits, as the stepper uses; array (2 d,)."""
        return np.array([self.number(x) for x in y], dtype=self.dtype)

    @property
    def dtype(self) -> type:
        """The dtype of state arrays: float, or object for many digits."""
        return float if self.arithmetic == DOUBLE else object

    def number(self, x: Number) -> Number:
        """Convert a number to a double or to one of many digits, as the stepper uses."""
        return float(x) if self.arithmetic == DOUBLE else to_number(x, MULTIPRECISION)

    def raw(self, q: np.ndarray, p: np.ndarray, h: Number) -> Any:
        """Call the user's step with these arrays, not copies, and return its result unchecked."""
        self.taken += 1
        with report_failures(self.subject, f"step {self.taken} on {self.entry.name}"):
            return self.subject.own.step(self.system, q, p, h)

    def _state(self, pair: Any) -> np.ndarray:
        try:
            if self.arithmetic == DOUBLE:
                return np.concatenate(own_step.check_pair(pair, self.system.d))
            y = np.concatenate([np.asarray(x, dtype=object).reshape(self.system.d) for x in pair])
        except (InvalidInput, ValueError, TypeError) as error:
            raise StepFailed(str(error)) from None
        if not all(isinstance(x, gmpy2.mpfr) for x in y):
            kinds = sorted({type(x).__name__ for x in y})
            raise StepFailed(f"it returned {', '.join(kinds)} where it was given numbers of many digits")
        return y

    def run(self, y: Sequence[Number] | np.ndarray, h: Number, steps: int, every: int = 1) -> np.ndarray:
        """Take steps h from y: states at the start and after every ``every`` steps, while finite, array (rows, 2 d)."""
        y = self.state(y)
        rows = [y]
        for n in range(1, steps + 1):
            y = self.advance(y, h)
            if self.arithmetic == DOUBLE and not np.isfinite(y).all():
                break
            if n % every == 0:
                rows.append(y)
        return np.array(rows)


@dataclass
class LastDigits(Stepper):
    """A stepper in many digits of the same step, the last digit of each of its coefficients changed by one.

    Those of a table are changed as they are printed (`coefficients.shift`), those of other code as doubles.
    """

    def __post_init__(self) -> None:
        changed = self.subject.own.changed
        if changed is None:
            self.system = Changed(self.entry.system)
        else:
            self.subject = replace(self.subject, own=replace(self.subject.own, step=changed))
            super().__post_init__()

    def raw(self, q: np.ndarray, p: np.ndarray, h: Number) -> Any:
        """As `Stepper.raw`."""
        if isinstance(self.system, Changed):
            self.system.begun = sum(self.system.evaluations)
        return super().raw(q, p, h)


@contextlib.contextmanager
def numerical_failures() -> Iterator[None]:
    """Suppress a StepFailed that is numerical, no bug."""
    try:
        yield
    except StepFailed as failure:
        if not failure.numerical:
            raise


@contextlib.contextmanager
def report_failures(subject: Subject, what: str) -> Iterator[None]:
    """Turn exceptions of the user's code, in ``what`` is done here, into StepFailed; send its prints to stderr."""
    try:
        with contextlib.redirect_stdout(sys.stderr), np.errstate(all="ignore"):
            yield
    except (Exception, SystemExit) as error:
        frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename == subject.own.where]
        where = f"{subject.own.where}, line {frames[-1].lineno}" if frames else ""
        first = (str(error).splitlines() or [""])[0]
        failure = StepFailed(f"{what}: {where}{': ' if where else ''}{type(error).__name__}: {first}")
        failure.place = where
        failure.mistaken = isinstance(error, (AttributeError, TypeError))
        failure.numerical = isinstance(error, (ArithmeticError, np.linalg.LinAlgError))
        raise failure from None
