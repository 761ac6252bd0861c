"""Errors and gradient evaluations, at ever smaller steps, of symplectic methods that OrdinaryDiffEq.jl's guide names.

Only methods that this suite has, too, are run.  The guide names Henon-Heiles; the pendulum, Kepler's orbit, the
giant planets and the quadrupole boson are other separable problems of this suite.  The error is that of the state at
the end, against Gauss's method of order 16.

Source: OrdinaryDiffEq.jl, documentation of OrdinaryDiffEqSymplecticRK.
"""

from __future__ import annotations

import numpy as np

from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import Cell, ProblemKey, Rows, content
from phasebench.integrators.driver import OK, integrate
from phasebench.integrators.registry import BY_ID

TABLE = "field_says_cost"
#: This suite's methods, by their names in OrdinaryDiffEq.jl.
METHODS = {
    "symplectic-euler-q": "SymplecticEuler",
    "stormer-verlet": "VelocityVerlet",
    "mclachlan-atela-2": "McAte2",
    "ruth-3": "Ruth3",
    "mclachlan-atela-3": "McAte3",
    "forest-ruth": "CandyRoz4",
    "mclachlan-atela-4": "McAte4",
    "calvo-sanz-serna-4": "CalvoSanz4",
    "mclachlan-atela-5": "McAte5",
    "kahan-li-6": "KahanLi6",
    "kahan-li-8": "KahanLi8",
}
#: Problem -> (parameters, span, evaluations a unit of time that the ladder begins with).
SCENES = {
    "henon-heiles:box": ({}, 100.0, 4),
    "pendulum:swinging": ({}, 100.0, 4),
    "kepler": ({"e": 0.3}, 20 * np.pi, 8),
    "outer-solar-system": ({}, 20_000.0, 1 / 400),
    "quadrupole-boson": ({}, 10.0, 32),
}
RUNGS = 20


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`), one for each problem and method; none if ``quick``."""
    return [] if quick else [_cell(name, id) for name in SCENES for id in METHODS]


def _cell(name: str, id: str) -> Cell:
    values, span, least = SCENES[name]
    of = ProblemKey(name, tuple(values.items()))
    needs = content(TABLE, BY_ID[id], BY_ID["gauss-8"], of, span, least, RUNGS, code=[__name__])
    key = {"problem": name, "method": id}
    return Cell("field_says", (TABLE,), key, measure_rows, (name, id), needs, frozenset({id, name.partition(":")[0]}))


def stages(id: str) -> int:
    """Return how many gradients a step of the method ``id`` evaluates; one shared with the next step counts once."""
    s = integrate(problem("pendulum"), id, h=0.01, steps=100, save_every=0)
    return round(s.counts["gradient"] / 100)


def reference(name: str) -> tuple[np.ndarray, float]:
    """Integrate a problem to its end by Gauss's method of order 16: (the end state (q, p), its uncertainty).

    The uncertainty is the distance from the end state at half as many steps.
    """
    values, span, least = SCENES[name]
    made = problem(name, **values)
    ends = []
    for n in (1, 2):
        s = integrate(made, "gauss-8", t_end=span, steps=round(span * least * 4 * n), save_every=0)
        ends.append(np.concatenate([s.q[-1], s.p[-1]]))
    return ends[1], float(np.abs(ends[1] - ends[0]).max())


def measure_rows(name: str, id: str) -> Rows:
    """Measure a method's error at the end of runs with ever smaller steps, about sqrt(2) times shorter each time.

    ``name`` is the problem, ``id`` the method.  Returns {`TABLE`: rows}, a row for each run that reaches the end.
    """
    values, span, least = SCENES[name]
    made, (exact, uncertainty), size = problem(name, **values), reference(name), stages(id)
    rows = []
    for k in range(RUNGS):
        n = max(1, round(span * least * 2 ** (k / 2) / size))
        s = integrate(made, id, t_end=span, steps=n, save_every=0)
        if s.status != OK:
            continue
        error = float(np.abs(np.concatenate([s.q[-1], s.p[-1]]) - exact).max())
        rows.append({"steps": n, "evaluations": s.counts["gradient"], "error": error})
    head = {"problem": name, "method": id, "called": METHODS[id], "uncertainty": uncertainty}
    return {TABLE: [head | row for row in rows]}
