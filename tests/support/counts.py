"""Compare the counts that a run reports with the calls of the system's functions: ``python counts.py`` prints JSON.

Run with NUMBA_DISABLE_JIT=1: calls of a compiled function cannot be counted.
"""

from __future__ import annotations

import copy
import json
from collections import Counter
from dataclasses import replace
from fractions import Fraction
from unittest.mock import patch

import numpy as np
import sympy as sp

from phasebench.benchmarks.measure.battery import BY_TRAIT, LOW_ORDER, SYSTEMS, by_label, runs_on, variants
from phasebench.integrators.driver import integrate
from phasebench.integrators.families import gauss_lanes
from phasebench.integrators.prepared import lay_out
from phasebench.integrators.stepping.kernel import prepare
from phasebench.integrators.systems.poisson import PoissonSystem
from support import stiff
from support.one_of_each import kinds

H, STEPS = 0.02, 3
NAMES = ("henon-heiles", "coupled", "perturbed-kepler")
#: Systems per method; a separable and a non-separable one suffice.
FEW = 2
#: Runs with so long steps that fixed-point iteration fails.
LONG = ("stiff", "body", "lanes")
#: The counts of a solution that are compared.
TOLD = ("gradient", "steps", "newton", "fallbacks", "iterations")
#: Functions of constraints.
CONSTRAINTS = ("restore", "normal", "multipliers", "transposed slopes", "mobility")
#: Prefixes of functions that do not count as gradient or field evaluations.
OTHERS = ("structure", "energy", "grad_T", "constraint", "velocity", "rate", "density", "A / m", *CONSTRAINTS)


def systems(m) -> list[str]:
    """Return the names of the systems on which the calls of the method m are counted."""
    names = BY_TRAIT.get(m.requires[0], NAMES) if m.requires else NAMES
    return [name for name in names if runs_on(m, name)][:FEW]


METHODS = [m for m in variants(lam=(Fraction(1, 3),), order=(1, 2)) if m.order <= LOW_ORDER and systems(m)]
ALL = kinds(METHODS) | by_label([m for m in METHODS if m.label in stiff.METHODS])
LANED = [x for x, m in ALL.items() if m.data[:1] == ("gauss",) and gauss_lanes.serves(m.data[1], stiff.SYSTEM)]


def watch(system, calls: Counter):
    """Return a copy of the system whose functions (gradient, field, ...) count their calls, by kind, in ``calls``."""
    other, kind_of_system = copy.copy(system), type(system)
    other._functions = {}

    def made(kind, *rest):
        function = kind_of_system.make_function(other, kind, *rest)

        def called(*arguments):
            calls[kind] += 1
            return function(*arguments)

        return called

    other.make_function = made
    return other


def body() -> PoissonSystem:
    """Return a Poisson system: a rigid body y' = y x grad H with a quartic term, and a constant fourth variable."""
    x, y, z, rest = sp.symbols("x y z rest", real=True)
    B = [[0, -z, y, 0], [z, 0, -x, 0], [-y, x, 0, 0], [0, 0, 0, 0]]
    return PoissonSystem(q=[x, y], p=[z, rest], B=B, H=x**2 / 2 + y**2 / 3 + z**2 / 5 + x**4 / 20 + y * z / 4)


def runs(label: str) -> dict:
    """{name of the run: (system, step h, initial (q, p))}; steps of those in `LONG` are solved by Newton's method."""
    found = {}
    for name in systems(ALL[label]):
        system, *start = SYSTEMS[name]()
        found[name] = system, H, start
    found |= {"stiff": (stiff.SYSTEM, stiff.H, stiff.START)} if label in stiff.METHODS else {}
    return found | ({"body": (body(), 3.0, ((0.8, -0.5), (0.6, 1.0)))} if ALL[label].family == "poisson" else {})


def of(label: str) -> dict:
    """{name of the run: counts} of the method with this label.

    Counts are those that the solution reports, "called" those of the system's functions, and "kernel" those of the
    kernel when it is called directly.  Stages share SIMD lanes only in the run "lanes" of Gauss methods.
    """
    found = {}
    for name, (system, h, (q, p)) in runs(label).items():
        calls: Counter = Counter()
        with patch.object(gauss_lanes, "FEWEST", 99):
            s = integrate(watch(system, calls), ALL[label], h=h, steps=STEPS, q0=q, p0=p, save_every=2)
            kernel = kernel_counts(prepare(ALL[label], system), system.d, float(h), q, p)
        found[name] = {key: s.counts[key] for key in TOLD}
        found[name]["called"] = sum(n for kind, n in calls.items() if not kind.startswith(OTHERS))
        found[name]["kernel"] = kernel
    return found | ({"lanes": in_lanes(label)} if label in LANED else {})


def in_lanes(label: str) -> dict:
    """Count the evaluations of a Gauss method whose stages share SIMD lanes, on steps that Newton's method solves."""
    prepared, calls = prepare(ALL[label], stiff.SYSTEM), []
    f, stages = prepared.step.f, prepared.step.stages

    def called(memory):
        calls.append(stages)
        f(memory)

    watched = replace(prepared, step=prepared.step._replace(f=called))
    kernel = kernel_counts(watched, 2, float(stiff.H), *stiff.START)
    return kernel | {"called": sum(calls), "kernel": kernel}


def kernel_counts(prepared, d: int, h: float, q, p) -> dict:
    """The counts of a kernel that is called for two steps, then for the rest of `STEPS`, by the names in `TOLD`."""
    run = lay_out(prepared, d, h, q, p)
    for every in (2, STEPS - 2):
        run(np.zeros((1, d)), np.zeros((1, d)), np.zeros((1, 1)), every)
    tally = prepared.tally(*(int(run.counts[name]) for name in ("steps", "gradient", "fallbacks", "newton")))
    return {key: tally[key] for key in TOLD}


if __name__ == "__main__":
    print(json.dumps({"result": {label: of(label) for label in ALL}}))
