"""Run implicit methods with steps too long for fixed-point iteration: ``python stiff.py`` prints JSON.

Newton's method solves the equations.

H = (p1^2 + p2^2)/2 + 200 q1^2 + q2^2/2 + q1^2 q2^2/2 + q1^4/4 with h = 0.3, which is 6 over the largest frequency.
"""

from __future__ import annotations

import json
from fractions import Fraction

import numpy as np

from phasebench.benchmarks.measure.battery import LOW_ORDER, by_label, variants
from phasebench.integrators import Hamiltonian
from phasebench.integrators.compile.codegen import MULTIPRECISION, precision
from phasebench.integrators.driver import integrate
from phasebench.integrators.families import parametric

H, STEPS = Fraction(3, 10), 2
ENERGY = "(u**2 + v**2)/2 + 200*x**2 + y**2/2 + x**2*y**2/2 + x**4/4"
SYSTEM, BACK = (Hamiltonian(q="x y", p="u v", H=f"{sign}({ENERGY})") for sign in ("", "-"))
START = ([0.5, 1.0], [1.0, -0.5])
#: Families whose stages Newton's method solves, without two slow ones.
FAMILIES = {"parametric", "collocation", "variational", "averaged", "discrete_gradient", "poisson"}


def _explicit(m) -> bool:
    """Return whether a step of the method m solves no equations on a separable system."""
    return m.family == "parametric" and parametric.is_splitting(m)


def _methods() -> dict:
    """Select one implicit method for each combination of family, symmetry, order and requirements, by label."""
    found: dict = {}
    for m in variants(lam=(Fraction(1, 3),), order=(2,)):
        if m.order <= LOW_ORDER and m.family in FAMILIES and not _explicit(m) and m.lacks(SYSTEM) is None:
            found.setdefault((m.family, m.symmetric, m.symplectic, m.requires, m.order, "order" in m.parameters), m)
    return by_label(list(found.values()))


METHODS = _methods()


def solve(system, m, start, **options):
    """Integrate a system by the method m over `STEPS` steps `H` from ``start`` = (q, p); return the solution."""
    return integrate(system, m, h=H, steps=STEPS, q0=start[0], p0=start[1], **options)


def of(label: str) -> dict:
    """Run the method with this label on the stiff system: forwards, back again with -H, and in multiprecision.

    Returns a dict: "steps" and "newton", counts of steps and Newton solves of the three runs; "back", the distance from
    the start after the way back; "apart", the difference from multiprecision; "energy", the range of the energy.
    """
    m = METHODS[label]
    there = solve(SYSTEM, m, START)
    home = solve(BACK, m, (there.q[-1], there.p[-1]))
    with precision(40):
        exact = solve(SYSTEM, m, START, arithmetic=MULTIPRECISION)
        apart = [*map(float, (*(exact.q[-1] - there.q[-1]), *(exact.p[-1] - there.p[-1])))]
    return {
        "steps": [x.counts["steps"] for x in (there, home, exact)],
        "newton": [x.counts["newton"] for x in (there, home, exact)],
        "back": float(np.abs(np.array([home.q[-1], home.p[-1]]) - START).max()),
        "apart": float(np.abs(apart).max()),
        "energy": float(np.ptp(SYSTEM.energies(there.q, there.p))),
    }


if __name__ == "__main__":
    print(json.dumps({"result": {label: of(label) for label in METHODS}}))
