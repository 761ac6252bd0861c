r"""A user's own step for a charged particle in positions and velocities: ``step(system, x, v, h)``.

It calls the fields ``system.E(x)`` and ``system.B(x)``.  A file with ``REQUIRES = ("magnetic",)`` may have one::

    def step(system, x, v, h):
        x = x + h / 2 * v
        v = v + h / 2 * system.E(x)
        t = h / 2 * system.B(x)
        u = v + np.cross(v, t)
        v = v + np.cross(u, 2 * t / (1 + t @ t))
        v = v + h / 2 * system.E(x)
        return x + h / 2 * v, v

x, v, E and B have three components.  In a problem in the plane, the third of x, v and E is 0, B is along z, and the
third components that the step returns are not used.  `InMomenta` makes it a step of (q, p), as all other code expects.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from phasebench.integrators.compile import codegen
from phasebench.integrators.compile.codegen import DOUBLE, to_number
from phasebench.integrators.systems import magnetic

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from phasebench.benchmarks.certificate.stepping import Exact
    from phasebench.benchmarks.measure.own_step import System
    from phasebench.integrators.values.kinds import Number, Value

#: The trait that such a step requires.
TRAIT = "magnetic"


class Particle:
    """The argument ``system`` of a user's step in (x, v): a charged particle, x' = v, v' = E(x) + v x B(x).

    x, v, E and B are arrays (3,), also for motion in the plane.

    Attributes
    ----------
    d : 3
    evaluations : [number of evaluations of `E`, number of evaluations of `B`], the same list as the system's
    """

    d = 3

    def __init__(self, system: Any, arithmetic: str, evaluations: list[int]) -> None:
        self.evaluations, self._arithmetic, self._plane = evaluations, arithmetic, system.d == 2
        self._fields, self._shift = magnetic.fields(system, arithmetic), magnetic.shift(system, arithmetic)
        self._energy = system.energy(arithmetic)
        self._mass = to_number(magnetic.constants(system)[0], arithmetic)

    def E(self, x: ArrayLike) -> np.ndarray:
        """The electric field at x, times charge / mass."""
        self.evaluations[0] += 1
        return self._spatial(self._call(self._fields, x)[0])

    def B(self, x: ArrayLike) -> np.ndarray:
        """The magnetic field at x, times charge / mass."""
        self.evaluations[1] += 1
        B = self._array(self._call(self._fields, x)[1])
        return np.array([0 * B[0], 0 * B[0], B[0]], dtype=B.dtype) if self._plane else B

    def H(self, x: ArrayLike, v: ArrayLike) -> Number:
        """The energy at x, v."""
        q = self._value(x)
        return self._energy(q, self._value(self.momentum(x, v)))[0]

    def momentum(self, x: ArrayLike, v: ArrayLike) -> np.ndarray:
        """The canonical momentum p = m v + A(x), array (d,) with d = 2 for motion in the plane, else 3."""
        return self._mass * (self._array(self._value(v)) + self._array(self._call(self._shift, x)))

    def state(self, q: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return position and velocity (x, v), arrays (3,), of the canonical state q, p, arrays (d,)."""
        v = np.asarray(p) / self._mass - self._array(self._call(self._shift, q))
        return self._spatial(q), self._spatial(v)

    def _call(self, function: Callable, x: ArrayLike) -> Any:
        return function(self._value(x))

    def _value(self, x: ArrayLike) -> Value:
        """The first d components of x, as the system's compiled functions take them."""
        d = 2 if self._plane else 3
        x = np.asarray(x)[:d]
        if self._arithmetic != DOUBLE:
            return codegen.vector(x)
        return tuple(map(float, x)) if codegen.compiled() else np.array(x, float)

    def _array(self, x: ArrayLike) -> np.ndarray:
        return np.array(x, dtype=float if self._arithmetic == DOUBLE else object)

    def _spatial(self, x: ArrayLike) -> np.ndarray:
        x = self._array(x)
        return np.append(x, 0 * x[0]) if self._plane else x


class InMomenta:
    """A step (system, q, p, h) -> (q, p) made from a user's step (particle, x, v, h) -> (x, v)."""

    def __init__(self, step: Callable[..., tuple[Any, Any]]) -> None:
        self.step, self.__name__ = step, getattr(step, "__name__", type(step).__name__)

    def __call__(self, system: System | Exact, q: np.ndarray, p: np.ndarray, h: Number) -> Any:
        """Take the user's step from q, p in x, v, and return (q, p); an invalid result is returned as it is."""
        particle = system.particle
        x, v = particle.state(q, p)
        x.flags.writeable = v.flags.writeable = q.flags.writeable and p.flags.writeable
        before = x.copy(), v.copy()
        pair = self.step(particle, x, v, h)
        if q.flags.writeable and not all(np.array_equal(a, b) for a, b in zip((x, v), before, strict=True)):
            q[:], p[:] = x[: len(q)], particle.momentum(x, v)  # the caller sees that its arrays were changed
        if not is_pair(pair) or any(np.shape(z) != (3,) for z in pair):
            return pair
        return np.array(pair[0])[: len(q)], particle.momentum(*pair)


def is_pair(returned: object) -> bool:
    """True if what a user's step returned has two parts: a tuple or list of length 2, or an array with two rows."""
    return (isinstance(returned, (tuple, list)) or np.ndim(returned) == 2) and len(returned) == 2


def in_velocities(step: Callable) -> bool:
    """True if the second and third argument of a step function are named x and v: a step in velocities."""
    try:
        return list(inspect.signature(step).parameters)[1:3] == ["x", "v"]
    except (TypeError, ValueError):
        return False
