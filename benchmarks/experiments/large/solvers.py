"""Implicit steps of lattices: the usual solver (fixed-point iteration, then Newton's method) and banded Newton.

Each lattice is integrated with a step at which the fixed-point iteration contracts, and with one too long for it, where
the usual solver needs Newton's method with a full matrix.  Full matrices are timed up to `FULL` degrees of freedom;
their memory is given for all sizes.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from phasebench.benchmarks.measure.timing import in_turns, median, ratio
from phasebench.benchmarks.store.cells import ALONE, Cell, Rows, content
from phasebench.integrators.families.banded import structure_of
from phasebench.integrators.prepared import PreparedRun, prepare
from phasebench.integrators.registry import method

from .large import _clock, array_bytes, enough
from .systems import SYSTEMS

if TYPE_CHECKING:
    from types import SimpleNamespace

TABLE, METHOD, BANDED = "large_solvers", "implicit-midpoint", {"solver": "banded"}
FIXED, MATRIX = "fixed point", "full Newton"
#: Degrees of freedom; the largest at which full matrices are timed; steps compared; rounds; the least steps of one.
SIZES, FULL, FEW, ROUNDS, FEWEST = (32, 128, 512, 2048, 10_000), 128, 3, 7, 2


class Steps(NamedTuple):
    """Step sizes of a lattice: ``short``, at which fixed-point iteration contracts, and ``long``, too long for it."""

    short: float
    long: float


LATTICES = {"fpu": Steps(0.01, 0.2), "toda": Steps(0.1, 3.0), "nls": Steps(0.02, 0.5)}


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`), one for each lattice; none if ``quick``."""
    return [] if quick else [_cell(name) for name in LATTICES]


def _cell(name: str) -> Cell:
    used = method(METHOD), method(METHOD, **BANDED)
    needs = content(TABLE, name, LATTICES[name], SIZES, *used, code=[__name__, SYSTEMS[name].module.__name__])
    names = frozenset({"large", name, METHOD})
    return Cell("large", (TABLE,), {"system": name}, measure_rows, (name,), needs, names, ALONE, own=True)


def measure_rows(name: str) -> Rows:
    """Compare the solvers of implicit steps on the lattice ``name``: rows by table name.

    There is a row for each number of degrees of freedom and each of the two step sizes.
    """
    return {TABLE: [row(name, d, step) for d in SIZES for step in Steps._fields]}


def row(name: str, d: int, step: str) -> dict:
    """Measure both solvers on a lattice of d degrees of freedom at one step size, and return the row of the table.

    ``step`` is "short" or "long", a field of `Steps`.  The row has times from alternating rounds, evaluations a step,
    memory, and the relative distance of the two end states.
    """
    problem, h = SYSTEMS[name].by_hand(d), getattr(LATTICES[name], step)
    runs = {"usual": prepare(problem, METHOD), "banded": prepare(problem, METHOD, parameters=BANDED)}
    out = {"system": name, "d": d, "step": step, "h": h} | {
        f"kB, {who}": array_bytes(run) / 1e3 for who, run in runs.items()
    }
    if step == "long" and d > FULL:
        del runs["usual"]
    ends = {who: _trial_state(run, h) for who, run in runs.items()}
    for who, run in runs.items():
        out |= {f"solved, {who}": ends[who] is not None, f"evaluations, {who}": run.counts["gradient"] / FEW}
    if "usual" in runs:
        out["by"] = MATRIX if runs["usual"].counts["newton"] else FIXED
    if len(runs) == 2 and all(end is not None for end in ends.values()):
        out["apart"] = float(np.abs(ends["banded"] - ends["usual"]).max() / np.abs(ends["usual"]).max())
    return out | _time_columns({who: run for who, run in runs.items() if ends[who] is not None}, h) | _sought(problem)


def _trial_state(run: PreparedRun, h: float) -> np.ndarray | None:
    """Return the state (2 d,) after a few steps of size h; None if the equations of a step could not be solved."""
    q, p, code = run(h, FEW)
    return np.concatenate([q, p]) if code == run.SOLVED else None


def _time_columns(runs: dict[str, PreparedRun], h: float) -> dict:
    """Time the solvers (name -> prepared run) at step size h in alternating rounds, and return columns of a row.

    The columns are the nanoseconds of a step of each, with interval, and the ratio banded / usual if both are timed.
    """
    steps = {who: max(FEWEST, enough(lambda n, run=run: _clock(lambda: run(h, n))())) for who, run in runs.items()}
    work = {who: _clock(lambda run=run, n=steps[who]: run(h, n)) for who, run in runs.items()}
    times = {who: seconds / steps[who] * 1e9 for who, seconds in in_turns(work, ROUNDS).items()}
    out = {}
    for who, ns in times.items():
        m = median(ns)
        out |= {f"ns, {who}": m.value, f"ns, {who}, low": m.low, f"ns, {who}, high": m.high}
    if len(times) == 2:
        r = ratio(times["banded"], times["usual"])
        out |= {"banded / usual": r.value, "banded / usual, low": r.low, "banded / usual, high": r.high}
    return out


def _sought(problem: SimpleNamespace) -> dict:
    """Time the search for the banded structure of a problem's equations: a dict {"s, structure": seconds}.

    A system needs this search only once, before its first run.
    """
    started = time.perf_counter()
    structure_of(problem.system, 1)
    return {"s, structure": time.perf_counter() - started}
