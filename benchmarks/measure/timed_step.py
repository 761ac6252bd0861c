r"""A user's own step that is called with the time: ``step(system, q, p, h, t)``, for an H that depends on it.

q and p are arrays (d,) of the variables without the time, and the system is called as ``system.dH_dq(q, p, t)``,
``system.dH_dp(q, p, t)`` and ``system.H(q, p, t)``.  `InTime` makes it a step of the system with the time as a
coordinate, as all other code expects.  The momentum of the time, :math:`p_t' = -\partial H/\partial t`, which the step
does not tell, is integrated by Simpson's rule over the cubic through both ends of the step, an error of order 4.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from .particle_step import is_pair

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from phasebench.benchmarks.certificate.stepping import Exact
    from phasebench.benchmarks.measure.own_step import System
    from phasebench.integrators.values.kinds import Number

#: The name of a step's fifth argument by which it asks for the time.
TIME = "t"


def in_time(step: Callable) -> bool:
    """True if the step's fifth argument is the time."""
    try:
        return list(inspect.signature(step).parameters)[4:5] == [TIME]
    except (TypeError, ValueError):
        return False


class Timed:
    """The argument ``system`` of a step that is called with the time: H and its derivatives at q, p, t."""

    def __init__(self, system: System | Exact) -> None:
        self.system, self.driven = system, system.whole.driven
        self.d = system.d - self.driven

    def __getattr__(self, name: str) -> Any:
        """What else the system has, such as its constraints."""
        return getattr(self.system, name)

    def dH_dq(self, q: ArrayLike, p: ArrayLike, t: Number) -> np.ndarray:
        """The gradient of H by q, array (d,)."""
        return self.system.dH_dq(*self._state(q, p, t))[: self.d]

    def dH_dp(self, q: ArrayLike, p: ArrayLike, t: Number) -> np.ndarray:
        """The gradient of H by p, array (d,)."""
        return self.system.dH_dp(*self._state(q, p, t))[: self.d]

    def H(self, q: ArrayLike, p: ArrayLike, t: Number) -> Number:
        """The energy at q, p and the time t."""
        return self.system.H(*self._state(q, p, t))

    def _state(self, q: ArrayLike, p: ArrayLike, t: Number) -> tuple[ArrayLike, ArrayLike]:
        return (np.append(q, t), np.append(p, 0 * t)) if self.driven else (q, p)


class InTime:
    """A step (system, q, p, h) -> (q, p) made from a user's step (system, q, p, h, t) -> (q, p)."""

    def __init__(self, step: Callable[..., tuple[Any, Any]], check: Callable[[Any, int], object]) -> None:
        self.step, self.check, self.__name__ = step, check, getattr(step, "__name__", type(step).__name__)

    def __call__(self, system: System | Exact, q: np.ndarray, p: np.ndarray, h: Number, t: Number = 0) -> Any:
        """Take the user's step from q, p, of which the last are the time and its momentum if H depends on it.

        ``t`` is the time if H does not.  For a result that is no state of d numbers ``check(result, d)`` is called.
        """
        seen = Timed(system)
        if not seen.driven:
            return self.step(seen, q, p, h, t)
        pair = self.step(seen, q[:-1], p[:-1], h, q[-1])
        if not is_pair(pair) or any(np.shape(x) != (seen.d,) for x in pair):
            self.check(pair, seen.d)
        counted = list(system.evaluations)
        start, end = np.concatenate([q, p]), np.concatenate([pair[0], [q[-1] + h], pair[1], p[-1:]])
        first, last = _flow(system, start), _flow(system, end)
        middle = _flow(system, (start + end) / 2 + h / 8 * (first - last))
        system.evaluations[:] = counted
        end[-1] = p[-1] + h / 6 * (first + 4 * middle + last)[-1]
        return end[: system.d], end[system.d :]


def _flow(system: System | Exact, y: np.ndarray) -> np.ndarray:
    q, p = y[: system.d], y[system.d :]
    return np.concatenate([system.dH_dp(q, p), -system.dH_dq(q, p)])
