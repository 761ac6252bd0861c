"""Find where a Hamiltonian is singular, as distances: expressions that vanish at its singularities.

Singularities come from negative powers, logarithms and poles of tangents.  The distance of 1/sqrt(x**2 + y**2), written
in any way, is r = sqrt(x**2 + y**2); that of 1/(q - 1)**2 and of log(q - 1) is q - 1.  If the base of a power is a sum
of squares and a positive number, as in 1/sqrt(r**2 + 0.01), the distance is *softened*: it cannot vanish, so that
nothing collides, but variable steps have to follow it as they follow r.

Whether a quadratic base vanishes is decided exactly, by completing squares.  Any other base is searched for zeros
numerically, from seeded random points; one without a zero gives a softened distance if it is a polynomial, and else no
distance at all, since it is regular (2 + cos(q), cosh(q)).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from phasebench.integrators.compile.lazy import sympy as sp

if TYPE_CHECKING:
    from .hamiltonian import PartitionedSystem

#: Half-widths of the boxes in which zeros of a base are searched, the points in each, and the share of the typical size
#: of the base below which a value counts as zero.
BOXES, POINTS, ZERO = (0.3, 1.0, 4.0, 16.0), 200, 1e-9
#: No distances are searched for if a base has more operations than this: fractions within fractions take minutes.
LONGEST = 30
#: A polynomial of a higher degree in more variables than these is not factorized.
FACTORIZED = 4


class Distances(NamedTuple):
    """Distances to the singularities of a Hamiltonian, as expressions in the coordinates.

    Attributes
    ----------
    singular : expressions that vanish at a singularity, such as r of 1/r
    softened : expressions that cannot vanish, such as sqrt(r^2 + eps^2) of a softened potential
    """

    singular: tuple[sp.Expr, ...]
    softened: tuple[sp.Expr, ...]


def find(H: sp.Expr, coordinates: Sequence[sp.Symbol], momenta: Sequence[sp.Symbol]) -> Distances:
    """Find the distances to the singularities of H in the coordinates.

    The bases of negative powers in H are searched for zeros, as are the arguments of logarithms and the cosines of the
    arguments of tangents; all are called bases here.  Those that contain momenta are left out.  If a base has more
    operations than `LONGEST`, no distances are returned at all.
    """
    found: dict[bool, dict[sp.Expr, None]] = {True: {}, False: {}}
    bases = list(dict.fromkeys(_bases(H, {*coordinates}, {*momenta})))
    if any(map(_too_long, bases)):
        return Distances((), ())
    for factor in dict.fromkeys(f for base in bases for f in _factors(base)):
        variables = sorted(factor.free_symbols, key=str)
        distance, vanishes = _distance(factor, variables)
        if distance is not None:
            found[vanishes][distance] = None
    return Distances(*(tuple(sorted(found[kind], key=sp.default_sort_key)) for kind in (True, False)))


def unsearched(system: PartitionedSystem) -> bool:
    """True if H may have singularities that were not searched for, since its formula is too complicated.

    That is so if a base, an expression that has a negative power or is inside a logarithm or tangent, has more
    operations than `LONGEST`.
    """
    if not system.canonical or system.loops or steering_distances(system):
        return False
    return any(map(_too_long, _bases(system.H, {*system.q}, {*system.p})))


def _too_long(base: sp.Expr) -> bool:
    return sp.count_ops(base) > LONGEST


def steering_distances(system: PartitionedSystem) -> tuple:
    """The distances by which variable steps are chosen: those that vanish at singularities and softened ones."""
    return (*system.singular, *system.softened)


def size(distance: sp.Expr) -> sp.Expr:
    """The absolute value of a distance, which may have a sign, as q - 1 has."""
    return distance if distance.is_nonnegative else sp.Abs(distance)


def is_wall(system: PartitionedSystem, distance: sp.Expr) -> bool:
    """True if the distance has a sign, as q - 1 has, and H = T(p) + V(q) with a quadratic T: a wall that orbits hit."""
    return not distance.is_nonnegative and system.quadratic_kinetic


def density(system: PartitionedSystem) -> tuple[sp.Expr, sp.Expr]:
    r"""Return two expressions: :math:`1/\sigma^2 = \sum_k w_k` and its time derivative along the motion.

    Variable steps are chosen proportional to :math:`\sigma`.  Of a distance :math:`r` is :math:`w = |r|^{-3}`, as on a
    Kepler orbit; of a wall (`is_wall`), at which orbits arrive with any speed,
    :math:`w = \sqrt{r^{-6} + (\ddot r / r)^2} + (\dot r / r)^2`.
    """

    def rate(e: sp.Expr) -> sp.Expr:
        flow = zip((*system.q, *system.p), (*system.dq, *system.dp), strict=True)
        return sp.Add(*(sp.diff(e, x) * v for x, v in flow))

    terms, rates = [], []
    for r in steering_distances(system):
        term = size(r) ** -3
        if is_wall(system, r):
            term = sp.sqrt(r**-6 + (rate(rate(r)) / r) ** 2) + (rate(r) / r) ** 2
        terms.append(term)
        rates.append(rate(term) if is_wall(system, r) else -3 * term * rate(r) / r)
    return sp.Add(*terms), sp.Add(*rates)


# -- where a formula may be singular -----------------------------------------------------------------------------------


def _bases(H: sp.Expr, coordinates: set, momenta: set) -> Iterator[sp.Expr]:
    """Yield the expressions, of coordinates alone, whose zeros are singularities of H."""
    for e in sp.preorder_traversal(H):
        if isinstance(e, sp.Pow) and e.exp.is_number and e.exp.is_negative:
            base = e.base
        elif isinstance(e, sp.log):
            base = e.args[0]
        elif isinstance(e, sp.tan):
            base = sp.cos(e.args[0])
        else:
            continue
        if base.free_symbols & coordinates and not base.free_symbols & momenta:
            yield base


def _factors(base: sp.Expr) -> Iterator[sp.Expr]:
    """Yield the factors of an expression, without the powers to which they are raised."""
    exact = base.replace(lambda e: e.is_Float, lambda e: sp.Rational(float(e)))
    numerator = sp.fraction(sp.together(exact))[0]
    for f in sp.Mul.make_args(numerator):
        inner = f.as_base_exp()[0] if not isinstance(f, sp.exp) else sp.Integer(1)
        if not inner.free_symbols:
            continue
        if inner != numerator:
            yield from _factors(inner)
        elif inner.is_polynomial() and (len(inner.free_symbols) <= FACTORIZED or sp.Poly(inner).total_degree() <= 2):
            yield from (g for g, _ in sp.factor_list(inner)[1])
        else:
            yield inner


# -- the distance of a factor ------------------------------------------------------------------------------------------


def _distance(F: sp.Expr, variables: Sequence[sp.Symbol]) -> tuple[sp.Expr | None, bool]:
    """Find the distance to the zeros of F, a factor of an expression whose zeros are singularities of H.

    Returns (distance, True if it vanishes somewhere).  The distance is an expression such as r for F = r^2, which near
    the zeros of F is about proportional to the length from them.  If F has no zeros, it is a softened distance, which
    cannot vanish, or None if F is not a polynomial.  ``variables`` are the symbols in F.
    """
    if F.is_polynomial():
        polynomial = sp.Poly(F, *variables)
        degree = polynomial.total_degree()
        if degree == 1:
            return sp.expand(F / max(map(abs, polynomial.coeffs()[: len(variables)]))), True
        if degree == 2:
            return _of_quadratic(polynomial, variables)
        sign = _sign(F, variables)
        return (F, True) if sign == 0 else (sp.root(abs(sign) // sign * F, degree), abs(sign) == 1)
    if F.is_positive or F.is_negative:
        return None, False
    sign = _sign(F, variables)
    if sign == 0:
        return F, True
    return (sp.sqrt(sign * F), True) if abs(sign) == 1 else (None, False)


def _of_quadratic(polynomial: sp.Poly, variables: Sequence[sp.Symbol]) -> tuple[sp.Expr, bool]:
    F = polynomial.as_expr()
    for sign in (1, -1):
        squares, least = _squares(sign * F, variables)
        if least is None or least < 0:
            continue
        largest = max(abs(polynomial.coeff_monomial(x**2)) for x in variables)
        return sp.sqrt(sp.Add(*(a / largest * x**2 for a, x in squares), least / largest)), least == 0
    return F, True


def _squares(F: sp.Expr, variables: Sequence[sp.Symbol]) -> tuple[list[tuple], sp.Rational | None]:
    """Complete squares in a quadratic polynomial F: F is the sum of a x^2 over pairs (a, x), plus its least value.

    Returns ([(a, x), ...], least value); each x is linear in the variables.  The least value is None if F is not
    bounded below.  It is exact, so that one near zero loses no digits.
    """
    squares = []
    for x in variables:
        a, b = (F.coeff(x, n) for n in (2, 1))
        if a.is_negative or (a == 0 and b != 0):
            return [], None
        if a != 0:
            squares.append((a, x + sp.expand(b / (2 * a))))
            F = sp.expand(F - a * x**2 - b * x - b**2 / (4 * a))
    return squares, F


def _sign(F: sp.Expr, variables: Sequence[sp.Symbol]) -> int:
    """Search an expression F for zeros numerically; return a number that tells whether F vanishes.

    It is 0 if F changes its sign (or is finite nowhere), +-1 if F touches zero without changing its sign, and +-2 if
    no zero is found; the sign is that of F.
    """
    from scipy.optimize import minimize

    f = sp.lambdify(variables, F, "numpy")
    rng = np.random.default_rng(0)
    points = np.concatenate([box * rng.uniform(-1, 1, (POINTS, len(variables))) for box in BOXES])
    with np.errstate(all="ignore"):
        values = np.broadcast_to(np.asarray(f(*points.T), float), len(points))
        good = np.isfinite(values)
        if not good.any() or (values[good].min() < 0 < values[good].max()):
            return 0
        sign = 1 if values[good].max() > 0 else -1
        least = min(
            minimize(
                lambda x: np.nan_to_num(sign * f(*x), nan=1e300, posinf=1e300),
                start,
                method="Nelder-Mead",
                options={"xatol": 1e-12, "fatol": 1e-14, "maxiter": 4000},
            ).fun
            for start in points[good][np.argsort(np.abs(values[good]))[:4]]
        )
    if least < -ZERO * np.median(np.abs(values[good])):
        return 0
    return sign * (1 if least < ZERO * np.median(np.abs(values[good])) else 2)
