"""Check the input of a run: steps, initial state, rows to store, time limit."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, isfinite
from numbers import Real
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from .errors import InvalidInput

if TYPE_CHECKING:
    from .systems.hamiltonian import PartitionedSystem

#: The most numbers of a trajectory, of q and as many of p (2 GB in all).
LARGEST = 125_000_000
#: A step is made longer by this factor at most where t_end is no multiple of it: it may be near a limit of stability.
WIDENED = 1.01
#: Steps of a run, at most (messages say 1e13).
MOST = 1e13
#: The largest number of a state that is not zero is within these: what tells round-off squares changes of the state.
SMALLEST, GREATEST = 1e-150, 1e150


class Request(NamedTuple):
    """The checked input of a run.

    Attributes
    ----------
    system, q, p : the system and its initial state, arrays (d,)
    h, steps : the step, and how many
    every : the number of steps between two stored rows; the last state is stored too
    t0 : the time at the start
    """

    system: object
    q: np.ndarray
    p: np.ndarray
    h: float
    steps: int
    every: int
    t0: float = 0.0

    @property
    def step_numbers(self) -> list[int]:
        """The numbers of the steps after which a row is stored, beginning with 0."""
        return [*range(0, self.steps, self.every), self.steps]


def request(
    problem: Any,
    *,
    h: float | None = None,
    t_end: float | None = None,
    steps: int | None = None,
    q0: Sequence[Any] | np.ndarray | None = None,
    p0: Sequence[Any] | np.ndarray | None = None,
    save_every: int = 1,
    t0: float = 0.0,
    tangent: bool = True,
) -> Request:
    """Check the arguments of a run, those of `integrate`, and return them as a `Request`; raises InvalidInput.

    With ``tangent`` the initial momenta of a system with constraints must fulfil the hidden constraints, too.
    """
    h, steps = grid(h, t_end, steps, t0)
    every = spacing(save_every, steps)
    system, q, p = initial(problem, q0, p0, tangent=tangent, t0=t0)
    rows = 1 + -(-steps // every)
    if rows * system.d > LARGEST:
        room = f"{rows:.3g} rows of d = {system.d} do not fit in memory"
        raise InvalidInput(f"{room}; take fewer steps, or keep fewer with save_every in Python")
    return Request(system, q, p, h, steps, every, float(t0))


def grid(
    h: float | None = None, t_end: float | None = None, steps: float | None = None, t0: float = 0.0
) -> tuple[float, int]:
    """(h, steps) from two of h, t_end, steps; h is adjusted so that a whole number of steps leads from t0 to t_end.

    If t_end lies before t0 the step is negative, whatever sign h has; given h and steps alone, the sign of h is the
    direction.  Raises InvalidInput if numbers are missing, not finite, zero, or contradict each other, and if h would
    grow by more than 1 %; t_end and steps alone allow any step.
    """
    for name, value in (("h", h), ("t_end", t_end), ("steps", steps), ("t0", t0)):
        if value is not None and not is_finite(value):
            raise InvalidInput(f"{name} is {shown(value)}; it must be a finite number")
    if h == 0:
        raise InvalidInput("h is 0; it must be another number: a step, negative to go back in time")
    if steps is not None and (int(steps) != steps or steps < 1):
        raise InvalidInput(f"steps is {steps}; it must be a positive integer")
    if steps is not None and steps > MOST:
        raise InvalidInput(f"steps is {steps:.3g}; the most is 1e13")
    if h is None and (t_end is None or steps is None):
        raise InvalidInput("give the step h, or both t_end and steps")
    if t_end is None and steps is None:
        raise InvalidInput("give t_end or steps: where does the integration end?")
    if t_end is None:
        return float(h), int(steps)
    span = float(t_end) - float(t0)
    if span == 0:
        raise InvalidInput(f"t_end is {t_end!r}, where the integration begins; give another")
    if h is not None and h < 0 < span:
        raise InvalidInput(f"h is {h!r} and t_end = {t_end!r} lies ahead; a negative step goes back in time")
    way = 1.0 if span > 0 else -1.0
    size, number = _size_steps(None if h is None else abs(float(h)), abs(span), steps)
    return way * size, number


def _size_steps(h: float | None, span: float, steps: float | None) -> tuple[float, int]:
    """(h, steps) for a time span, all positive; h or steps may be None, and h is adjusted to divide the span."""
    if steps is None:
        if span / h > MOST:
            raise InvalidInput(f"t_end/h asks for {span / h:.3g} steps; the most is 1e13")
        steps = _count_steps(h, span)
        return span / steps if abs(steps * h - span) > 1e-12 * span else h, steps
    if h is not None and abs(steps * h - span) > 1e-9 * span:
        raise InvalidInput(f"steps times h is {steps * h}, not t_end = {span}; give two of the three")
    return span / int(steps), int(steps)


def _count_steps(h: float, t_end: float) -> int:
    """The whole number of steps nearest to t_end / h; raises InvalidInput where h would grow by more than `WIDENED`."""
    steps = max(1, round(t_end / h))
    if t_end <= steps * h * WIDENED:
        return steps
    fit = f"{t_end / steps!r} ({steps} step{'s' * (steps > 1)}) and {t_end / (steps + 1)!r} ({steps + 1} steps)"
    asked = f"h = {h!r} does not divide t_end = {t_end!r}; the nearest that do are {fit}"
    raise InvalidInput(f"{asked}: give one of them, or t_end and steps")


def spacing(save_every: float, steps: int) -> int:
    """The number of steps between stored rows; with ``save_every`` 0 only the first and the last row are stored."""
    if not is_finite(save_every) or save_every < 0 or int(save_every) != save_every:
        raise InvalidInput(f"save_every is {shown(save_every)}; it must be a positive integer, or 0 for the end alone")
    return min(int(save_every) or steps, steps)


def is_finite(value: Any) -> bool:
    """Whether the value is a real number, not a truth value, that a double holds; an integer can be too large."""
    try:
        return isinstance(value, Real) and not isinstance(value, bool) and isfinite(value)
    except OverflowError:
        return False


def shown(value: Any) -> str:
    """The value as a message shows it; Python may refuse to print an integer that no double holds."""
    long = isinstance(value, int) and value.bit_length() > 1024
    return "an integer beyond the doubles" if long else repr(value)


def check_timeout(timeout: float | None) -> None:
    """Raise InvalidInput for a time limit that is neither None nor a positive number of seconds."""
    if timeout is not None and not ((is_finite(timeout) or timeout == inf) and timeout > 0):
        raise InvalidInput(f"timeout is {shown(timeout)}; it must be a positive number of seconds")


def extended(system: PartitionedSystem, name: str, value: Any, t0: float = 0.0) -> Any:
    """Append the time t0 to ``value``, q or p by its name's first letter, or 0 for p, if H depends on time.

    ``value`` has one state or rows of states.  It is returned as it is where it has the time already.
    """
    if not system.driven or np.shape(value)[-1] != system.d - 1:
        return value
    last = np.full((*np.shape(value)[:-1], 1), t0 if name[0] in "qQ" else 0.0)
    return np.append(value, last, axis=-1)


def initial(
    problem: Any,
    q0: Sequence[Any] | np.ndarray | None = None,
    p0: Sequence[Any] | np.ndarray | None = None,
    exact: bool = False,
    tangent: bool = True,
    t0: float = 0.0,
) -> tuple[PartitionedSystem, Any, Any]:
    """Return (system, q, p): a problem's system, and q0 and p0 or, where these are None, the problem's own.

    q and p are arrays (d,) of doubles, with the time ``t0`` if H depends on it (`extended`); if ``exact``, they are
    returned as they were given.  Raises InvalidInput if the state does not fit the system, H is not finite there, or
    the state violates the system's constraints; with ``tangent`` it must satisfy the hidden constraints, too.
    """
    system = getattr(problem, "system", problem)
    if not hasattr(system, "vector_field"):
        raise InvalidInput(f"the problem is {problem!r}; give a system, such as a Hamiltonian, or a problem")
    state = []
    for name, value in (("q0", q0), ("p0", p0)):
        if value is None:
            value = getattr(problem, name, None)
        if value is None:
            raise InvalidInput(f"give {name}: the problem brings no initial data")
        if not exact:
            try:
                if np.iscomplexobj(value):
                    raise TypeError
                value = np.array(value, dtype=float).reshape(-1)
            except (TypeError, ValueError):
                raise InvalidInput(f"{name} is {value!r}; it must be numbers") from None
            if not np.isfinite(value).all():
                raise InvalidInput(f"{name} is {value.tolist()}; every component must be finite")
        value = extended(system, name, value, t0)
        if len(value) != system.d:
            d = system.d - system.driven
            raise InvalidInput(f"{name} has {len(value)} components; the problem has d = {d}")
        state.append(value)
    if not exact and system.has_energy:
        H = system.energies(state[0][None], state[1][None])[0]
        if not isfinite(H):
            raise InvalidInput(f"the energy of the initial state is {H}: it is at a singularity or outside H's domain")
    if not exact and system.constrained:
        system.check_start(*state, tangent=tangent)
    size = 1.0 if exact else max(np.abs(numbers).max() for numbers in state)
    if size > 0 and not SMALLEST <= size <= GREATEST:
        raise InvalidInput(f"the state's largest number is {size:.3g}; choose units in which it is nearer to 1")
    return system, state[0], state[1]
