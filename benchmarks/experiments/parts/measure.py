"""Splittings of H into many parts with known flows, around black holes, beside ordinary methods.

- **Accuracy**: the error of the end state against the certified one, for falling steps, with the order.
- **Energy**: the spread of the energy over `LONG` steps, and over the first tenth of them.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from phasebench.benchmarks.measure.global_error import end_error
from phasebench.benchmarks.measure.orders import successive
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.benchmarks.store.cells import Cell, ProblemKey, Rows, content, states
from phasebench.integrators.driver import integrate
from phasebench.integrators.registry import BY_ID, METHODS

ACCURACY, ENERGY = "parts_accuracy", "parts_energy"
PROBLEMS = ("kerr", "magnetized-schwarzschild:inner")
SPLIT = tuple(m.id for m in METHODS if m.family == "parts")
ORDINARY = ("rk4", "implicit-midpoint", "gauss-4")
SPAN, STEPS = 1000.0, tuple(125 * 2**k for k in range(6))
#: Errors above this many times the reference's uncertainty, and above this, are errors of the method.
ABOVE, ROUNDING = 10.0, 5e-13
#: Step and number of steps of the long runs.
H, LONG = 4.0, 1_000_000
CODE = (__name__,)


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`): accuracy and energy, for each method on each problem; none if ``quick``."""
    if quick:
        return []
    return [
        _cell(table, measure, id, name)
        for table, measure in ((ACCURACY, accuracy), (ENERGY, energy))
        for name in PROBLEMS
        for id in (*SPLIT, *ORDINARY)
        if table == ACCURACY or id != "gauss-4"
    ]


def _cell(table: str, measure: Callable, id: str, name: str) -> Cell:
    made_of = content(table, id, name, BY_ID[id], ProblemKey(name), states(name), code=CODE)
    return Cell("parts", (table,), {"method": id, "problem": name}, measure, (id, name), made_of)


def accuracy(id: str, name: str) -> Rows:
    """Measure the errors of the method ``id`` on the problem ``name``: a row for each step size, by table name.

    A row has the error of the end state, the reference's uncertainty, evaluations a step, and the observed order.
    """
    problem, rows = problem_of(name), []
    for steps in STEPS:
        s = integrate(problem, id, h=SPAN / steps, steps=steps, save_every=0)
        found = end_error(problem, s, SPAN)
        row = {"method": id, "problem": name, "split": id in SPLIT, "status": s.status, "h": SPAN / steps}
        row |= {"error": found["global_error"], "uncertainty": found["reference"]["uncertainty"]}
        rows.append(row | {"evaluations": s.counts["gradient"] / steps, "declared": BY_ID[id].order})
    floors = [max(ROUNDING, ABOVE * r["uncertainty"]) for r in rows]
    for row, order in zip(rows, successive([r["error"] for r in rows], floors), strict=True):
        row["order"] = order
    return {ACCURACY: rows}


def energy(id: str, name: str) -> Rows:
    """Measure the spread (largest less smallest value) of the energy over a long run: one row, by table name.

    It is measured over all steps (``all``) and over the first tenth of them (``first``).
    """
    s = integrate(problem_of(name), id, h=H, steps=LONG, save_every=LONG // 10_000)
    values = s.energy()
    spread = {"first": float(np.ptp(values[: len(values) // 10])), "all": float(np.ptp(values))}
    row = {"method": id, "problem": name, "split": id in SPLIT, "status": s.status, "h": H, "steps": LONG}
    return {ENERGY: [row | spread]}
