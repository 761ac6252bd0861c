"""Poincare sections of ensembles: where orbits cross a surface, mostly of one coordinate (`crossings` finds them).

Rows (states at steps) are searched as they are computed, and not stored: memory holds the points of the section, and a
few rows of every orbit, by which its energy is judged.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from . import ensemble
from .batches import Orbits
from .coefficients.dop853 import STAGES
from .crossings import Crossings, finder, sorter
from .ensemble import Floats
from .errors import InvalidInput
from .outcome import travel
from .stepping import orbit_lanes
from .trajectory import PIECE

if TYPE_CHECKING:
    from .keywords import State, States
    from .record import Method
    from .solution import Solution

#: Numbers of the rows that one call of a kernel makes, and the most rows of one orbit: they stay in the cache.
ROOM, ROWS = 1 << 17, 1 << 12
#: Orbits that are integrated side by side.
GROUP = 16 * orbit_lanes.LANES.n
#: Rows of an orbit by which its energy is judged, at most, and the most numbers of them all.
LOOKS, LOOKED = 64, 1 << 21


@dataclass(frozen=True, repr=False)
class Section:
    """The crossings of an ensemble, in the order of the orbits and of time; m of them in all.

    Attributes
    ----------
    orbit : array (m,), the number of the orbit
    t : array (m,), the times
    q, p : arrays (m, d)
    status, reason : arrays (n,) of text, how each orbit ended; crossings before its end are included
    seconds : time of the integration and of the search, without compilation
    names : the names of the d coordinates, then of the d momenta
    component, at : the index in ``names`` of the coordinate or momentum that defines the plane, -1 for a formula; and
        its value there
    of : that coordinate or momentum, or the formula
    """

    orbit: NDArray[np.intp]
    t: Floats
    q: Floats
    p: Floats
    status: NDArray[np.object_]
    reason: NDArray[np.object_]
    seconds: float
    names: tuple[str, ...] = ()
    component: int = 0
    at: float = 0.0
    of: str = ""

    def __len__(self) -> int:
        return len(self.t)

    def counts(self) -> NDArray[np.intp]:
        """The number of crossings of each orbit, array (n,)."""
        return np.bincount(self.orbit, minlength=len(self.status))

    def __repr__(self) -> str:
        """A few lines: the plane, the number of crossings, the statuses of the orbits."""
        counts = self.counts()
        lines = [f"{type(self).__name__}: {len(self)} crossings of {self.of} = {self.at:g}"]
        lines.append(f"  {len(self.status)} orbits, {int(counts.min())} to {int(counts.max())} crossings each")
        lines.append(f"  {ensemble.tally(self.status)}; {self.seconds:.3g} s")
        return "\n".join(lines)


@dataclass
class SectionOrbits(Orbits):
    """Orbits that are integrated and searched for crossings of a plane; Q and P hold a few rows, to judge the energy.

    Attributes
    ----------
    find : the compiled search, from `crossings.finder`
    of : the coordinate, momentum or formula that defines the surface
    plane : array (1, 3): index of the component in (q, p), its value there, 1 for rising, -1 for falling, 0 for either
    crossings : the crossings found so far
    near : array (n,), True for orbits that came within a step of a singularity
    """

    find: Callable | None = None
    of: str = ""
    plane: np.ndarray | None = None
    crossings: Crossings | None = None
    near: np.ndarray | None = None
    group = GROUP

    def watch(self, of: str, at: float, rising: bool | None) -> None:
        """Compile the search for crossings of a surface, and make room for them; raises InvalidInput."""
        index, x = _watched(self.system, of)
        self.of, self.find, self.crossings = of, finder(self.system, x), Crossings(self.system.d)
        self.near = np.zeros(len(self.q), bool)
        self.plane = np.array([[float(index), float(at), 0.0 if rising is None else 1.0 if rising else -1.0]])
        sorter()  # compiles

    def max_steps(self, every: int, orbits: int) -> int:
        """Whole rows, as many as fit into the processor's cache."""
        return min(PIECE, every * min(ROWS, max(2, ROOM // (2 * self.system.d * orbits))))

    def room(self, i: int, first: int, rows: int) -> tuple[np.ndarray, np.ndarray]:
        """New arrays: rows are searched for crossings and then dropped."""
        return np.empty((rows, self.system.d)), np.empty((rows, self.system.d))

    def keeper(self, members: np.ndarray, width: int) -> Callable[[int, np.ndarray, np.ndarray, int], None]:
        """Return the function that searches computed rows for crossings (see `Orbits.keeper`)."""
        search = Search(self, members, width)
        steps, every, looks = int(self.steps[members[0]]), int(self.every[members[0]]), self.Q.shape[1] - 1
        seen, near = 0, self.system.singularities > 0

        def keep(first: int, q: np.ndarray, p: np.ndarray, taken: int) -> None:
            nonlocal seen
            if taken < min(steps, (first + q.shape[1]) * every):
                return  # the row is not complete
            search(first, q, p)
            Q, P = (orbit_lanes.from_blocks(x[:, -1:], len(members)) for x in (q, p))
            last = taken * looks // steps
            self.Q[members, seen + 1 : last + 1], self.P[members, seen + 1 : last + 1] = Q, P
            seen = last
            if near:
                self._mark_near(members, *(orbit_lanes.from_blocks(x, len(members)) for x in (q, p)))

        return keep

    def _mark_near(self, members: np.ndarray, Q: np.ndarray, P: np.ndarray) -> None:
        """Mark the orbits that are within a step of a singularity in one of the rows Q, P, arrays (n, rows, d)."""
        n, rows, d = Q.shape
        h = np.repeat(self.h[members], rows)
        distance, length = travel(self.system, Q.reshape(-1, d), P.reshape(-1, d), h)
        self.near[members] |= (length > distance).reshape(n, rows).any(axis=1)

    def enter(self, i: int, solution: Solution) -> None:
        """Search the rows of the ``solution`` of orbit i for crossings; store its status and counts."""
        self.search_rows(i, solution.q, solution.p, solution.counts["steps"])
        self.conclude(i, solution)

    def search_rows(self, i: int, q: np.ndarray, p: np.ndarray, steps: int) -> None:
        """Search rows q, p, arrays (n, d), of orbit i for crossings; the first is its initial state."""
        search = Search(self, np.array([i]), 1, steps)
        rows = max(1, ROOM // self.system.d)
        for first in range(0, len(q) - 1, rows):
            some = (x[1:][first : first + rows][None, :, :, None] for x in (q, p))
            search(first, *some)

    def forget(self, members: np.ndarray) -> None:
        """Remove the crossings of these orbits, before they are integrated again."""
        self.crossings.drop(members)

    def suspects(self, members: np.ndarray) -> np.ndarray:
        """Those of `Orbits.suspects`, and the orbits that came within a step of a singularity."""
        return np.union1d(super().suspects(members), members[self.near[members]])


class Search:
    """Searches the rows of the orbits ``members`` for crossings as they are computed, ``width`` orbits side by side."""

    def __init__(self, orbits: SectionOrbits, members: np.ndarray, width: int, steps: int | None = None) -> None:
        self._orbits, self._members = orbits, members
        self._every, self._steps = (
            int(orbits.every[members[0]]),
            int(orbits.steps[members[0]] if steps is None else steps),
        )
        if width > 1:
            starts = orbit_lanes.to_blocks(orbits.q[members]), orbit_lanes.to_blocks(orbits.p[members])
            self._h = orbit_lanes.to_blocks(orbits.h[members], 1.0)
        else:
            starts = orbits.q[members, :, None], orbits.p[members, :, None]
            self._h = orbits.h[members, None].copy()
        self._last = np.ascontiguousarray(starts)
        self._work, self._slopes = np.zeros((2, orbits.system.d)), np.zeros((STAGES + 1, 2 * orbits.system.d))
        self._points, self._owners = np.empty((0, 0)), np.empty((0, 1), np.int64)

    def __call__(self, first: int, q: np.ndarray, p: np.ndarray) -> None:
        """Search rows q, p, arrays (blocks of orbits, rows, d, width), for crossings and store these.

        ``first`` is the number of the first row, 0 for the one after the initial state.
        """
        blocks, rows, d, width = q.shape
        most = blocks * width * (rows if self._orbits.plane[0, 2] == 0 else rows // 2 + 1)
        if len(self._points) < most:
            self._points, self._owners = np.empty((most, 2 * d + 1)), np.empty((most, 1), np.int64)
        orbits = self._orbits
        found = orbits.find(
            *(q, p, self._last, orbits.plane, self._every, first * self._every, self._steps),
            *(self._h, self._points, self._owners, self._work, self._slopes),
        )
        if found:
            orbits.crossings.add(self._points[:found], self._members[self._owners[:found, 0]])


def build_section(orbits: SectionOrbits, seconds: float) -> Section:
    """Make the `Section` from orbits that were searched in ``seconds``; the time to sort is added."""
    began, d = time.perf_counter(), orbits.system.d
    points, numbers = orbits.crossings.sort_points(len(orbits.q))
    orbit = np.repeat(np.arange(len(numbers)), numbers)
    t, q, p = points[:, 0], points[:, 1 : 1 + d], points[:, 1 + d :]
    names, of = ensemble.names(orbits.system), orbits.of
    spent = seconds + time.perf_counter() - began
    return Section(
        *(orbit, t, q, p, orbits.status, orbits.reason, spent),
        *(names, names.index(of) if of in names else -1, float(orbits.plane[0, 1]), of),
    )


def _watched(system: Any, of: str) -> tuple[int, Any]:
    """(The index of a coordinate or momentum, None), or (0, the expression) for a formula ``of`` of these."""
    names = [str(x) for x in (*getattr(system, "q", ()), *getattr(system, "p", ()))]
    if of in names:
        return names.index(of), None
    if not names:
        raise InvalidInput("the system has no named variables, of which a section could be told")
    return 0, system._formula(of)


def begin(
    problem: Any,
    method: Any,
    Q: States,
    P: States,
    *,
    of: str,
    at: float = 0.0,
    rising: bool | None = True,
    every: int = 1,
    **run: Any,
) -> SectionOrbits:
    """Check the arguments of `section` and create the orbits; ``run`` are h, t_end, steps, parameters.

    Raises InvalidInput.
    """
    if isinstance(every, bool) or not isinstance(every, int) or every < 1:
        raise InvalidInput(f"every is {every!r}; it must be a positive integer")
    asked = ensemble.request(problem, method, Q, P, save_every=every, **run)
    n, d = asked[1].shape
    orbits = SectionOrbits(*asked, 1 + int(np.clip(LOOKED // (2 * d * n), 1, LOOKS)))
    orbits.watch(of, at, rising)
    return ensemble.check_starts(orbits)


def in_rows(solution: Solution, of: str, at: float = 0.0, rising: bool | None = None) -> Section:
    """The crossings between the rows of a solution, which has one after every step; raises InvalidInput."""
    q, p, n = solution.q, solution.p, len(solution.q) - 1
    one = (np.array([x]) for x in (float(solution.h), n, 1))
    orbits = SectionOrbits(solution.system, q[:1], p[:1], *one, [solution.method], np.zeros(1, int), 1)
    orbits.watch(of, at, rising)
    if n:
        orbits.search_rows(0, q, p, n)
    found = build_section(orbits, 0.0)
    return replace(found, t=solution.t[0] + found.t)


def section(
    problem: Any,
    method: str | Method,
    Q: States,
    P: States,
    *,
    of: str,
    at: float = 0.0,
    rising: bool | None = True,
    every: int = 1,
    h: float | State | None = None,
    t_end: float | None = None,
    steps: int | None = None,
    parameters: Mapping | None = None,
    lanes: bool | None = None,
    threads: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> Section:
    """Integrate an ensemble and find its crossings of a plane.

    The arguments are those of `phasebench.section`, but that ``parameters`` are the method's.  The arrays take
    8 (2 d + 2) bytes a crossing; little more is needed while they are filled.

    Raises
    ------
    InvalidInput
        For input that cannot be used; what happens to an orbit on the way is its status.

    Notes
    -----
    An orbit's energy is judged by `LOOKS` of its rows; where it is lost, or the orbit came within a step of a
    singularity, the orbit is integrated again by itself, with all of its rows in memory.
    """
    run = {"h": h, "t_end": t_end, "steps": steps, "parameters": parameters}
    orbits = begin(problem, method, Q, P, of=of, at=at, rising=rising, every=every, **run)
    return build_section(orbits, ensemble.run(orbits, lanes, threads, progress)[1])
