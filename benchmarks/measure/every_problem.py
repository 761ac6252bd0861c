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
from fractions import Fraction
from functools import cache

import mpmath
import numpy as np
import sympy as sp

from phasebench.benchmarks.judge.evidence import GATE
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.benchmarks.problems.base import Problem
from phasebench.integrators.compile.codegen import MULTIPRECISION, epsilon, precision, vector
from phasebench.integrators.driver import integrate
from phasebench.integrators.record import Method
from phasebench.integrators.registry import BY_ID
from phasebench.integrators.systems.hamiltonian import PartitionedSystem
from phasebench.integrators.values.kinds import Number

from . import metrics, step_map
from .multiprecision import DIGITS, MULTISTEP_LADDER, SPAN, advance, digits, flow, observed_order, retraction

#: A method is exact if its error is at most `EXACT` units of round-off plus `DOUBTS` times the reference's uncertainty.
EXACT, DOUBTS = 1e6, 10
#: Numbers of steps over `SPAN` units of time that measure an order; the divisor of the span for a second attempt.
LADDER, FINER = (1, 2, 3), 16
#: Parameters that make problems of variable size small.
SMALL = {"nls": {"N": 4}, "klein-gordon": {"N": 4}}
#: Measurements start at the state that the problem's orbit reaches after this many units of time.
LATER = 0.4
#: The step of the defects and of the energy run, in units of time; the number of steps of that run.
STEP, RUN = mpmath.mpf(1) / 40, 60
#: Systems of larger d are measured in doubles only: a step in multiprecision takes seconds.
LARGEST = 8


@cache
def build(name: str) -> Problem:
    """Make the problem ``name``, small if its size is variable."""
    return problem_of(name, **SMALL.get(name, {}))


@cache
def _at(name: str, places: int) -> tuple[PartitionedSystem, np.ndarray, mpmath.mpf]:
    """(System, state (2 d,) on its orbit `LATER` units of time after the start, unit of time), in ``places`` digits."""
    made = build(name)
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
    """The number by which each step h is divided when an order is measured: 1 for methods of fixed step.

    An "adaptive" method multiplies h by a power of the distance to the singularity: about this factor at the state y,
    array (2 d,).  One of the family "field" ends a run with a shorter step, which h / `FINER` makes one of many.
    """
    if chosen.family == "field":
        return FINER
    if chosen.family != "adaptive":
        return 1
    q, p = np.split(np.asarray(y, float)[None], 2, axis=1)
    return max(1, round(float(np.sum(system.distances(q, p) ** -3) ** -0.5)))


def _order(chosen: Method, name: str) -> dict:
    """The order over `SPAN` units of time, or fewer if it is off there; only "exact" if errors are round-off."""
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


def _symplecticity(chosen: Method, name: str) -> dict:
    system, y, unit = _at(name, mpmath.mp.dps)
    return {"symplecticity": float(step_map.pair_defect(lambda x: advance(system, chosen, x, STEP * unit), y))}


def _reversibility(chosen: Method, name: str) -> dict:
    system, y, unit = _at(name, mpmath.mp.dps)
    rho = np.array([1] * system.d + [-1] * system.d, dtype=object)
    field = system.vector_field(MULTIPRECISION)
    if max(abs(field(0, rho * y) + rho * field(0, y))) > 10.0 ** (10 - DIGITS):
        return {"reversibility_reason": "H is not even in p"}
    defect = step_map.reversibility_defect(lambda x: advance(system, chosen, x, STEP * unit), y, rho)
    return {"reversibility": float(defect)}


@cache
def _bilinear(name: str) -> tuple[sp.Expr, ...]:
    """The problem's invariants that are linear or of the form q.D p with a constant matrix D."""
    made = build(name)
    q, p = made.system.q, made.system.p

    def simple(e: sp.Expr) -> bool:
        if not e.is_polynomial(*q, *p):
            return False
        degrees = [(sum(m[: len(q)]), sum(m[len(q) :])) for m in sp.Poly(e, *q, *p).monoms()]
        return all(d in ((1, 1), (1, 0), (0, 1)) for d in degrees)

    return tuple(e for e in made.invariants.values() if simple(e))


def _in_doubles(chosen: Method, name: str) -> dict:
    """The errors of the energy and of the invariants q.D p, each over the largest size of its terms."""
    made, invariants = build(name), _bilinear(name)
    with np.errstate(all="ignore"):
        s = integrate(made, chosen.id, h=float(STEP) * made.pace.unit, steps=RUN)
    none = {} if invariants else {"quadratic_reason": "no invariant of this form"}
    if s.status != "ok":
        return {"energy_reason": s.status, "quadratic_reason": s.status} | none
    H = made.system.observe(made.system.H, s.q, s.p)
    size = float(made.system.energy()(s.q[0], s.p[0])[1])
    found = {"energy": metrics.invariant_error(H).max / size, "fallbacks": s.counts["fallbacks"]}
    worst = 0.0
    for e in invariants:
        values = made.system.observe(e, s.q, s.p)
        size = sum(np.abs(made.system.observe(t, s.q, s.p)) for t in sp.Add.make_args(e)).max()
        worst = max(worst, float(metrics.invariant_error(values).max / size) if size else 0.0)
    return found | (none or {"quadratic": worst})


#: Names -> the function that measures them; its result has a number for each, or a reason why there is none.
_MEASURES = {
    ("order",): _order,
    ("symplecticity",): _symplecticity,
    ("reversibility",): _reversibility,
    ("energy", "quadratic"): _in_doubles,
}
MEASURED = tuple(name for names in _MEASURES for name in names)


def _unmeasured(name: str, chosen: Method, system: PartitionedSystem) -> str:
    """Why a measurement is not made; "" if it is."""
    if name == "energy":
        return ""
    if system.d > LARGEST:
        return f"d > {LARGEST}: measured in doubles alone"
    if name == "order":
        return ""
    if not chosen.one_step:
        return "a step is no map of phase space"
    return "" if system.canonical else "not canonical"


def row(method: str, problem: str) -> dict:
    """Order, defects and errors of a method on a problem, or why there is none; in a process without Numba."""
    chosen = BY_ID[method]
    found = {"declared_order": chosen.order, "symplectic": chosen.symplectic, "symmetric": chosen.symmetric}
    found |= {"energy_class": chosen.energy, "quadratic_class": chosen.quadratic}
    with precision(DIGITS):
        system = _at(problem, DIGITS)[0]
    if chosen.lacks(system):
        return found | {"reason": f"requires: {next(t for t in chosen.requires if not system.traits[t])}"}
    begin = time.perf_counter()
    for names, measure in _MEASURES.items():
        why = _unmeasured(names[0], chosen, system)
        try:
            with precision(digits(chosen)):
                found |= {f"{names[0]}_reason": why} if why else measure(chosen, problem)
        except ArithmeticError as error:  # a stage that is not solved at this step is a result, not a failure
            found |= {f"{name}_reason": str(error) for name in names}
    return found | {"seconds": time.perf_counter() - begin}
