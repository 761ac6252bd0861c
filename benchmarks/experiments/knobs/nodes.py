"""The nodes of the averaged vector field's quadrature: what each of them gives the energy, and costs.

The kernel of `families.averaged` is handed one Gauss-Legendre rule of a fixed number of nodes instead of those of
rising size that it uses on an H that is no polynomial ("confirmed").  With one node it is the implicit midpoint rule.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phasebench.benchmarks.measure.quantities import scale
from phasebench.benchmarks.measure.timing import interleaved, median
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.rows.cells import ALONE, Cell, Problem, Rows, content
from phasebench.integrators.engine.codegen import DOUBLE
from phasebench.integrators.engine.kernel import Prepared, array, fixed, prepare
from phasebench.integrators.engine.solve import SOLVED
from phasebench.integrators.families.averaged import rules
from phasebench.integrators.prepared import Layout, lay_out
from phasebench.integrators.registry import method

TABLE, METHOD = "knobs_nodes", "avf"
NODES, CONFIRMED = (1, 2, 3, 4, 5, 6, 8, 10, 12), 0
STEPS, ROUNDS = 2000, 7


class Pace(NamedTuple):
    """An orbit, and the steps to take it in."""

    problem: str
    sizes: tuple[float, ...]


SCENES = (
    Pace("pendulum:swinging", (0.5, 0.1)),
    Pace("lotka-volterra-log:4-2", (0.2, 0.05)),
    Pace("perturbed-kepler", (0.1, 0.02)),
)


def cells(quick: bool = False) -> list[Cell]:
    """A cell for each orbit."""
    return [] if quick else [_cell(k) for k in range(len(SCENES))]


def _cell(k: int) -> Cell:
    scene = SCENES[k]
    needs = content("nodes", tuple(scene), NODES, STEPS, method(METHOD), Problem(scene.problem), code=[__name__])
    names = frozenset({METHOD, scene.problem.partition(":")[0]})
    return Cell("knobs", (TABLE,), {"scene": scene.problem}, measured, (k,), needs, names, ALONE, own=True)


def with_nodes(prepared: Prepared, n: int) -> Prepared:
    """The kernel with the rule of n nodes alone; as it is for `CONFIRMED`."""
    if n == CONFIRMED:
        return prepared
    lanes = len(prepared.step.like or (0.0,))
    nodes, rows, c, b = rules(Degree(2 * n), lanes, DOUBLE)
    step = prepared.step._replace(nodes=fixed(nodes), rows=fixed(rows), c=array(c, DOUBLE), b=array(b, DOUBLE))
    return Prepared(**(vars(prepared) | {"step": step}))


class Degree(NamedTuple):
    """What a polynomial H would tell of its rule: n nodes are exact to the degree 2 n."""

    polynomial_degree: int


class Run:
    """The method with n nodes at a step, from the problem's start."""

    def __init__(self, made, n: int, h: float):
        self.made = made
        self.layout: Layout = lay_out(
            with_nodes(prepare(method(METHOD), made.system), n), made.system.d, h, made.q0, made.p0
        )
        shape = (STEPS, made.system.d)
        self.Q, self.P, self.parameter = np.empty(shape), np.empty(shape), np.empty((STEPS, 1))

    def __call__(self) -> bool:
        """Fill the rows; whether every step was solved."""
        self.layout.restart(self.made.q0, self.made.p0)
        rows, status = self.layout(self.Q, self.P, self.parameter, 1)
        return rows == STEPS and status == SOLVED

    def energy_error(self) -> float:
        """The largest over all steps, in units of the sizes of H's terms."""
        start = np.array([self.made.q0]), np.array([self.made.p0])
        H = self.made.system.observe(self.made.system.H, np.vstack([start[0], self.Q]), np.vstack([start[1], self.P]))
        return float(np.abs(H - H[0]).max()) / scale(self.made)


def measured(k: int) -> Rows:
    """The rows of an orbit: a step and a number of nodes each."""
    name, sizes = SCENES[k]
    made = problem(name)
    runs = {(h, n): Run(made, n, h) for h in sizes for n in (*NODES, CONFIRMED)}
    rows = {}
    for (h, n), run in runs.items():
        solved = run()
        row = {"scene": name, "h": h, "nodes": n, "steps": STEPS, "status": "ok" if solved else "not-converged"}
        row["energy error"] = run.energy_error() if solved else None
        rows[h, n] = row | {"gradients per step": float(run.layout.counts["gradient"]) / STEPS}
    for key, seconds in interleaved(runs, ROUNDS).items():
        named = ("ns per step", "ns, low", "ns, high")
        rows[key] |= dict(zip(named, median(1e9 / STEPS * seconds), strict=True))
    return {TABLE: list(rows.values())}
