"""Implicit steps of lattices: the fixed point with full Newton behind it, and Newton's method in the narrow band.

Each lattice is taken at a step at which the fixed point contracts and at one that is too long for it, where the usual
solver takes a full matrix.  That one is timed to `FULL` degrees of freedom; its memory is told of all.
"""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np

from phasebench.benchmarks.measure.timing import in_turns, median, ratio
from phasebench.benchmarks.rows.cells import ALONE, Cell, Rows, content
from phasebench.integrators.families.banded import structure_of
from phasebench.integrators.prepared import PreparedRun, prepare
from phasebench.integrators.registry import method

from .large import _clocked, enough, held
from .systems import SYSTEMS

TABLE, METHOD, BANDED = "large_solvers", "implicit-midpoint", {"solver": "banded"}
FIXED, MATRIX = "fixed point", "full Newton"
#: Degrees of freedom; up to which the full matrix is timed; steps that are compared; rounds, and steps of one at least.
SIZES, FULL, FEW, ROUNDS, FEWEST = (32, 128, 512, 2048, 10_000), 128, 3, 7, 2


class Steps(NamedTuple):
    """A step at which the fixed point contracts, and one that is too long for it."""

    short: float
    long: float


LATTICES = {"fpu": Steps(0.01, 0.2), "toda": Steps(0.1, 3.0), "nls": Steps(0.02, 0.5)}


def cells(quick: bool = False) -> list[Cell]:
    """A cell for each lattice."""
    return [] if quick else [_cell(name) for name in LATTICES]


def _cell(name: str) -> Cell:
    used = method(METHOD), method(METHOD, **BANDED)
    needs = content(TABLE, name, LATTICES[name], SIZES, *used, code=[__name__, SYSTEMS[name].module.__name__])
    names = frozenset({"large", name, METHOD})
    return Cell("large", (TABLE,), {"system": name}, measured, (name,), needs, names, ALONE, own=True)


def measured(name: str) -> Rows:
    """The rows of a lattice: a size and a step each."""
    return {TABLE: [row(name, d, step) for d in SIZES for step in Steps._fields]}


def row(name: str, d: int, step: str) -> dict:
    """What both solvers take for a step, in turns, and how far their ends are apart."""
    problem, h = SYSTEMS[name].by_hand(d), getattr(LATTICES[name], step)
    runs = {"usual": prepare(problem, METHOD), "banded": prepare(problem, METHOD, **BANDED)}
    out = {"system": name, "d": d, "step": step, "h": h} | {f"kB, {who}": held(run) / 1e3 for who, run in runs.items()}
    if step == "long" and d > FULL:
        del runs["usual"]
    ends = {who: _tried(run, h) for who, run in runs.items()}
    for who, run in runs.items():
        out |= {f"solved, {who}": ends[who] is not None, f"evaluations, {who}": run.counts["gradient"] / FEW}
    if "usual" in runs:
        out["by"] = MATRIX if runs["usual"].counts["newton"] else FIXED
    if len(runs) == 2 and all(end is not None for end in ends.values()):
        out["apart"] = float(np.abs(ends["banded"] - ends["usual"]).max() / np.abs(ends["usual"]).max())
    return out | _timed({who: run for who, run in runs.items() if ends[who] is not None}, h) | _sought(problem)


def _tried(run: PreparedRun, h: float) -> np.ndarray | None:
    """The state after a few steps; None where they are not solved."""
    q, p, code = run(h, FEW)
    return np.concatenate([q, p]) if code == run.SOLVED else None


def _timed(runs: dict[str, PreparedRun], h: float) -> dict:
    steps = {who: max(FEWEST, enough(lambda n, run=run: _clocked(lambda: run(h, n))())) for who, run in runs.items()}
    work = {who: _clocked(lambda run=run, n=steps[who]: run(h, n)) for who, run in runs.items()}
    times = {who: seconds / steps[who] * 1e9 for who, seconds in in_turns(work, ROUNDS).items()}
    out = {}
    for who, ns in times.items():
        m = median(ns)
        out |= {f"ns, {who}": m.value, f"ns, {who}, low": m.low, f"ns, {who}, high": m.high}
    if len(times) == 2:
        r = ratio(times["banded"], times["usual"])
        out |= {"banded / usual": r.value, "banded / usual, low": r.low, "banded / usual, high": r.high}
    return out


def _sought(problem) -> dict:
    """Seconds in which the structure is found, once for a system."""
    started = time.perf_counter()
    structure_of(problem.system, 1)
    return {"s, structure": time.perf_counter() - started}
