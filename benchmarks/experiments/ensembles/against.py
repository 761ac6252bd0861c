"""Ensembles in SIMD lanes compared with heyoka's batches: the cost of an orbit over the error of the worst orbit.

The error is the largest distance, over the orbits, of the end state from heyoka's in long double.  All orbits are
distinct.  This project and heyoka run on one core, alternating, from arrays of initial states to arrays of end states;
heyoka's batch integrator is reset in place.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from phasebench.benchmarks.ladder.costs import SPAN
from phasebench.benchmarks.measure.timing import median, time_in_turns
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import ALONE, Cell, ProblemKey, Rows, Unavailable, content
from phasebench.integrators.ensemble import integrate_ensemble
from phasebench.integrators.registry import method
from phasebench.reference.peers import BY_ID

from .lanes import starts

if TYPE_CHECKING:
    from phasebench.integrators.systems.hamiltonian import PartitionedSystem

TABLE = "ensembles_against"
PROBLEMS = ("henon-heiles:box", "pendulum", "kepler")
T_END, ROUNDS = 100.0, 6
#: Orbits that heyoka integrates and whose error is measured on both sides; orbits of our ensembles.
JUDGED, ORBITS = 128, 512
#: Errors at which costs are compared.
ERRORS = (1e-1, 1e-3, 1e-5, 1e-7, 1e-9, 1e-10, 1e-11, 1e-12)
#: How often intermediate rungs are inserted between neighbours whose errors differ by a factor of `SPAN` or more.
HALVED = 3
#: Method -> steps in a unit of time of each rung; methods that cannot integrate a problem are left out there.  From
#: one rung to the next the error should fall by at most two decades, for the method's order.
LADDERS = {
    "stormer-verlet": (2, 5, 10, 30),
    "blanes-moan-srkn6b": (2, 4, 8, 16),
    "blanes-moan-srkn11b": (1, 2, 4, 8),
    "kahan-li-8": (1, 1.5, 2, 3, 4, 6, 8),
    "sofroniou-spaletta-10": (1, 1.5, 2, 3, 4, 6, 8),
    "sofroniou-spaletta-10-adaptive": (0.5, 0.75, 1, 1.5, 2.25, 3),
}
#: Factor on these numbers of steps, for problems that need shorter steps.
SHORTER = {"kepler": 4}
#: heyoka's tolerances before intermediate ones are inserted: a factor of ten apart, and the smallest.
TOLERANCES = (*(float(f"1e-{k}") for k in range(2, 16)), 2.220446049250313e-16)
PEER = "heyoka-batch"


class Rung(NamedTuple):
    """A run of an integrator at one step or tolerance.

    Attributes
    ----------
    who : label of the integrator
    kind : "h" if ``value`` is a step, "tol" if it is a tolerance
    value : the step or tolerance
    """

    who: str
    kind: str
    value: float


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`), one for each problem, also if ``quick``."""
    return [
        Cell(
            "ensembles",
            (TABLE,),
            {"problem": problem(name).label},
            measure_rows,
            (name,),
            content(TABLE, *map(method, LADDERS), BY_ID[PEER], ProblemKey(name), code=[__name__]),
            frozenset({name.partition(":")[0], PEER, *LADDERS}),
            ALONE,
            own=True,
        )
        for name in PROBLEMS
    ]


def exact(system: PartitionedSystem, Q: np.ndarray, P: np.ndarray) -> np.ndarray:
    """Integrate an ensemble with starts Q, P (n, d) to `T_END` with heyoka in long double.

    Returns end states rounded to double, array (n, 2 d).  Raises Unavailable if heyoka has no long double here.
    """
    from phasebench.reference.solvers import taylor

    try:
        long, _ = taylor.extended_types()
    except taylor.ReferenceFailed as error:
        raise Unavailable(str(error)) from None
    ta = taylor.integrator(system, long)
    out = np.empty((len(Q), 2 * system.d))
    for i, (q, p) in enumerate(zip(Q, P, strict=True)):
        taylor.start(ta, long, q, p)
        ta.propagate_until(long(T_END))
        out[i] = ta.state.astype(float)
    return out


def _batches(system: PartitionedSystem, tol: float, width: int, y: np.ndarray) -> Callable[[], np.ndarray]:
    """Make a function that integrates the states y, array (n, 2 d), to `T_END` in heyoka batches of ``width`` orbits.

    ``tol`` is the tolerance.  The function has no arguments and returns the end states, an array like y.
    """
    import heyoka as hy

    from phasebench.reference.solvers import taylor

    one = taylor.integrator(system, float, tol)
    ta = hy.taylor_adaptive_batch(one.sys, np.zeros((one.dim, width)), tol=one.tol)
    lanes, end = np.ascontiguousarray(y.reshape(-1, width, one.dim).transpose(0, 2, 1)), [T_END] * width

    def run() -> np.ndarray:
        out = np.empty_like(lanes)
        for start, row in zip(lanes, out, strict=True):
            ta.set_time(0.0)
            ta.state[:] = start
            ta.propagate_until(end)
            row[:] = ta.state
        return out.transpose(0, 2, 1).reshape(y.shape)

    return run


def _ours(system: PartitionedSystem, id: str, h: float, Q: np.ndarray, P: np.ndarray) -> Callable[[], np.ndarray]:
    """Make a function that integrates the starts Q, P (n, d) to `T_END` with the method ``id`` of this project, step h.

    The function has no arguments and returns the end states, array (n, 2 d), with NaN for orbits that failed.
    """

    def run() -> np.ndarray:
        e = integrate_ensemble(system, id, Q, P, t_end=T_END, steps=round(T_END / h), threads=1)
        return np.where((e.status == "ok")[:, None], np.hstack([e.q, e.p]), np.nan)

    return run


def widths() -> tuple[int, ...]:
    """Return heyoka's recommended number of SIMD lanes on this processor, and twice that."""
    import heyoka as hy

    return hy.recommended_simd_size(), 2 * hy.recommended_simd_size()


def measure_rows(name: str) -> Rows:
    """Measure error and cost of an orbit at every step of this project's methods and every tolerance of heyoka.

    ``name`` is the problem.  Returns rows by table name, one for each method and step, or tolerance: the error of the
    worst orbit, and microseconds an orbit with their interval.
    """
    found = problem(name)
    system, (Q, P) = found.system, starts(found, ORBITS)
    truth = exact(system, Q[:JUDGED], P[:JUDGED])
    factor = SHORTER.get(found.id, 1)
    ladders = {id: rungs for id, rungs in LADDERS.items() if method(id).lacks(system) is None}
    batches, both = {f"heyoka, {width} lanes": width for width in widths()}, np.hstack([Q, P])[:JUDGED]

    def callable_for(who: str, kind: str, value: float) -> Callable[[], np.ndarray]:
        return _batches(system, value, batches[who], both) if kind == "tol" else _ours(system, who, value, Q, P)

    asked = [Rung(id, "h", 1 / (k * factor)) for id, rungs in ladders.items() for k in rungs]
    asked += [Rung(who, "tol", tol) for who in batches for tol in TOLERANCES]
    work, errors = {}, {}
    for _ in range(1 + HALVED):
        work |= {rung: callable_for(*rung) for rung in asked}
        errors |= {rung: worst(work[rung](), truth) for rung in asked}
        asked = between(errors)
    errors = {rung: errors[rung] for rung in in_order(errors)}
    seconds = time_in_turns(work, ROUNDS)
    rows = []
    for rung, error in errors.items():
        who, kind, value = rung
        orbits = orbits_of(kind)
        cost = median(1e6 * seconds[rung] / orbits)
        row = {"problem": found.label, "integrator": who, "side": "heyoka" if kind == "tol" else "ours", "t_end": T_END}
        row |= {"h": value if kind == "h" else None, "tol": value if kind == "tol" else None, "error": error}
        rows.append(row | {"us": cost.value, "us, low": cost.low, "us, high": cost.high, "orbits": orbits})
    return {TABLE: rows}


def in_order(rungs: Iterable[Rung]) -> list[Rung]:
    """Sort runs by integrator, and an integrator's runs from the longest step or loosest tolerance to the finest."""
    first = list(dict.fromkeys(rung.who for rung in rungs))
    return sorted(rungs, key=lambda rung: (first.index(rung.who), -rung.value))


def between(errors: Mapping[Rung, float]) -> list[Rung]:
    """List the runs that are still to be made, between neighbouring steps or tolerances of an integrator.

    ``errors`` maps each run made so far to its error.  The geometric mean of two neighbouring steps or tolerances is
    taken where their errors enclose one of `ERRORS` and differ by a factor `SPAN` or more.
    """
    out = []
    for a, b in pairwise(in_order(errors)):
        low, high = sorted((errors[a], errors[b]))
        wide = a.who == b.who and high >= SPAN * low and any(low < error < high for error in ERRORS)
        value = (a.value * b.value) ** 0.5
        if a.kind == "h":
            value = T_END / round(T_END / value)
        if wide and b.value < value < a.value:
            out.append(Rung(a.who, a.kind, value))
    return out


def worst(ends: np.ndarray, truth: np.ndarray) -> float:
    """Compute the error of the worst orbit, the largest difference of a coordinate; NaN if any orbit did not arrive.

    Parameters
    ----------
    ends : end states of a run, array (n, 2 d); the first m of them are compared
    truth : end states of the reference, array (m, 2 d) with m <= n
    """
    return float(np.abs(ends[: len(truth)] - truth).max())


def orbits_of(kind: str) -> int:
    """Return the number of orbits that a run integrates: `JUDGED` by heyoka (``kind`` "tol"), else `ORBITS` ("h")."""
    return JUDGED if kind == "tol" else ORBITS
