"""Ensembles: many orbits of one system, side by side in SIMD lanes and on all cores.

If the kernel of a method (its compiled loop over steps) can run in lanes, it is called for blocks of orbits
(`stepping.orbit_lanes`); if not, the kernel for a single orbit is called for one orbit after another
(`scalar_fallback`).  Orbits that did not end well are integrated again by `driver.integrate`, which determines their
status.  Either way kernels run on threads, without the interpreter's lock.

The result is that of `integrate` for every orbit: to the last bit if the formulae have no functions but the square root
and the compiler contracts products and sums (to fused multiply-adds) in the same way in both kernels; up to round-off
if it does not, and up to the rounding of sin, cos and exp if they are called (`values.elementary` states their errors).
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from . import batches, scalar_fallback
from .batches import Orbits
from .driver import INVALID, OK, Solution, integrate
from .errors import InvalidInput
from .record import Method
from .registry import method as method_of
from .request import LARGEST, extended, grid, initial, spacing
from .threads import map_slices

if TYPE_CHECKING:
    from .keywords import State, States, Value
    from .systems.hamiltonian import PartitionedSystem

Floats = NDArray[np.float64]


@dataclass(frozen=True, repr=False)
class Ensemble:
    """The result of the integration of n orbits of d degrees of freedom.

    Attributes
    ----------
    q, p : arrays (n, d), the end states; of an orbit that stopped, its last good row
    t : array (n,), the times of the end states
    status, reason : arrays (n,) of text, for each orbit as in a `Solution`; "invalid" for a start that cannot be used
    times, Q, P : arrays (n, rows) and (n, rows, d), the rows that were kept, the first the initial state; NaN after an
        orbit has stopped
    h : array (n,), the step that each orbit took
    methods, method : list of the different methods, and array (n,): for each orbit the index of its method in the list
    counts : steps, evaluations, ... of all orbits together, as in a `Solution`; an orbit that is integrated a second
        time, to determine its status, counts twice
    in_lanes : array (n,), True if an orbit was integrated in SIMD lanes
    seconds : wall-clock time of the integration on all threads, without compilation
    system : the system that was integrated
    """

    q: Floats
    p: Floats
    t: Floats
    status: NDArray[np.object_]
    reason: NDArray[np.object_]
    times: Floats
    Q: Floats
    P: Floats
    h: Floats
    methods: list[Method]
    method: NDArray[np.intp]
    counts: dict[str, int]
    in_lanes: NDArray[np.bool_]
    seconds: float
    system: Any = None

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the d coordinates, then of the d momenta; reading them loads SymPy."""
        return () if self.system is None else names(self.system)

    def __len__(self) -> int:
        return len(self.q)

    def __repr__(self) -> str:
        """A few lines of text: the methods, the statuses with their numbers of orbits, the time spans."""
        labels = [m.label for m in self.methods]
        methods = ", ".join(labels[:SHOWN]) + (f" and {len(labels) - SHOWN} more" if len(labels) > SHOWN else "")
        n, d = self.q.shape
        lanes = f", {int(self.in_lanes.sum())} in SIMD lanes" if self.in_lanes.any() else ""
        return "\n".join(
            [
                f"Ensemble: {n} orbits of d = {d}, {methods}",
                f"  {tally(self.status)}",
                f"  to t = {format_range(self.t)}, h = {format_range(self.h)}, {self.Q.shape[1]} rows each",
                f"  {self.counts.get('steps', 0)} steps in {self.seconds:.3g} s{lanes}",
            ]
        )


#: Names of methods that an `Ensemble` prints.
SHOWN = 3


def tally(status: NDArray[np.object_]) -> str:
    """The statuses of orbits as text, each with the number of orbits: "998 ok, 2 diverged"."""
    names, numbers = np.unique(status.astype(str), return_counts=True)
    return ", ".join(f"{n} {name}" for n, name in sorted(zip(numbers, names, strict=True), reverse=True))


def format_range(values: Floats) -> str:
    """The range of numbers as text, such as "0.1 to 0.5"; one number if all are equal."""
    low, high = float(values.min()), float(values.max())
    return f"{low:.6g}" if low == high else f"{low:.6g} to {high:.6g}"


def integrate_ensemble(
    problem: Any,
    method: str | Method,
    Q: States,
    P: States,
    *,
    h: float | State | None = None,
    t_end: float | None = None,
    steps: int | None = None,
    parameters: Mapping | None = None,
    save_every: int = 0,
    lanes: bool | None = None,
    threads: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> Ensemble:
    """Integrate many orbits of a system, or of an object with ``system``, with an id or a method.

    The arguments are those of `phasebench.integrate_ensemble`, but that ``parameters`` are the method's.

    Raises
    ------
    InvalidInput
        For input that cannot be used; what happens to an orbit on the way is its status.

    Examples
    --------
    >>> from phasebench.integrators import Hamiltonian
    >>> oscillator = Hamiltonian(q="q", p="p", H="p**2/2 + q**2/2")
    >>> integrate_ensemble(oscillator, "stormer-verlet", [[1.0], [2.0]], [[0.0], [0.0]], h=0.1, steps=9).q.shape
    (2, 1)
    """
    orbits = begin(problem, method, Q, P, h, t_end, steps, parameters, save_every)
    return conclude(orbits, *run(orbits, lanes, threads, progress))


#: (orbits, i) -> the solution of orbit i.
Alone = Callable[[Orbits, int], Solution]


def run(
    orbits: Orbits, lanes: bool | None, threads: int | None, progress: Callable[[int], None] | None
) -> tuple[np.ndarray, float]:
    """Integrate orbits as `integrate_ensemble` does, and store their rows and statuses in ``orbits``.

    Returns (array (n,), True for orbits that ran in SIMD lanes; seconds of the integration).
    """
    workers = _threads(threads)
    good = np.flatnonzero(orbits.status == OK)
    wide = _goes_in_lanes(orbits, len(good), lanes)
    side_by_side, rest = (good, good[:0]) if wide else (good[:0], good)
    tell = _Progress(progress)
    tell(len(orbits.q) - len(good))
    made = batches.build(orbits, side_by_side) if len(side_by_side) else []
    if len(rest):  # compiles
        i = rest[0]
        integrate(orbits.system, orbits.kinds[orbits.kind[i]], h=orbits.h[i], steps=1, q0=orbits.q[i], p0=orbits.p[i])
    began = time.perf_counter()
    batches.run(made, orbits, workers, tell)
    left = scalar_fallback.run(orbits, rest, workers, tell)
    stopped = orbits.suspects(np.union1d(side_by_side, np.setdiff1d(rest, left)))
    tell(-len(stopped))
    _integrate_one_by_one(orbits, np.concatenate([stopped, left]).astype(int), _integrate_alone, workers, tell)
    in_lanes = np.zeros(len(orbits.q), bool)
    in_lanes[np.setdiff1d(side_by_side, stopped)] = True
    return in_lanes, time.perf_counter() - began


def run_alone(orbits: Orbits, alone: Alone, progress: Callable[[int], None] | None = None) -> tuple[np.ndarray, float]:
    """Integrate orbits as `run` does, one after the other by ``alone(orbits, i)``, which returns a solution."""
    good = np.flatnonzero(orbits.status == OK)
    tell = _Progress(progress)
    tell(len(orbits.q) - len(good))
    began = time.perf_counter()
    _integrate_one_by_one(orbits, good, alone, 1, tell)
    return np.zeros(len(orbits.q), bool), time.perf_counter() - began


def _integrate_one_by_one(
    orbits: Orbits, members: np.ndarray, alone: Alone, threads: int, tell: Callable[[int], None]
) -> None:
    """Integrate the orbits ``members`` by ``alone``; ``tell`` gets the number of those just finished."""
    orbits.forget(members)

    def share(part: slice) -> int:
        for i in members[part].tolist():
            orbits.enter(i, alone(orbits, i))
        return len(members[part])

    for number in map_slices(share, len(members), threads, orbits.halt):
        tell(number)


class _Progress:
    """Counts the orbits that are finished, and calls the user's ``progress`` function with their number."""

    def __init__(self, told: Callable[[int], None] | None) -> None:
        self.told, self.done = told, 0

    def __call__(self, more: int) -> None:
        self.done += int(more)
        if self.told is not None and more > 0:
            self.told(self.done)


def _integrate_alone(orbits: Orbits, i: int) -> Solution:
    return integrate(
        orbits.system,
        orbits.kinds[orbits.kind[i]],
        h=orbits.h[i],
        steps=int(orbits.steps[i]),
        q0=orbits.q[i],
        p0=orbits.p[i],
        save_every=int(orbits.every[i]),
        timeout=np.inf if orbits.is_slow(int(orbits.kind[i])) else None,  # with one, kernel calls are short
        progress=orbits.check_halt,
    )


def conclude(orbits: Orbits, in_lanes: np.ndarray, seconds: float) -> Ensemble:
    """Make the result for the user from orbits that have been integrated, and what `run` has returned."""
    n = np.arange(len(orbits.q))
    last = orbits.filled - 1
    number = np.minimum(np.arange(orbits.Q.shape[1]) * orbits.every[:, None], orbits.steps[:, None])
    times = orbits.h[:, None] * number
    return Ensemble(
        orbits.Q[n, last],
        orbits.P[n, last],
        times[n, last],
        orbits.status,
        orbits.reason,
        np.where(np.arange(times.shape[1]) <= last[:, None], times, np.nan),
        orbits.Q,
        orbits.P,
        orbits.h,
        orbits.kinds,
        orbits.kind,
        orbits.counts,
        in_lanes,
        seconds,
        orbits.system,
    )


def names(system: Any) -> tuple[str, ...]:
    """The names of a system's coordinates, then of its momenta."""
    return tuple(map(str, (*system.q, *system.p)))


# -- what is asked for ------------------------------------------------------------------------------------------------


def begin(
    problem: Any,
    method: Any,
    Q: States,
    P: States,
    h: float | State | None,
    t_end: float | None,
    steps: int | None,
    parameters: Mapping[str, Value | State] | None,
    save_every: int,
) -> Orbits:
    """Check the arguments of `integrate_ensemble` and create the orbits, with memory for all rows (stored states).

    Raises InvalidInput.
    """
    system, q, p, h, numbers, every, *methods = request(
        problem, method, Q, P, h=h, t_end=t_end, steps=steps, parameters=parameters, save_every=save_every
    )
    rows = 1 + -(-numbers // every)
    if len(set(rows.tolist())) > 1:
        raise InvalidInput("the orbits take different numbers of steps: keep no rows (save_every=0), or give steps")
    if len(rows) * int(rows[0]) * system.d > LARGEST:
        raise InvalidInput(f"{rows[0]} rows of {len(rows)} orbits do not fit in memory; keep fewer with save_every")
    return check_starts(Orbits(system, q, p, h, numbers, every, *methods, int(rows[0])))


def request(
    problem: Any,
    method: Any,
    Q: States,
    P: States,
    *,
    h: float | State | None = None,
    t_end: float | None = None,
    steps: int | None = None,
    parameters: Mapping[str, Value | State] | None = None,
    save_every: int = 0,
) -> tuple[PartitionedSystem, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, list[Method], np.ndarray]:
    """Check the arguments of `integrate_ensemble`, and return the first fields of `Orbits`, an entry for each orbit.

    Raises InvalidInput for arguments that cannot be used.
    """
    system = getattr(problem, "system", problem)
    if not hasattr(system, "vector_field"):
        raise InvalidInput(f"the problem is {problem!r}; give a system, such as a Hamiltonian, or a problem")
    q, p = _states("Q", Q, system), _states("P", P, system)
    if len(q) != len(p):
        raise InvalidInput(f"Q has {len(q)} rows and P has {len(p)}; give a row of each for every orbit")
    n = len(q)
    sizes, numbers = _grids(h, t_end, steps, n)
    different, which = np.unique(numbers, return_inverse=True)
    every = np.array([spacing(save_every, k) for k in different.tolist()])[which]
    kinds, kind = _methods(method, parameters or {}, n)
    for lack in {record.lacks(system) for record in kinds} - {None}:
        raise InvalidInput(lack)
    return system, q, p, sizes, numbers, every, kinds, kind


def _grids(h: float | State | None, t_end: float | None, steps: int | None, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Step h and number of steps of each orbit, arrays (n,), from two of h, t_end and steps."""
    if np.ndim(h) == 0:
        size, number = grid(h, t_end, steps)
        return np.full(n, size), np.full(n, number)
    different, which = np.unique(column("h", h, n), return_inverse=True)
    grids = [grid(x, t_end, steps) for x in different.tolist()]
    return np.array([x for x, _ in grids])[which], np.array([k for _, k in grids])[which]


def _states(name: str, rows: States, system: PartitionedSystem) -> np.ndarray:
    d = system.d - system.driven
    try:
        if np.iscomplexobj(rows):
            raise TypeError
        out = np.array(rows, dtype=float)
    except (TypeError, ValueError):
        raise InvalidInput(f"{name} must be numbers, an array (n, {d}) with a row for each orbit") from None
    if out.ndim == 2:
        out = extended(system, name, out)
    if out.ndim != 2 or out.shape[1] != system.d or not len(out):
        raise InvalidInput(f"{name} has the shape {out.shape}; it must be (n, {d}), a row for each orbit")
    return out


def column(name: str, values: Value | State, n: int) -> np.ndarray:
    """``values``, one number or one for each of n orbits, as an array; raises InvalidInput for another shape."""
    out = np.asarray(values)
    if out.ndim > 1 or (out.ndim == 1 and len(out) != n):
        raise InvalidInput(f"{name} has the shape {out.shape}; give one value, or an array ({n},)")
    return out


def _methods(method: Any, parameters: Mapping, n: int) -> tuple[list[Method], np.ndarray]:
    """The n orbits' methods: (list of the different ones, array (n,): for each orbit the index of its method)."""
    if hasattr(method, "lacks") and not isinstance(method, Method):  # a step of the user's own
        if parameters:
            raise InvalidInput(f"'{method.id}' has no parameters such as {', '.join(parameters)}")
        return [method], np.zeros(n, int)
    columns = {name: column(f"the parameter {name}", x, n).tolist() for name, x in parameters.items() if np.ndim(x)}
    same = {name: x for name, x in parameters.items() if name not in columns}
    if not columns:
        return [method_of(method, **same)], np.zeros(n, int)
    rows = list(zip(*columns.values(), strict=True))
    number = {values: k for k, values in enumerate(dict.fromkeys(rows))}
    kinds = [method_of(method, **same, **dict(zip(columns, values, strict=True))) for values in number]
    return kinds, np.array([number[values] for values in rows])


def check_starts(orbits: Orbits) -> Orbits:
    """Mark orbits as "invalid" whose start is not finite, has no finite energy or is off the constraints."""
    good = np.isfinite(orbits.q).all(1) & np.isfinite(orbits.p).all(1)
    if orbits.system.has_energy:
        good &= np.isfinite(orbits.system.energies(orbits.q, orbits.p))
    tangent = np.array([m.tangent for m in orbits.kinds])[orbits.kind]
    if orbits.system.constrained:
        good &= orbits.system.on_manifold(orbits.q, orbits.p, tangent)
    for i in np.flatnonzero(~good):
        try:
            initial(orbits.system, orbits.q[i], orbits.p[i], tangent=bool(tangent[i]))
        except InvalidInput as error:
            orbits.status[i], orbits.reason[i] = INVALID, str(error)
    return orbits


def cores() -> int:
    """The number of processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _threads(threads: int | None) -> int:
    if threads is None:
        return cores()
    if isinstance(threads, bool) or not isinstance(threads, int) or threads < 1:
        raise InvalidInput(f"threads is {threads!r}; it must be a positive integer")
    return threads


def _goes_in_lanes(orbits: Orbits, number: int, lanes: bool | None) -> bool:
    """Whether so many orbits are integrated in SIMD lanes; ``lanes`` is that of `integrate_ensemble`."""
    able = batches.runs_in_lanes(orbits.system, orbits.kinds[0])  # so are all: they differ in their parameters
    if lanes and not able:
        raise InvalidInput(f"'{orbits.kinds[0].label}' does not run in lanes on this system")
    return able and (number >= batches.ENOUGH if lanes is None else lanes)
