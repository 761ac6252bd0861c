"""Energy error and cost of the averaged vector field method (AVF) over the number of nodes of its quadrature.

The kernel of `families.averaged` gets one Gauss-Legendre rule with a fixed number of nodes.  If H is not a polynomial,
the method by itself increases the number until the integral is confirmed (`CONFIRMED`).  One node is the implicit
midpoint rule.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from phasebench.benchmarks.measure.quantities import scale
from phasebench.benchmarks.measure.timing import median, time_in_turns
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.benchmarks.problems.base import Problem
from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.families.averaged import rules
from phasebench.integrators.prepared import lay_out
from phasebench.integrators.registry import BY_ID
from phasebench.integrators.stepping.codes import SOLVED
from phasebench.integrators.stepping.kernel import Prepared, array, freeze, prepare

TABLE, METHOD = "knobs_nodes", "avf"
NODES, CONFIRMED = (1, 2, 3, 4, 5, 6, 8, 10, 12), 0
STEPS, ROUNDS = 2000, 7
#: Orbit -> steps.
SCENES = {
    "pendulum:swinging": (0.5, 0.1),
    "lotka-volterra-log:4-2": (0.2, 0.05),
    "perturbed-kepler": (0.1, 0.02),
}


def with_nodes(prepared: Prepared, n: int) -> Prepared:
    """A prepared kernel of AVF with the rule of n nodes alone; unchanged if n is `CONFIRMED`."""
    if n == CONFIRMED:
        return prepared
    degree = SimpleNamespace(polynomial_degree=2 * n)  # all that the choice of a rule reads of a system
    nodes, rows, c, b = rules(degree, len(prepared.step.like or (0.0,)), DOUBLE)
    step = prepared.step._replace(nodes=freeze(nodes), rows=freeze(rows), c=array(c, DOUBLE), b=array(b, DOUBLE))
    return Prepared(**(vars(prepared) | {"step": step}))


class Run:
    """AVF with n nodes and the step h: each call writes the states after `STEPS` steps into the rows of Q and P."""

    def __init__(self, made: Problem, n: int, h: float) -> None:
        kernel = with_nodes(prepare(BY_ID[METHOD], made.system), n)
        self.made, self.layout = made, lay_out(kernel, made.system.d, h, made.q0, made.p0)
        self.Q, self.P, self.parameter = (np.empty((STEPS, n)) for n in (made.system.d, made.system.d, 1))

    def __call__(self) -> bool:
        """True if every step was solved."""
        self.layout.restart(self.made.q0, self.made.p0)
        rows, status = self.layout(self.Q, self.P, self.parameter, 1)
        return rows == STEPS and status == SOLVED

    def energy_error(self) -> float:
        """The largest energy error, divided by the size of H's terms."""
        states = np.vstack([self.made.q0, self.Q]), np.vstack([self.made.p0, self.P])
        H = self.made.system.observe(self.made.system.H, *states)
        return float(np.abs(H - H[0]).max()) / scale(self.made)


def nodes(scene: str) -> list[dict]:
    """Energy error and cost: a row for each step and number of nodes."""
    made = problem_of(scene)
    runs = {(h, n): Run(made, n, h) for h in SCENES[scene] for n in (*NODES, CONFIRMED)}
    rows = {}
    for (h, n), run in runs.items():
        solved = run()
        row = {"h": h, "nodes": n, "steps": STEPS, "status": "ok" if solved else "not-converged"}
        row["energy error"] = run.energy_error() if solved else None
        rows[h, n] = row | {"gradients per step": float(run.layout.counts["gradient"]) / STEPS}
    for key, seconds in time_in_turns(runs, ROUNDS).items():
        rows[key] |= dict(zip(("ns per step", "ns, low", "ns, high"), median(1e9 / STEPS * seconds), strict=True))
    return list(rows.values())
