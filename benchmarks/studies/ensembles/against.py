"""Ensembles in SIMD lanes beside heyoka's batches: the cost of an orbit over the error of the worst orbit.

The error is the largest distance, over the orbits, of the end state from heyoka's in long double.  All orbits are
distinct.  Both run on one core, alternating, from arrays of initial states to arrays of end states; heyoka's batch
integrator is reset in place.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pandas as pd

from phasebench.benchmarks.ladder.choice import SPAN, at
from phasebench.benchmarks.measure.timing import NOWHERE, Median, cheaper, columns, median, time_in_turns
from phasebench.benchmarks.page.page import once
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.benchmarks.store.cells import Unavailable
from phasebench.integrators.ensemble import integrate_ensemble
from phasebench.integrators.registry import method
from phasebench.integrators.systems.hamiltonian import PartitionedSystem
from phasebench.reference.peers import BY_ID
from phasebench.reference.solvers import taylor

from .lanes import BOX, PENDULUM, starts

TABLE = "ensembles_against"
PROBLEMS = (BOX, PENDULUM, "kepler")
T_END, ROUNDS = 100.0, 6
#: Orbits that heyoka integrates and whose error is measured on both sides; orbits of our ensembles.
JUDGED, ORBITS = 128, 512
#: Errors at which costs are compared.
ERRORS = (1e-1, 1e-3, 1e-5, 1e-7, 1e-9, 1e-10, 1e-11, 1e-12)
#: How often rungs are inserted between neighbours whose errors differ by a factor of `SPAN` or more.
HALVED = 3
#: Method -> steps in a unit of time of each rung, from one to the next of which the error falls by at most two decades.
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
#: heyoka's tolerances before intermediate ones are inserted.
TOLERANCES = (*(float(f"1e-{k}") for k in range(2, 16)), 2.220446049250313e-16)
NEEDS = (*map(method, LADDERS), BY_ID["heyoka-batch"])
Run = Callable[[], np.ndarray]


class Rung(NamedTuple):
    """A run of an integrator at a step ("h") or a tolerance ("tol")."""

    who: str
    kind: str
    value: float


def exact(system: PartitionedSystem, Q: np.ndarray, P: np.ndarray) -> np.ndarray:
    """End states of an ensemble by heyoka in long double, rounded to double, array (n, 2 d)."""
    try:
        long, _ = taylor.extended_types()
    except taylor.ReferenceFailed as error:
        raise Unavailable(str(error)) from None
    return np.array([taylor.states(system, long, q, p, [T_END])[0] for q, p in zip(Q, P, strict=True)], float)


def _batches(system: PartitionedSystem, tol: float, width: int, y: np.ndarray) -> Run:
    """A run of the states y, array (n, 2 d), in heyoka's batches of ``width`` orbits, to the end states."""
    import heyoka as hy

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


def _ours(system: PartitionedSystem, id: str, h: float, Q: np.ndarray, P: np.ndarray) -> Run:
    """A run of our method to the end states, NaN for orbits that failed."""

    def run() -> np.ndarray:
        e = integrate_ensemble(system, id, Q, P, t_end=T_END, steps=round(T_END / h), threads=1)
        return np.where((e.status == "ok")[:, None], np.hstack([e.q, e.p]), np.nan)

    return run


def widths() -> tuple[int, ...]:
    """heyoka's recommended number of SIMD lanes on this processor, and twice that."""
    import heyoka as hy

    return hy.recommended_simd_size(), 2 * hy.recommended_simd_size()


def against(problem: str) -> list[dict]:
    """Error and cost of an orbit at every step of our methods and every tolerance of heyoka: a row for each."""
    made = problem_of(problem)
    system, (Q, P) = made.system, starts(made, ORBITS)
    truth = exact(system, Q[:JUDGED], P[:JUDGED])
    factor, batches = SHORTER.get(made.id, 1), {f"heyoka, {width} lanes": width for width in widths()}
    both = np.hstack([Q, P])[:JUDGED]

    def run(who: str, kind: str, value: float) -> Run:
        return _batches(system, value, batches[who], both) if kind == "tol" else _ours(system, who, value, Q, P)

    able = {id: rungs for id, rungs in LADDERS.items() if method(id).lacks(system) is None}
    asked = [Rung(id, "h", 1 / (k * factor)) for id, rungs in able.items() for k in rungs]
    asked += [Rung(who, "tol", tol) for who in batches for tol in TOLERANCES]
    work, errors = {}, {}
    for _ in range(1 + HALVED):
        work |= {rung: run(*rung) for rung in asked}
        errors |= {rung: worst(work[rung](), truth) for rung in asked}
        asked = between(errors)
    seconds = time_in_turns(work, ROUNDS)
    rows = []
    for rung in in_order(errors):
        peer = rung.kind == "tol"
        orbits = JUDGED if peer else ORBITS
        row = {"integrator": rung.who, "side": "heyoka" if peer else "ours", "t_end": T_END}
        row |= {"h": None if peer else rung.value, "tol": rung.value if peer else None, "error": errors[rung]}
        rows.append(row | columns("us", median(1e6 * seconds[rung] / orbits)) | {"orbits": orbits})
    return rows


def in_order(rungs: Iterable[Rung]) -> list[Rung]:
    """Runs by integrator, those of each from the longest step or loosest tolerance to the finest."""
    first = list(dict.fromkeys(rung.who for rung in rungs))
    return sorted(rungs, key=lambda rung: (first.index(rung.who), -rung.value))


def between(errors: Mapping[Rung, float]) -> list[Rung]:
    """The runs still to be made, half way between two of an integrator that are `SPAN` apart around one of `ERRORS`."""
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
    """The largest difference of a coordinate in the first rows, as many as of ``truth``; NaN if one did not arrive."""
    return float(np.abs(ends[: len(truth)] - truth).max())


def least(rows: pd.DataFrame, error: float) -> tuple[str, Median]:
    """(Name, cost) of the cheapest integrator with an error of at most ``error``; ("", `NOWHERE`) if there is none."""
    costs = {name: at(rungs, error) for name, rungs in rows.groupby("integrator", sort=False)}
    name = min(costs, key=lambda k: costs[k].value, default=None)
    return ("", NOWHERE) if name is None or costs[name] is NOWHERE else (name, costs[name])


@once
def compared(frame: pd.DataFrame) -> pd.DataFrame:
    """Our cheapest run, heyoka's, the ratio of costs, the cheaper side: a row for each problem and error."""
    rows = []
    for problem, part in frame.groupby("problem", sort=False):
        for error in ERRORS:
            (own, ours), (peer, heyoka) = (least(part[part["side"] == side], error) for side in ("ours", "heyoka"))
            ratio = ours.value / heyoka.value if heyoka is not NOWHERE and ours is not NOWHERE else np.nan
            row = {"problem": problem, "error": error, "ours": own, "us, ours": ours.value, "heyoka": peer}
            rows.append(row | {"us, heyoka": heyoka.value, "ours / heyoka": ratio, "cheaper": cheaper(ours, heyoka)})
    return pd.DataFrame(rows)
