r"""Linear stability: all stable h omega of every method, confirmed by long runs and compared with known limits.

Scheme I (symplectic Euler for lambda = 0 or 1, the midpoint rule for 1/2) has a limit in closed form for every lambda:
with z = h omega the trace of the step matrix is 2 - z^2 / (1 + lambda (1 - lambda) z^2), so that the step is stable
where z |1 - 2 lambda| < 2.  The limit is measured for lambda from -10 to 11.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np

from phasebench.benchmarks.measure import oscillator
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import Cell, ProblemKey, Rows, content
from phasebench.integrators.registry import BY_ID, METHODS

from . import published

if TYPE_CHECKING:
    from phasebench.benchmarks.measure.integrator import Integrator
    from phasebench.integrators.record import Method

#: Methods of at most this order whose only parameter is lambda are measured at every lambda in `SWEPT`.
HIGHEST = 2
SWEPT = ("-10", "-2", "-1", "0", "1/3", "1/2", "2/3", "1", "2", "11")
SCHEME_I = tuple(str(Fraction(k, 2)) for k in range(-20, 23))
#: Long runs near an end of stability: relative distance from it, steps, the growth that counts as unstable.
BESIDE, STEPS, GROWTH = 1e-4, 100_000, 1e6
#: A damped run is followed until its amplitude has fallen by exp(-DAMPED).
DAMPED = 300.0
#: A gap is run only where |tr M| exceeds 2 by this: less does not grow by `GROWTH` in `STEPS` steps.
DEEP = 1e-6
#: The h omega at which a method that is stable at every step is run.
BEYOND = (7.0, 70.0)
TABLES = ("extremes_linear", "extremes_scheme_i", "extremes_published")


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`): each method and its parameters, Scheme I's limits over lambda, all known limits.

    The list is empty if ``quick``.
    """
    if quick:
        return []
    return [_sweep(), _limits_cell(), *(_cell(m.id, p) for m in METHODS for p in parameters(m) if _able(m))]


def parameters(method: Method) -> list[dict[str, str]]:
    """List the parameters at which a method's stability is measured: its defaults, and for some methods more lambdas.

    A method has more lambdas if lambda is its only parameter and its order is at most `HIGHEST`.  Each entry of the
    list is a dict name -> value.
    """
    free = set(method.parameters) == {"lam"} and method.order <= HIGHEST
    swept = [{"lam": value} for value in SWEPT] if free else []
    own = {k: str(v) for k, v in method.parameters.items()}
    return [own, *(p for p in swept if p != own)]


def _able(method: Method) -> bool:
    """True if the oscillator has all the structure that a method requires."""
    return not {"Poisson structure", "further invariants"} & {r.partition("(")[0] for r in method.requires}


def _cell(id: str, values: dict[str, str]) -> Cell:
    label = BY_ID[id](**values).label if values else id
    needs = content("linear", BY_ID[id], values, ProblemKey(oscillator.PROBLEM), code=[__name__])
    return Cell("extremes", TABLES[:1], {"label": label}, measure_rows, (id, values), needs, frozenset({id}))


def _sweep() -> Cell:
    needs = content("scheme-i", BY_ID["scheme-i"], SCHEME_I, ProblemKey(oscillator.PROBLEM), code=[__name__])
    return Cell("extremes", TABLES[1:2], {"method": "scheme-i"}, sweep, (), needs, frozenset({"scheme-i"}))


def _limits_cell() -> Cell:
    methods = [BY_ID[k.method] for k in published.LIMITS if k.method in BY_ID]
    needs = content("known", *methods, ProblemKey(oscillator.PROBLEM), code=[__name__])
    return Cell(
        "extremes", TABLES[2:], {"known": True}, measure_known_limits, (), needs, frozenset(m.id for m in methods)
    )


def measure_rows(id: str, values: dict[str, str]) -> Rows:
    """Find a method's stable intervals of h omega and confirm their ends by long runs: a row, by table name.

    The row has no results if the oscillator lacks what the method requires.
    """
    chosen = integrator(id, parameters=values)
    if chosen.lacks(problem(oscillator.PROBLEM)):
        return {TABLES[0]: [{"label": chosen.label, "method": id, "how": "not on the oscillator"}]}
    found = oscillator.find(chosen)
    gaps = [b - a for a, b in _gaps(found)]
    right, runs = confirm(chosen, found)
    row = {
        "label": chosen.label,
        "method": id,
        "family": chosen.record.family,
        "order": chosen.order,
        "symplectic": chosen.record.symplectic,
        "limit": math.inf if found.limit is None else found.limit,
        "intervals": " ".join(f"{a:.11g}..{'' if b is None else f'{b:.11g}'}" for a, b in found.intervals),
        "gaps": len(gaps),
        "narrowest gap": min(gaps, default=math.nan),
        "touches": len(found.touches),
        "first touch": found.touches[0] if found.touches else math.nan,
        "how": found.how,
        "scanned": found.scanned,
        "confirmed": right,
        "runs": runs,
        "reason": found.reason,
    }
    return {TABLES[0]: [row]}


def _gaps(found: oscillator.Found) -> list[tuple[float, float]]:
    """List the unstable intervals of h omega between stable ones."""
    return [(a[1], b[0]) for a, b in zip(found.intervals, found.intervals[1:], strict=False)]


def grows(chosen: Integrator, z: float) -> bool:
    """True if a long run at h omega = z grows beyond bounds, or cannot be made.

    The bound is relative to the size of the step matrix, since a bounded run may be as large as that.  A run of a
    damping method is shortened so that it ends before its numbers are denormal.
    """
    M = oscillator.matrix(chosen, z)
    if M is None:
        return True
    rate = -math.log(max(_radius(chosen, z), 1e-9)) if chosen.record.one_step else 0.0
    y = oscillator.end(chosen, z, STEPS if rate <= 0 else max(1, min(STEPS, int(DAMPED / rate))))
    return y is None or not np.isfinite(y).all() or bool(np.abs(y).max() > GROWTH * (1 + np.abs(M).max()))


def confirm(chosen: Integrator, found: oscillator.Found) -> tuple[int, int]:
    """Make long runs near the stability limit, within later stable intervals and within gaps.

    Returns (number of runs that end as the step matrix predicts, number of runs).
    """
    if found.how == oscillator.RUNS:
        return 0, 0
    limit = found.limit
    if found.how == oscillator.ROOTS:
        asked = [(limit * (1 - BESIDE), False), (limit * (1 + BESIDE), True)]
    elif limit is None:
        asked = [(z, False) for z in BEYOND if z < found.scanned and not _near(z, found.touches)]
    elif limit == 0:
        asked = [(linear_growth, True)] if (linear_growth := _growing(chosen)) else []
    else:
        asked = [(limit * (1 - BESIDE), False), *((z, True) for z in _beyond(chosen, found))]
        middles = [(a + b) / 2 for a, b in found.intervals[1:] if b is not None]
        asked += [(z, False) for z in middles if not _near(z, found.touches)]
        asked += [((a + b) / 2, True) for a, b in _gaps(found) if _depth(chosen, (a + b) / 2) > DEEP]
    return sum(grows(chosen, z) is expected for z, expected in asked), len(asked)


def _beyond(chosen: Integrator, found: oscillator.Found) -> list[float]:
    """Choose one h omega past the stability limit at which a long run must grow, as a list of at most one.

    It is the first of three candidates, at growing distances, at which the step matrix M makes a run grow fast enough
    to be seen, else the first; candidates not below the next stable interval do not count.  Where |tr M| - 2 grows as
    a higher power of the distance from the limit, the nearest candidate would grow too slowly.
    """
    following = found.intervals[1][0] if len(found.intervals) > 1 else math.inf
    tried = [z for k in (1, 10, 100) if (z := found.limit * (1 + k * BESIDE)) * (1 + BESIDE) < following]
    return [z for z in tried if _depth(chosen, z) > DEEP][:1] or tried[:1]


def _near(z: float, touches: Iterable[float]) -> bool:
    """True if h omega = z is so near to one of ``touches``, where |tr M| only touches 2, that round-off decides."""
    return any(abs(z - t) < 1e-6 for t in touches)


def _depth(chosen: Integrator, z: float) -> float:
    """Return (spectral radius - 1)^2 of a step matrix at h omega = z, about |tr M| - 2; 0 if no step can be taken."""
    radius = _radius(chosen, z)
    return (radius - 1) ** 2 if math.isfinite(radius) else 0.0


def _radius(chosen: Integrator, z: float) -> float:
    """Return the spectral radius of a step's matrix at h omega = z; infinite if no step can be taken."""
    M = oscillator.matrix(chosen, z)
    return math.inf if M is None else float(np.abs(np.linalg.eigvals(M)).max())


def _growing(chosen: Integrator) -> float:
    """Choose an h omega at which a long run must grow visibly, for a method that no step size makes stable.

    It is the smallest of a few values at which the step matrix says so; 0 if there is none.
    """
    return next((z for z in (0.1, 0.3, 0.5, 0.9) if _depth(chosen, z) ** 0.5 * STEPS > 2 * math.log(GROWTH)), 0.0)


def sweep() -> Rows:
    """Find Scheme I's stability limit at each lambda of `SCHEME_I`: rows with its closed form, by table name."""
    rows = []
    for value in SCHEME_I:
        found = oscillator.find(integrator("scheme-i", parameters={"lam": value}))
        slope = abs(1 - 2 * Fraction(value))
        rows.append(
            {
                "method": "scheme-i",
                "lam": float(Fraction(value)),
                "limit": math.inf if found.limit is None else found.limit,
                "closed form": float(2 / slope) if slope else math.inf,
                "intervals": len(found.intervals),
            }
        )
    return {TABLES[1]: rows}


def measure_known_limits() -> Rows:
    """Measure every known stability limit again: rows with both values, by table name."""
    rows = []
    for limit in published.LIMITS:
        chosen = integrator(published.STEPS.get(limit.method, limit.method), parameters=limit.parameters)
        found = oscillator.find(chosen)
        value = math.inf if found.limit is None else found.limit
        rows.append(
            {
                "known": True,
                "method": limit.method,
                "parameters": " ".join(f"{k}={v}" for k, v in limit.parameters.items()),
                "measured": value,
                "known limit": limit.value,
                "digits": limit.digits,
                "agrees": agrees(value, limit.value, limit.digits),
                "evidence": limit.evidence,
                "derived": limit.derived,
                "printed": limit.printed,
            }
        )
    return {TABLES[2]: rows}


def agrees(value: float, expected: float, digits: int) -> bool:
    """True if a measured limit equals a known one to ``digits`` significant digits."""
    if math.isinf(expected) or expected == 0:
        return value == expected
    return math.isfinite(value) and f"{value:.{digits - 1}e}" == f"{expected:.{digits - 1}e}"
