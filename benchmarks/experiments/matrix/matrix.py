r"""Every method on every problem: order, symplecticity, reversibility, energy.

Order, symplecticity and reversibility are measured in as many digits as the method's order needs (`multiprecision`),
from a state a little later on the published orbit, since symmetry would raise the order at a turning point.

Symplecticity: :math:`|\omega(Mu, Mv) - \omega(u, v)|` for one pair of tangent vectors in general position, M the
Jacobian of a step, by central differences: four steps whatever the dimension.  Reversibility:
:math:`\rho\Phi_h\rho\Phi_h(y) - y` with :math:`\rho` the reversal of p, where H is even in p.  Energy: the greatest
:math:`|H - H_0|` over `RUN` steps in doubles, divided by the size of H's terms as the kernels compute it; likewise the
problem's invariants of the form q.D p (linear and angular momentum).

Source: Hairer, Lubich & Wanner, Geometric Numerical Integration (2006), V.1 and VI.2.
"""

from __future__ import annotations

import time
from functools import cache
from typing import TYPE_CHECKING

import mpmath
import numpy as np
import sympy as sp

from phasebench.benchmarks.measure import metrics, step_map
from phasebench.benchmarks.measure.hbvm import too_few_nodes
from phasebench.benchmarks.measure.multiprecision import (
    DIGITS,
    MULTISTEP_LADDER,
    SPAN,
    advance,
    digits,
    flow,
    observed_order,
    retraction,
)
from phasebench.benchmarks.problems import PROBLEMS, problem
from phasebench.benchmarks.store.cells import UNCOMPILED, Cell, ProblemKey, Rows, content
from phasebench.integrators.compile.codegen import MULTIPRECISION, epsilon, precision, vector
from phasebench.integrators.driver import integrate
from phasebench.integrators.record import ROUND_OFF, Method
from phasebench.integrators.registry import BY_ID, METHODS

if TYPE_CHECKING:
    from fractions import Fraction

    from phasebench.benchmarks.problems.base import Problem
    from phasebench.integrators.solution import Solution
    from phasebench.integrators.systems.hamiltonian import PartitionedSystem
    from phasebench.integrators.values.kinds import Number

#: A method is exact if its error is at most `EXACT` units of round-off plus `DOUBTS` times the reference's uncertainty.
EXACT, DOUBTS = 1e6, 10
#: Largest difference of a measured order from the declared one that counts as agreement.
GATE = 0.1
#: Numbers of steps over `SPAN` units of time that measure an order; the divisor of the span for a second attempt.
LADDER, FINER = (1, 2, 3), 16
#: Problems of which every run measures what has changed: of each kind one; the others are measured on request.
EVERY_RUN = (
    "pendulum",
    "henon-heiles",
    "perturbed-kepler",
    "lotka-volterra",
    "charged-particle",
    "spherical-pendulum",
    "rigid-body",
    "kerr",
)
#: Parameters that make problems of variable size small.
SMALL = {"nls": {"N": 4}, "klein-gordon": {"N": 4}}
#: Measurements start at the state that the problem's orbit reaches after this many units of time.
LATER = 0.4
#: The step of the defects and of the energy run, in units of time; the number of steps of that run.
STEP, RUN = mpmath.mpf(1) / 40, 60
#: Systems of larger d are measured in doubles only: a step in multiprecision takes seconds.
LARGEST = 8
#: An energy error in doubles of at most this many units of round-off counts as round-off.
UNITS_OF_ROUND_OFF = 200
#: A defect in multiprecision of at most this counts as zero: it is the error of the differences or of the solver.
NOTHING = 1e-22


@cache
def _build_problem(name: str) -> Problem:
    return problem(name, **SMALL.get(name, {}))


@cache
def _at(name: str, places: int) -> tuple[PartitionedSystem, np.ndarray, mpmath.mpf]:
    """Build the problem ``name`` and return (system, a state on its orbit, its unit of time), in multiprecision.

    The state, array (2 d,), is reached `LATER` units of time after the problem's initial state.  ``places``, the
    working digits, has no other use than to tell cached results apart.
    """
    made = _build_problem(name)
    unit = mpmath.mpf(made.pace.unit)
    start, retract = vector([*made.q0, *made.p0]), retraction(made.system)
    if retract is not None:  # doubles are off the manifold by round-off, to which projections would return them
        start = retract(start)
    y = flow(made.system, start, LATER * unit)[0]
    return made.system, y, unit


@cache
def _truth(name: str, span: Fraction, places: int) -> tuple[np.ndarray, Number]:
    system, y, unit = _at(name, places)
    return flow(system, y, span * unit)


def _parts(chosen: Method, system: PartitionedSystem, y: np.ndarray) -> int:
    """Return the number by which each step h is divided when an order is measured: 1 for methods of fixed step.

    A method of the family "adaptive" multiplies h by a power of the distance to the singularity; the number is about
    this factor at the state ``y``, array (2 d,), so that its steps are about h long.  A method of the family "field"
    ends a run with a shorter step; it takes h / `FINER`, so that this step is one of many.
    """
    if chosen.family == "field":
        return FINER
    if chosen.family != "adaptive":
        return 1
    q, p = np.split(np.asarray(y, float)[None], 2, axis=1)
    return max(1, round(float(np.sum(system.distances(q, p) ** -3) ** -0.5)))


def _order(chosen: Method, name: str) -> dict:
    """Measure a method's order on the problem ``name`` over `SPAN` units of time: columns of the table's row.

    If the order is not the declared one, it is measured again over a smaller time, since two error terms may compete.
    If the errors are no larger than round-off, the only column is ``order_reason``, "exact".
    """
    system, y, unit = _at(name, mpmath.mp.dps)
    parts = _parts(chosen, system, y)
    counts = LADDER if chosen.one_step else tuple(n * chosen.earlier for n in MULTISTEP_LADDER)
    row: dict = {}
    for span in (SPAN, SPAN / FINER):
        end, doubt = _truth(name, span, mpmath.mp.dps)
        error = [max(abs(advance(system, chosen, y, span * unit / n / parts, n * parts) - end)) for n in counts]
        if max(error) <= DOUBTS * doubt + EXACT * epsilon(MULTIPRECISION) * max(abs(end)):
            return {"order_reason": "exact"}
        found = observed_order(
            {"h": [float(span / n) for n in counts], "error": [float(e) for e in error], "doubt": float(doubt)}
        )
        row = {"order": found.value, "low": found.low, "high": found.high, "points": found.points, "h": float(span)}
        if abs(found.value - chosen.order) < GATE:
            break
    return row


#: Why a method that needs earlier states has no defects of a step.
NO_MAP = "a step is no map of phase space"


def _symplecticity(chosen: Method, name: str) -> dict:
    if not chosen.one_step:
        return {"symplecticity_reason": NO_MAP}
    system, y, unit = _at(name, mpmath.mp.dps)
    if not system.canonical:
        return {"symplecticity_reason": "not canonical"}
    return {"symplecticity": float(step_map.pair_defect(lambda x: advance(system, chosen, x, STEP * unit), y))}


def _reversibility(chosen: Method, name: str) -> dict:
    if not chosen.one_step:
        return {"reversibility_reason": NO_MAP}
    system, y, unit = _at(name, mpmath.mp.dps)
    if not system.canonical:
        return {"reversibility_reason": "not canonical"}
    d = system.d
    rho = np.array([1] * d + [-1] * d, dtype=object)
    field = system.vector_field(MULTIPRECISION)
    if max(abs(field(0, rho * y) + rho * field(0, y))) > 10.0 ** (10 - DIGITS):
        return {"reversibility_reason": "H is not even in p"}
    defect = step_map.reversibility_defect(lambda x: advance(system, chosen, x, STEP * unit), y, rho)
    return {"reversibility": float(defect)}


@cache
def _run(id: str, name: str) -> tuple[Problem, Solution]:
    made = _build_problem(name)
    with np.errstate(all="ignore"):
        return made, integrate(made, id, h=float(STEP) * made.pace.unit, steps=RUN)


def _energy(chosen: Method, name: str) -> dict:
    made, s = _run(chosen.id, name)
    if s.status != "ok":
        return {"energy_reason": s.status}
    H = made.system.observe(made.system.H, s.q, s.p)
    size = float(made.system.energy()(s.q[0], s.p[0])[1])
    return {"energy": metrics.invariant_error(H).max / size, "fallbacks": s.counts["fallbacks"]}


@cache
def _bilinear(name: str) -> tuple[str, ...]:
    """Return the names of the problem's invariants that are linear or of the form q.D p with a constant matrix D.

    ``name`` is the problem.
    """
    made = _build_problem(name)
    q, p = made.system.q, made.system.p

    def simple(e: sp.Expr) -> bool:
        if not e.is_polynomial(*q, *p):
            return False
        degrees = [(sum(m[: len(q)]), sum(m[len(q) :])) for m in sp.Poly(e, *q, *p).monoms()]
        return all(d in ((1, 1), (1, 0), (0, 1)) for d in degrees)

    return tuple(n for n, e in made.invariants.items() if simple(e))


def _quadratic(chosen: Method, name: str) -> dict:
    made, s = _run(chosen.id, name)
    if not _bilinear(name):
        return {"quadratic_reason": "no invariant of this form"}
    if s.status != "ok":
        return {"quadratic_reason": s.status}
    worst = 0.0
    for invariant in _bilinear(name):
        e = made.invariants[invariant]
        values = made.system.observe(e, s.q, s.p)
        size = sum(np.abs(made.system.observe(t, s.q, s.p)) for t in sp.Add.make_args(e)).max()
        worst = max(worst, float(metrics.invariant_error(values).max / size) if size else 0.0)
    return {"quadratic": worst}


#: Name -> the function that measures it; its result has a number or a reason why there is none.
MEASURED = {
    "order": _order,
    "symplecticity": _symplecticity,
    "reversibility": _reversibility,
    "energy": _energy,
    "quadratic": _quadratic,
}


WITHOUT_ROUND_OFF = ("order", "symplecticity", "reversibility")


def cell(chosen: Method, name: str) -> dict:
    """Measure a method on the problem ``name``: the row of the table, with order, defects and energy error.

    The defects are those of symplecticity and reversibility.  A number that is missing is replaced by the reason.
    """
    row = {"method": chosen.id, "problem": name, "declared_order": chosen.order, "symplectic": chosen.symplectic}
    row |= {"symmetric": chosen.symmetric, "energy_class": chosen.energy, "quadratic_class": chosen.quadratic}
    system = _at(name, DIGITS)[0]
    lack = chosen.lacks(system)
    if lack:
        missing = [t for t in chosen.requires if not system.traits[t]]
        return row | {"reason": f"requires: {missing[0]}"}
    begin = time.perf_counter()
    for name_of, measure in MEASURED.items():
        if name_of in WITHOUT_ROUND_OFF and system.d > LARGEST:
            row[f"{name_of}_reason"] = f"d > {LARGEST}: measured in doubles alone"
            continue
        try:
            with precision(digits(chosen)):
                row |= measure(chosen, name)
        except ArithmeticError as error:  # a stage that is not solved at this step is a result, not a failure
            row |= {f"{name_of}_reason": str(error)}
    return row | {"seconds": time.perf_counter() - begin}


def contradictions(row: dict) -> list[str]:
    """Return messages about the contradictions between a measured row and its method's declarations.

    The list is empty if there are none.  ``row`` is a row of the table, as made by `cell`.
    """
    if row.get("reason"):
        return []
    found = []
    order = row.get("order")
    if order is not None and order == order and not order > row["declared_order"] - GATE:
        found.append(f"order {order:.2f}, declared {row['declared_order']}")
    for name, declared in (("symplecticity", row["symplectic"]), ("reversibility", row["symmetric"])):
        defect = row.get(name)
        if declared and defect is not None and not defect <= NOTHING:
            found.append(f"{name} defect {defect:.1e}")
    for name, what in (("energy", "energy"), ("quadratic", "q.D p")):
        error = row.get(name)
        if row[f"{name}_class"] != ROUND_OFF or error is None:
            continue
        if not error <= UNITS_OF_ROUND_OFF * np.finfo(float).eps:
            found.append(f"{what} error {error:.1e} of its terms, declared {ROUND_OFF}")
    return found


def explanation(row: dict, contradiction: str) -> str:
    """Return the known reason for a contradiction between a row and its method's declarations; "" if none is known.

    ``row`` is a row of the table, as made by `cell`; ``contradiction`` is a message from `contradictions`.
    """
    if row["method"].endswith("-relaxation") and contradiction.startswith("order"):
        return (
            "over few steps the relaxed time's offset at the end competes with the error; from 8 steps on it does not"
        )
    if row["method"].endswith(("-adaptive", "-field")) and contradiction.startswith("order"):
        inside = row["low"] <= row["declared_order"] <= row["high"]
        return "a row is reached by a shorter step: the declared order is within the interval" if inside else ""
    if not contradiction.startswith("energy"):
        return ""
    if row.get("fallbacks"):
        return "steps without a root, which the run counts as fallbacks, do not keep the energy"
    if too_few_nodes(row["method"], _build_problem(row["problem"]).system):
        return "HBVM(k, s) keeps a polynomial H of degree at most 2k/s, and this one is none"
    return ""


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`), one for each method on each problem; none if ``quick``."""
    return [] if quick else [_cell(m, name) for name in PROBLEMS for m in METHODS]


def _cell(chosen: Method, name: str) -> Cell:
    return Cell(
        "matrix",
        ("matrix",),
        {"method": chosen.id, "problem": name},
        measure_rows,
        (chosen.id, name),
        content("matrix", chosen, ProblemKey(name, tuple(SMALL.get(name, {}).items())), code=[__name__]),
        frozenset({chosen.id, name}),
        UNCOMPILED,
        dear=name not in EVERY_RUN,
    )


def measure_rows(id: str, name: str) -> Rows:
    """Measure the method ``id`` on the problem ``name``: its row, by table name.

    This runs in a process without Numba, which compiles nothing.
    """
    with precision(DIGITS):
        return {"matrix": [cell(BY_ID[id], name)]}
