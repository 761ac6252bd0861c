"""Compute some rows of the table of every method on every problem, without compilation; a script that prints JSON."""

from __future__ import annotations

import json

from phasebench.benchmarks.measure import every_problem

METHODS = ("stormer-verlet", "rk4", "avf", "gauss-2", "pefrl", "cohen-hairer-1", "wisdom-holman")
PROBLEMS = ("pendulum", "kepler", "lotka-volterra", "lotka-volterra-log")

if __name__ == "__main__":
    keys = [{"method": m, "problem": name} for name in PROBLEMS for m in METHODS]
    print(json.dumps({"result": [key | every_problem.row(**key) for key in keys]}))
