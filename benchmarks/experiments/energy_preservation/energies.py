"""Energy errors of the energy-preserving Schemes IV and V, alone and combined, and their steps without a root lambda.

Runs end at t = 1000.  In each step a scheme chooses its parameter lambda so that the energy after the step is the
initial one; not every step has such a root.  A combined scheme tries the other scheme where the first has no root.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from phasebench.benchmarks.measure import root_scan
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import Cell, ProblemKey, Rows, content
from phasebench.integrators.driver import integrate
from phasebench.integrators.families.schemes_iv_v import RADIUS
from phasebench.integrators.registry import BY_ID

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem
    from phasebench.integrators.solution import Solution

PROBLEMS = ("henon-heiles:box", "henon-heiles:chaotic", "perturbed-kepler")
SCHEMES = ("scheme-iv", "scheme-v", "scheme-iv-v", "scheme-v-iv")
LADDER = (0.2, 0.1, 0.05, 0.02, 0.01, 0.005)


def _row(found: Problem, scheme: str, h: float) -> tuple[Solution, dict]:
    """Integrate to t = 1000 with an energy-preserving scheme and, for comparison, with the implicit midpoint rule.

    Returns (the scheme's solution, a row with the energy errors of both and the number of the scheme's steps in which
    no value of its parameter lambda conserves the energy).
    """
    path = integrate(found, scheme, h=h, t_end=1000.0)
    plain = integrate(found, "implicit-midpoint", h=h, t_end=1000.0)
    system = found.system

    def energy(s: Solution) -> np.ndarray:
        H = system.observe(system.H, s.q, s.p)
        return np.abs(H - H[0])[1:]

    error = energy(path)
    rootless = np.isnan(path.parameter)
    after = np.flatnonzero(rootless[:-1] & ~rootless[1:]) + 1
    momentum = {}
    if "angular-momentum" in found.invariants:
        L = system.observe(found.invariants["angular-momentum"], path.q, path.p)
        momentum = {"angular momentum error": float(np.abs(L - L[0]).max())}
    good = path.parameter[~rootless]
    return path, {
        "problem": found.label,
        "scheme": scheme,
        "h": h,
        "status": path.status,
        "steps": path.counts["steps"],
        "without a root": int(rootless.sum()),
        "energy error, steps with a root": float(error[~rootless].max()),
        "energy error, steps without": float(error[rootless].max()) if rootless.any() else np.nan,
        "one step later": float(error[after].max()) if len(after) else np.nan,
        "implicit midpoint's energy error": float(energy(plain).max()),
        **momentum,
        "least lambda": float(good.min()),
        "greatest lambda": float(good.max()),
        "evaluations per step": path.counts["gradient"] / path.counts["steps"],
    }


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements to make (`Cell`), one for each scheme and step on each problem; none if ``quick``."""
    return [] if quick else [_cell(name, scheme, h) for name in PROBLEMS for scheme in SCHEMES for h in LADDER]


def _cell(name: str, scheme: str, h: float) -> Cell:
    plain = BY_ID["implicit-midpoint"]
    return Cell(
        "energy_preservation",
        ("energy_preservation",),
        {"problem": name, "scheme": scheme, "h": h},
        measure_rows,
        (name, scheme, h),
        content("energies", BY_ID[scheme], plain, ProblemKey(name), h, code=[__name__]),
        frozenset({name.partition(":")[0], scheme}),
    )


def measure_rows(name: str, scheme: str, h: float) -> Rows:
    """Measure an energy-preserving scheme's energy error on a problem at step h: one row, by table name.

    Steps in which the scheme found no parameter lambda that conserves the energy are scanned independently for one.
    """
    found = problem(name)
    path, row = _row(found, scheme, h)
    steps = np.flatnonzero(np.isnan(path.parameter))
    if len(steps) and scheme in root_scan.SIGNS:
        H0 = float(found.system.observe(found.system.H, path.q[:1], path.p[:1])[0])
        checked = root_scan.scan(found, scheme, path.h, path.q[steps], path.p[steps], H0)
        near = [i for i, r in zip(steps, checked.roots, strict=True) if len(r) and abs(r[0] - 0.5) < RADIUS]
        far = [r[0] for r in checked.roots if len(r)]
        row |= {
            "scanned steps": len(steps),
            "scan finds a root within the radius": len(near),
            "nearest root beyond it": min(far, key=lambda lam: abs(lam - 0.5)) if far else np.nan,
        }
    return {"energy_preservation": [{"problem": name} | {k: v for k, v in row.items() if k != "problem"}]}
