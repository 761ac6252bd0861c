"""Energy error and cost of the averaged vector field method (AVF) over the number of nodes of its quadrature.

The kernel of `families.averaged` gets one Gauss-Legendre rule with a fixed number of nodes.  If H is not a polynomial,
the method by itself increases the number until the integral is confirmed (`CONFIRMED`).  One node is the implicit
midpoint rule.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from phasebench.benchmarks.measure.quantities import scale
from phasebench.benchmarks.measure.timing import median, time_in_turns
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import ALONE, Cell, ProblemKey, Rows, content
from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.families.averaged import rules
from phasebench.integrators.prepared import Layout, lay_out
from phasebench.integrators.registry import method
from phasebench.integrators.stepping.codes import SOLVED
from phasebench.integrators.stepping.kernel import Prepared, array, freeze, prepare

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem

TABLE, METHOD = "knobs_nodes", "avf"
NODES, CONFIRMED = (1, 2, 3, 4, 5, 6, 8, 10, 12), 0
STEPS, ROUNDS = 2000, 7


class Pace(NamedTuple):
    """A problem with its orbit (``problem``), and the step sizes to integrate it with (``sizes``)."""

    problem: str
    sizes: tuple[float, ...]


SCENES = (
    Pace("pendulum:swinging", (0.5, 0.1)),
    Pace("lotka-volterra-log:4-2", (0.2, 0.05)),
    Pace("perturbed-kepler", (0.1, 0.02)),
)


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`), one for each orbit; none if ``quick``."""
    return [] if quick else [_cell(k) for k in range(len(SCENES))]


def _cell(k: int) -> Cell:
    scene = SCENES[k]
    needs = content("nodes", tuple(scene), NODES, STEPS, method(METHOD), ProblemKey(scene.problem), code=[__name__])
    names = frozenset({METHOD, scene.problem.partition(":")[0]})
    return Cell("options", (TABLE,), {"scene": scene.problem}, measure_rows, (k,), needs, names, ALONE, own=True)


def with_nodes(prepared: Prepared, n: int) -> Prepared:
    """Restrict a prepared kernel of the averaged vector field method to the quadrature rule with n nodes.

    If n is `CONFIRMED`, with which the method itself chooses the number of nodes, the kernel is returned unchanged.
    """
    if n == CONFIRMED:
        return prepared
    lanes = len(prepared.step.like or (0.0,))
    nodes, rows, c, b = rules(Degree(2 * n), lanes, DOUBLE)
    step = prepared.step._replace(nodes=freeze(nodes), rows=freeze(rows), c=array(c, DOUBLE), b=array(b, DOUBLE))
    return Prepared(**(vars(prepared) | {"step": step}))


class Degree(NamedTuple):
    """Stands in for a system as the argument of `rules`, which reads nothing of it but the degree of its H.

    With ``polynomial_degree`` = 2 n, `rules` chooses the quadrature rule of n nodes.
    """

    polynomial_degree: int


class Run:
    """A run of the averaged vector field method with n quadrature nodes and step h on the problem ``made``.

    Calling it takes `STEPS` steps from the problem's initial state, and writes the state after each into a row of its
    arrays Q and P, (`STEPS`, d).
    """

    def __init__(self, made: Problem, n: int, h: float) -> None:
        self.made = made
        self.layout: Layout = lay_out(
            with_nodes(prepare(method(METHOD), made.system), n), made.system.d, h, made.q0, made.p0
        )
        shape = (STEPS, made.system.d)
        self.Q, self.P, self.parameter = np.empty(shape), np.empty(shape), np.empty((STEPS, 1))

    def __call__(self) -> bool:
        """Integrate into the rows Q, P; return True if every step was solved."""
        self.layout.restart(self.made.q0, self.made.p0)
        rows, status = self.layout(self.Q, self.P, self.parameter, 1)
        return rows == STEPS and status == SOLVED

    def energy_error(self) -> float:
        """Return the largest energy error over all steps, divided by the size of H's terms."""
        start = np.array([self.made.q0]), np.array([self.made.p0])
        H = self.made.system.observe(self.made.system.H, np.vstack([start[0], self.Q]), np.vstack([start[1], self.P]))
        return float(np.abs(H - H[0]).max()) / scale(self.made)


def measure_rows(k: int) -> Rows:
    """Measure energy error and cost of the averaged vector field method on the orbit ``SCENES[k]``.

    Returns a row for each step and number of nodes, by table name.
    """
    name, sizes = SCENES[k]
    made = problem(name)
    runs = {(h, n): Run(made, n, h) for h in sizes for n in (*NODES, CONFIRMED)}
    rows = {}
    for (h, n), run in runs.items():
        solved = run()
        row = {"scene": name, "h": h, "nodes": n, "steps": STEPS, "status": "ok" if solved else "not-converged"}
        row["energy error"] = run.energy_error() if solved else None
        rows[h, n] = row | {"gradients per step": float(run.layout.counts["gradient"]) / STEPS}
    for key, seconds in time_in_turns(runs, ROUNDS).items():
        named = ("ns per step", "ns, low", "ns, high")
        rows[key] |= dict(zip(named, median(1e9 / STEPS * seconds), strict=True))
    return {TABLE: list(rows.values())}
