"""Compute some rows of the table of every method on every problem, without compilation; a script that prints JSON."""

from __future__ import annotations

import json

from phasebench.benchmarks.experiments.matrix import matrix
from phasebench.integrators.compile.codegen import precision
from phasebench.integrators.registry import method

METHODS = ("stormer-verlet", "rk4", "avf", "gauss-2", "pefrl", "cohen-hairer-1", "wisdom-holman")
PROBLEMS = ("pendulum", "kepler", "lotka-volterra", "lotka-volterra-log")

if __name__ == "__main__":
    with precision(matrix.DIGITS):
        print(json.dumps({"result": [matrix.cell(method(m), name) for name in PROBLEMS for m in METHODS]}))
