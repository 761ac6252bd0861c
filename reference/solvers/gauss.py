r"""Gauss's method of 8 stages, order 16, in NumPy's long double: a second, independent solver for references.

It shares only the formulae with the Taylor runs: the derivatives are SymPy's, evaluated by NumPy, and every number that
a double cannot represent is passed as a long double.  In a step from y,

.. math:: k_i = f\Bigl(y + h\sum_j a_{ij} k_j\Bigr), \qquad y_1 = y + h\sum_i b_i k_i ,

the stages are iterated until they no longer change, starting from the last step's polynomial; increments are summed
with compensation, and each coefficient is a sum of two numbers.  The ends of the steps are given by the caller, for
instance those of an adaptive run.  Where the argument of an abs or sign in f changes its sign, f has a kink: a step
ends there, and each step is made with the smooth f of one side.

Source: E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration (2006), II.1.3, VIII.5 and VIII.6.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import cache, partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from . import watch
from .taylor import ReferenceFailed
from .translate import number

if TYPE_CHECKING:
    import sympy as sp

    from phasebench.integrators.systems.hamiltonian import PartitionedSystem

STAGES = 8
#: Largest number of iterations in a step.
MOST = 100
#: Components below this share of the largest one are iterated to an absolute accuracy.
FLOOR = 1e-16
#: Iterations without progress that mean round-off, provided the change is below this number of units of it.
IDLE, SETTLED = 3, 1e3
LONG = np.longdouble
EPS = np.finfo(LONG).eps


class Tableau(NamedTuple):
    """Gauss's method of s stages: A (s, s) and b (s,) as sums of two long doubles (the second is ``..._rest``).

    The nodes c (s,) and their barycentric weights are doubles.
    """

    A: np.ndarray
    A_rest: np.ndarray
    b: np.ndarray
    b_rest: np.ndarray
    c: np.ndarray
    weights: np.ndarray


@cache
def tableau() -> Tableau:
    """The coefficients of Gauss's method; rounded ones would make energy and phase drift at a constant rate."""
    import mpmath

    from phasebench.integrators.coefficients.tableaus import runge_kutta

    with mpmath.workdps(50):
        A, _, b, c = runge_kutta("gauss", STAGES)
        weights = [1 / mpmath.fprod(x - y for y in c if y != x) for x in c]
        A, A_rest = _parts(np.array(A.tolist(), dtype=object))
        b, b_rest = _parts(np.array(list(b), dtype=object))
        return Tableau(A, A_rest, b, b_rest, np.array(c, dtype=float), np.array(weights, dtype=float))


def _parts(numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Split an array of mpmath numbers into two of long doubles: (rounded numbers, remainders of the rounding)."""
    import mpmath

    def long(x: mpmath.mpf) -> np.longdouble:
        return LONG(mpmath.nstr(x, 30))

    def back(x: np.longdouble) -> mpmath.mpf:
        return mpmath.mpf(float(x)) + mpmath.mpf(float(x - LONG(float(x))))

    near = np.vectorize(long, otypes=[LONG])(numbers)
    return near, np.vectorize(lambda x, y: long(x - back(y)), otypes=[LONG])(numbers, near)


def right_hand_side(system: PartitionedSystem) -> tuple[Callable[[np.ndarray, np.ndarray], np.ndarray], int]:
    """Make the function of the equations y' = f(y) of a system for the stages of Gauss's method; return (F, kinks).

    F maps Y, a long double array (2 d, s) with the components of y = (q, p) as rows and a column for each stage, and
    the signs (kinks,) of the arguments of abs and sign in f, to an array (2 d + kinks, s): f(Y) with these signs, and
    the arguments.
    """
    import sympy as sp

    constants: dict = {}
    kinks: dict = {}

    def exact(x: sp.Expr) -> bool:
        """True if Python's double arithmetic represents this number exactly."""
        return x.is_Integer or (x.is_Rational and x.q & (x.q - 1) == 0 and abs(x.p) < 2**53 and x.q < 2**500)

    def walk(e: sp.Expr) -> sp.Expr:
        if not e.free_symbols:
            return e if exact(e) else constants.setdefault(e, sp.Symbol(f"constant_{len(constants)}"))
        if isinstance(e, (sp.Abs, sp.sign)):
            argument = walk(e.args[0])
            sign = kinks.setdefault(argument, sp.Symbol(f"sign_{len(kinks)}"))
            return sign * argument if isinstance(e, sp.Abs) else sign
        return e if e.is_Symbol else e.func(*(walk(a) for a in e.args))

    names = sp.symbols([f"x_{i}" for i in range(2 * system.d)])
    given = dict(zip((*system.q, *system.p), names, strict=True))
    sides = [walk(e.xreplace(given)) for e in system.sides]
    steps = [(symbol, walk(e.xreplace(given))) for symbol, e in system.definitions]
    sides += kinks
    values = [number(c, LONG) for c in constants]
    symbols = [*names, *constants.values(), *kinks.values()]
    f = sp.lambdify(symbols, sides, modules="numpy", cse=partial(share_subexpressions, steps))

    def F(Y: np.ndarray, signs: np.ndarray) -> np.ndarray:
        out = np.empty((len(sides), Y.shape[1]), LONG)
        for row, value in zip(out, f(*Y, *values, *signs), strict=True):
            row[:] = value
        return out

    return F, len(kinks)


def share_subexpressions(
    steps: Sequence[tuple[sp.Symbol, sp.Expr]], sides: Iterable[sp.Expr]
) -> tuple[list[tuple[sp.Symbol, sp.Expr]], list[sp.Expr]]:
    """Name common subexpressions of ``sides``: ([(symbol, expression), ...], the sides in these symbols).

    The pairs are in an order of evaluation.  ``steps`` are pairs (symbol, expression) that define symbols in ``sides``,
    a list of expressions; these definitions come back among the pairs.
    """
    import sympy as sp

    from phasebench.integrators.compile.printing import in_order_of_evaluation

    shared, found = sp.cse([*(e for _, e in steps), *sides])
    defined = zip((s for s, _ in steps), found[: len(steps)], strict=True)
    return in_order_of_evaluation([*shared, *defined]), found[len(steps) :]


def run(
    system: PartitionedSystem,
    q0: Iterable[float],
    p0: Iterable[float],
    marks: Iterable[float],
    times: Iterable[float],
    disturb: Callable[[np.ndarray], np.ndarray] = lambda y: y,
) -> np.ndarray:
    """Integrate with given steps; return the states at ``times``, an array (n, 2 d) of long doubles.

    Parameters
    ----------
    system : a partitioned system
    q0, p0 : arrays (d,), the initial state
    marks : increasing times > 0, the ends of the steps
    times : increasing times > 0, which become ends of steps too
    disturb : a map (2 d,) -> (2 d,) that is applied to the state at the start and after each step

    Raises
    ------
    ReferenceFailed
        If a step's stages have no solution; the message has its time.
    """
    rule, d = tableau(), len(system.sides)
    F, kinks = right_hand_side(system)
    wanted = {float(t) for t in times}
    ends = sorted(wanted | {float(t) for t in marks if 0 < t < max(wanted)})
    y = disturb(np.array([LONG(float(x)) for x in (*q0, *p0)]))
    lost = np.zeros_like(y)
    t, K, before = LONG(0.0), None, 0.0
    signs, turned = np.ones(kinks, LONG), set()

    def slopes(Y: np.ndarray) -> np.ndarray:
        return F(Y, signs)[:d]

    def arguments(x: np.ndarray) -> np.ndarray:
        return F(x[:, None], signs)[d:, 0]

    def step(h: np.longdouble) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        first = (
            np.repeat(slopes(y[:, None]), STAGES, axis=1) if K is None else K @ _extrapolation(rule, float(h / before))
        )
        own = _stages(slopes, y, h, first, rule, float(t))
        increment = h * (own @ rule.b) + (h * (own @ rule.b_rest) + lost)
        new = y + increment
        return new, increment - (new - y), own

    for _ in range(kinks):  # an argument may have an abs in it
        signs = np.sign(arguments(y))
    rows = []
    for end in ends:
        for _ in range(MOST):
            h = LONG(end) - t
            new, rest, own = step(h)
            kink, beyond = None, arguments(new) if kinks else ()
            over = [k for k in range(kinks) if k not in turned and np.sign(beyond[k]) != signs[k]]
            if over:
                here = arguments(y) * signs
                if stays := [k for k in over if here[k] <= 0]:  # on a kink, which it leaves on the other side
                    signs[stays] = np.sign(beyond[stays])
                    turned.update(stays)
                    continue
                found = [(_root(lambda x, k=k: arguments(step(x)[0])[k] * signs[k], here[k], h), k) for k in over]
                h, kink = min(found)
                new, rest, own = step(h)
            y, lost, K, before = new, rest, own, h
            t = LONG(end) if kink is None else t + h
            turned.clear()
            if kink is not None:
                K, signs[kink] = None, -signs[kink]
            if t >= end:
                break
        else:
            raise ReferenceFailed(f"the orbit stays on a kink of H at t = {float(t):.6g}")
        watch.report_time("run of Gauss's method", end, ends[-1])
        if end in wanted:
            rows.append(y.copy())
        y = disturb(y)
    return np.array(rows)


def _root(f: Callable[[np.longdouble], np.longdouble], at_0: np.longdouble, h: np.longdouble) -> np.longdouble:
    """The zero of f in (0, h), f(0) = at_0 > 0 >= f(h), by the Illinois method, to a few units in the last place."""
    a, b, fa, fb, again = LONG(0.0), h, at_0, f(h), 0
    for _ in range(MOST):
        if b - a <= 4 * EPS * b or fb == 0:
            break
        x = b - fb * (b - a) / (fb - fa)
        x = x if a < x < b else (a + b) / 2
        fx = f(x)
        if fx > 0:
            a, fa, fb, again = x, fx, fb / 2 if again > 0 else fb, 1
        else:
            b, fb, fa, again = x, fx, fa / 2 if again < 0 else fa, -1
    return b


def _extrapolation(rule: Tableau, ratio: float) -> np.ndarray:
    """The matrix (s, s) that extrapolates the slopes of a step's stages to the next step, ``ratio`` times as long."""
    # Farther away than twice the step the polynomial is a useless starting value.
    at = 1 + min(ratio, 2.0) * rule.c
    L = rule.weights[:, None] / (at[None, :] - rule.c[:, None])
    return (L / L.sum(axis=0)).astype(LONG)


def _stages(
    F: Callable[[np.ndarray], np.ndarray], y: np.ndarray, h: np.longdouble, K: np.ndarray, rule: Tableau, t: float
) -> np.ndarray:
    """Solve a step's equations for the slopes K of the stages, array (2 d, s), by fixed-point iteration.

    ``F`` is the right-hand side, y the state, h the step; ``K`` is the starting value.  The iteration ends where the
    change is round-off or no longer falls; raises ReferenceFailed, with the time ``t``, if it is large then.
    """
    size = EPS * (np.abs(y) + np.abs(h) * np.abs(K).max(axis=1)) / 4
    best, kept, idle = np.inf, K, 0
    with np.errstate(all="ignore"):
        for _ in range(MOST):
            new = F(y[:, None] + h * (K @ rule.A.T + K @ rule.A_rest.T))
            change = np.abs(h) * np.abs(new - K).max(axis=1)
            K, worst = new, float((change / np.maximum(size, FLOOR * size.max())).max())
            if not np.isfinite(worst) or worst <= 1:
                break
            best, kept, idle = (worst, K, 0) if worst < best else (best, kept, idle + 1)
            if idle == IDLE:
                K = kept
                break
    if not change.max() <= SETTLED * size.max():
        raise ReferenceFailed(f"the Gauss method's stages have no solution after t = {t:.6g}; its steps are too large")
    return K
