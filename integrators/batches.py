"""Integrate the orbits of an ensemble in batches: orbits with the same kernel (compiled loop over steps) side by side.

They run in SIMD lanes: each lane of a vector register computes a different orbit.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import InitVar, dataclass, replace
from threading import Event, Lock
from typing import TYPE_CHECKING, Any

import numpy as np

from .compile import codegen
from .outcome import OK, flag_crossings, flag_energy_errors
from .record import Method
from .stepping import orbit_lanes
from .stepping.kernel import COUNTS, TALLY, Prepared, Samples, prepare
from .stepping.orbit_lanes import LANES
from .threads import LEAST, Halted, map_slices
from .trajectory import PIECE, whole_rows

if TYPE_CHECKING:
    from .solution import Solution
    from .systems.hamiltonian import PartitionedSystem

#: Below this many orbits the lanes are not filled, and a kernel for them need not be compiled.
ENOUGH = LANES.n
#: Seconds of a kernel call, and from which on it is too long to wait for its end after Ctrl-C.
CALL, LONG = 0.2, 1.0
#: The cost of a kernel is measured in a SHARE-th of the steps at most, unless these, times d, are fewer than SHORT.
SHARE, SHORT = 16, 1000


@dataclass
class Orbits:
    """The state of an ensemble while it is integrated: n orbits, their rows (stored states), and how each ended.

    Attributes
    ----------
    system : the system that is integrated
    q, p : arrays (n, d), the initial states
    h, steps, every : arrays (n,): step, number of steps, number of steps between two rows
    kinds, kind : list of the different methods, and array (n,): for each orbit the index of its method in ``kinds``
    rows : room for so many rows, of which the first, the initial state, is filled
    Q, P : arrays (n, rows, d), NaN where a row is not filled
    filled : array (n,), the number of good rows
    status, reason : arrays (n,) of text
    counts : name -> number of steps, evaluations, ..., summed over the orbits
    lock : guards ``counts``, which several threads update
    halt : set once the results are no longer wanted (Ctrl-C)
    cost : index in ``kinds`` -> seconds of a step of the kernel, at least
    """

    system: object
    q: np.ndarray
    p: np.ndarray
    h: np.ndarray
    steps: np.ndarray
    every: np.ndarray
    kinds: list[Method]
    kind: np.ndarray
    rows: InitVar[int]

    def __post_init__(self, rows: int) -> None:
        n = len(self.q)
        self.Q, self.P = (np.full((n, rows, self.system.d), np.nan) for _ in "qp")
        self.Q[:, 0], self.P[:, 0] = self.q, self.p
        self.filled = np.ones(n, int)
        self.status, self.reason = (np.full(n, text, dtype=object) for text in (OK, ""))
        self.counts = dict.fromkeys(TALLY, 0)
        self.lock, self.halt = Lock(), Event()
        self.cost: dict[int, float] = {}

    #: Orbits of a batch that are integrated to their end before the next; all where that is 0.
    group = 0

    def max_steps(self, every: int, orbits: int) -> int:
        """The largest number of steps of one kernel call, for rows ``every`` steps apart and so many ``orbits``."""
        return PIECE

    def check_halt(self, *_: object) -> None:
        """Raise `Halted` once the results are no longer wanted."""
        if self.halt.is_set():
            raise Halted

    def measure(self, i: int, call: Callable[[int], object]) -> None:
        """Measure the cost of a step of orbit i's method by trials, unless it is known or the run is short.

        ``call(steps)`` takes steps that are not those of the run.
        """
        n, steps, seconds = 1, int(self.steps[i]), 0.0
        if int(self.kind[i]) in self.cost or steps * self.system.d < SHORT:
            return
        while seconds < LEAST and n * SHARE <= steps:
            began = time.perf_counter()
            call(n)
            seconds = time.perf_counter() - began
            self.cost[int(self.kind[i])] = seconds / n
            n *= 2

    def is_slow(self, kind: int) -> bool:
        """True if a kernel call of `PIECE` steps would take long."""
        return PIECE * self.cost.get(kind, 0.0) > LONG

    def calls(self, members: np.ndarray) -> Iterator[tuple[int, int, int]]:
        """Divide the run of the orbits ``members`` into kernel calls, as `pieces` does; it can be halted between them.

        Only calls that would take long are shorter than those of `integrate`: round-off may depend on where one ends.
        """
        kind, steps, every = (int(x[members[0]]) for x in (self.kind, self.steps, self.every))
        most = self.max_steps(every, len(members))
        if self.is_slow(kind):
            most = min(most, max(1, int(CALL / self.cost[kind])))
        for piece in pieces(steps, every, most):
            self.check_halt()
            yield piece

    def room(self, i: int, first: int, rows: int) -> tuple[np.ndarray, np.ndarray]:
        """The parts (rows, d) of Q[i] and P[i] for ``rows`` rows from ``first`` on; row 0 follows the initial state."""
        filled = slice(1 + first, 1 + first + rows)
        return self.Q[i, filled], self.P[i, filled]

    def keeper(self, members: np.ndarray, width: int) -> Callable[[int, np.ndarray, np.ndarray, int], None]:
        """Return the function that stores computed rows of the orbits with the indices ``members``.

        The function (first, q, p, taken) stores arrays q, p of shape (blocks of orbits, rows, d, width), with ``width``
        orbits side by side in a block.  ``first`` is the number of their first row, 0 for the one after the initial
        state, and ``taken`` the number of steps so far.
        """

        def keep(first: int, q: np.ndarray, p: np.ndarray, taken: int) -> None:
            if width > 1:  # else `room` has them
                filled = slice(1 + first, 1 + first + q.shape[1])
                self.Q[members, filled], self.P[members, filled] = (
                    orbit_lanes.from_blocks(x, len(members)) for x in (q, p)
                )

        return keep

    def end(self, members: np.ndarray) -> None:
        """Record that all rows of the orbits with the indices ``members`` are filled."""
        self.filled[members] = self.Q.shape[1]

    def enter(self, i: int, solution: Solution) -> None:
        """Store the rows, status and counts of orbit i, which was integrated by itself."""
        filled = len(solution.q)
        self.Q[i], self.P[i] = np.nan, np.nan
        self.Q[i, :filled], self.P[i, :filled] = solution.q, solution.p
        self.filled[i] = filled
        self.conclude(i, solution)

    def conclude(self, i: int, solution: Solution) -> None:
        """Store the status and reason of orbit i, and add its counts to those of the ensemble."""
        self.status[i], self.reason[i] = solution.status, solution.reason
        with self.lock:
            for name, number in solution.counts.items():
                self.counts[name] = self.counts.get(name, 0) + number

    def forget(self, members: np.ndarray) -> None:
        """Discard what a subclass has stored of orbits besides rows, before they are integrated again."""

    def suspects(self, members: np.ndarray) -> np.ndarray:
        """The indices among ``members`` of the orbits that are integrated again to determine their status."""
        return find_doubtful(self, members)


@dataclass(frozen=True)
class Batch:
    """Orbits that are integrated together: they have the same kernel and the same number of steps.

    Attributes
    ----------
    prepared : their kernel (loop over steps), with the coefficients that they share
    loop : the compiled loop over blocks of orbits; a block has as many orbits as there are lanes
    members : array (n,), the indices of the orbits
    weights : name of a field of the method's step, "mu" or "lam" -> array (n, substeps), the weights of the substeps of
        each orbit; empty for methods without such weights
    """

    prepared: Prepared
    loop: Callable
    members: np.ndarray
    weights: dict[str, np.ndarray]


def runs_in_lanes(system: PartitionedSystem, method: Method) -> bool:
    """True if orbits of the method on the system can be integrated side by side in SIMD lanes."""
    return orbit_lanes.runs_in_lanes(system, method)


def build(orbits: Orbits, members: np.ndarray) -> list[Batch]:
    """Divide the orbits with the indices ``members`` into batches, and compile the kernels of these."""
    twin = orbit_lanes.twin(orbits.system)
    parts: dict[tuple, list] = {}
    pairs, number = np.unique(np.stack([orbits.kind, orbits.steps])[:, members], axis=1, return_inverse=True)
    known = {k: prepare(orbits.kinds[k], twin) for k in set(pairs[0].tolist())}
    for i, (kind, steps) in enumerate(pairs.T.tolist()):
        parts.setdefault((*_shared_key(known[kind]), steps), []).append((known[kind], members[number.reshape(-1) == i]))
    return [_batch(part, orbits.system.d) for part in parts.values()]


def _shared_key(prepared: Prepared) -> tuple:
    """The kernel and all its coefficients but h and the weights of substeps, which may differ in a batch."""
    fields = {k: v for k, v in prepared.step._asdict().items() if k not in orbit_lanes.VARYING}
    return (prepared.run, *((v.shape, v.tobytes()) if isinstance(v, np.ndarray) else v for v in fields.values()))


def _batch(parts: list[tuple[Prepared, np.ndarray]], d: int) -> Batch:
    first = parts[0][0]
    weights = {
        name: np.concatenate([np.tile(getattr(prepared.step, name), (len(members), 1)) for prepared, members in parts])
        for name in orbit_lanes.WEIGHTS
        if hasattr(first.step, name)
    }
    step = first.step._replace(eps=codegen.epsilon(codegen.DOUBLE))
    first = replace(first, step=step)
    loop = orbit_lanes.loop(first, orbit_lanes.varying_of(np.ones(1), {k: w[:1] for k, w in weights.items()}), d)
    return Batch(first, loop, np.concatenate([members for _, members in parts]), weights)


def run(made: list[Batch], orbits: Orbits, threads: int, tell: Callable[[int], None]) -> None:
    """Integrate the batches on ``threads`` threads, and write the rows (stored states) of their orbits to ``orbits``.

    The threads share the work in units of one vector register of orbits.
    ``tell`` is called with the number of orbits that have been finished since its last call.
    """
    ends = np.cumsum([0, *(-(-len(batch.members) // LANES.n) for batch in made)]).tolist()

    def share(part: slice) -> list[tuple[dict[str, int], int]]:
        of_batches = [
            (batch, slice(LANES.n * (max(part.start, first) - first), LANES.n * (min(part.stop, end) - first)))
            for batch, first, end in zip(made, ends, ends[1:], strict=False)
            if max(part.start, first) < min(part.stop, end)
        ]
        return [_share(batch, members, orbits) for batch, members in of_batches]

    for batch in made:
        _measure(batch, orbits)
    for found in map_slices(share, ends[-1], threads, orbits.halt):
        for counts, n in found:
            for name, number in counts.items():
                orbits.counts[name] += number
            tell(n)


def pieces(steps: int, every: int, most: int | None = None) -> Iterator[tuple[int, int, int]]:
    """Divide a run of ``steps`` steps into kernel calls; yield for each (first row, number of rows, steps for a row).

    A row is stored after every ``every`` steps; a call makes at most ``most`` steps.  Where ``every`` is larger than
    that, several calls with the same first row lead to one stored row; the state after the last of them is stored.
    """
    first, most = 0, PIECE if most is None else most
    while first * every < steps:
        n = whole_rows(steps, every, first, most)
        if n > 1:
            yield first, n, every
            first += n
            continue
        for begun in range(first * every, min(steps, (first + 1) * every), most):
            yield first, 1, min(most, steps - begun, (first + 1) * every - begun)
        first += 1


def _share(batch: Batch, part: slice, orbits: Orbits) -> tuple[dict[str, int], int]:
    """Integrate the orbits batch.members[part], `Orbits.group` at a time: (counts by name, number of orbits)."""
    total, n = Counter(), len(batch.members[part])
    first, last = part.start, part.start + n
    i = batch.members[first]
    seconds = orbits.cost.get(int(orbits.kind[i]), 0.0) * min(PIECE, int(orbits.steps[i]))
    group = orbits.group or n
    if seconds * n > CALL * LANES.n:
        group = min(group, LANES.n * max(1, int(CALL / seconds)))
    for begin in range(first, last, group):
        total.update(_integrate(batch, slice(begin, min(last, begin + group)), orbits))
    return total, n


def _arguments(batch: Batch, part: slice, orbits: Orbits) -> tuple[Any, orbit_lanes.Tables, np.ndarray]:
    members = batch.members[part]
    weights = {name: rows[part] for name, rows in batch.weights.items()}
    tables = orbit_lanes.tables_of(batch.prepared, orbits.q[members], orbits.p[members])
    return orbit_lanes.varying_of(orbits.h[members], weights), tables, np.zeros(len(tables.state), COUNTS)


def _measure(batch: Batch, orbits: Orbits) -> None:
    varying, tables, counts = _arguments(batch, slice(0, LANES.n), orbits)
    q, p, parameter = (np.zeros((1, 1, n, LANES.n)) for n in (orbits.system.d, orbits.system.d, 1))

    def call(steps: int) -> None:
        samples = Samples(q, p, parameter, steps)
        batch.loop(batch.prepared.step, varying, tables, (0.0,) * orbits.system.d, samples, counts)

    orbits.measure(batch.members[0], call)


def _integrate(batch: Batch, part: slice, orbits: Orbits) -> dict[str, int]:
    """Integrate the orbits of a slice of a batch side by side, and store their rows; returns counts by name."""
    members = batch.members[part]
    n, d, width = len(members), orbits.system.d, LANES.n
    varying, tables, counts = _arguments(batch, part, orbits)
    blocks = len(counts)
    keep, taken = orbits.keeper(members, width), 0
    steps = int(orbits.steps[members[0]])
    q = p = parameter = np.zeros((0, 0))
    for first, rows, every in orbits.calls(members):
        if q.shape[1] != rows:
            q, p = (np.zeros((blocks, rows, d, width)) for _ in "qp")
            parameter = np.zeros((blocks, rows, 1, width))
        q[:, -1] = np.nan  # what stops before its last row is not asked for the others
        batch.loop(batch.prepared.step, varying, tables, (0.0,) * d, Samples(q, p, parameter, every), counts)
        taken += rows * every
        keep(first, q, p, taken)
    orbits.end(members)
    evaluations = counts["gradient"]
    if not (batch.prepared.implicit or batch.prepared.apart):  # counted once for all lanes
        evaluations = evaluations * np.minimum(width, n - width * np.arange(blocks))
    return batch.prepared.tally(n * steps, int(evaluations.sum()))


def find_doubtful(orbits: Orbits, members: np.ndarray) -> np.ndarray:
    """The indices among ``members`` of orbits with a row that is not finite, a large energy error, or a crossing."""
    if not len(members):
        return members
    Q, P = orbits.Q[members], orbits.P[members]
    n, rows, d = Q.shape
    bad = ~(np.isfinite(Q).all(axis=(1, 2)) & np.isfinite(P).all(axis=(1, 2)))
    system = orbits.system
    if system.has_energy:
        flat = Q.reshape(-1, d), P.reshape(-1, d)
        H, M = (x.reshape(n, rows) for x in (system.energies(*flat), system.scale(*flat)))
        bad |= flag_energy_errors(H, M).any(axis=1)
        if system.singularities:
            bad |= flag_crossings(system, Q, P, orbits.h[members], H, M)
    return members[bad]
