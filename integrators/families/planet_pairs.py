"""Recognize potentials that are sums of inverse distances of bodies; prepare the kernel of `planet_lanes` for them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from phasebench.integrators.coefficients.tableaus import LEVELS
from phasebench.integrators.compile import codegen
from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.compile.lazy import sympy as sp
from phasebench.integrators.stepping.kernel import Prepared, array

from .planet_lanes import ROWS, SPACE, Planets, run

if TYPE_CHECKING:
    from phasebench.integrators.families.wisdom_holman import KeplerPart
    from phasebench.integrators.systems.hamiltonian import Hamiltonian

#: Least number of bodies for which lanes are faster, and the largest one for which tables are made.
FEWEST, MOST = 3, 16


def distances(potential: sp.Expr, q: Sequence[sp.Symbol]) -> list[tuple[sp.Expr, list]] | None:
    """Write a potential as sum_a -w_a / |sum_j c_aj q_j|: returns the pairs (w_a, c_a), or None if it is no such sum.

    q are the coordinates, three for each body; q_j is the position of body j, and c_a has a number for each body.
    """
    found = [_distance(term, q) for term in sp.Add.make_args(potential)]
    return None if None in found else found


def _distance(term: sp.Expr, q: Sequence[sp.Symbol]) -> tuple[sp.Expr, list] | None:
    factor, power = term.as_independent(*q)
    if not (power.is_Pow and power.exp == -sp.S.Half and power.base.is_polynomial(*q)):
        return None
    square, axis = sp.Poly(power.base, *q), q[::SPACE]
    leading = next((x for x in axis if square.coeff_monomial(x**2) != 0), None)
    if leading is None:
        return None
    root = sp.sqrt(square.coeff_monomial(leading**2))
    row = [root if x == leading else square.coeff_monomial(x * leading) / (2 * root) for x in axis]
    vector = [sum(c * x for c, x in zip(row, q[i::SPACE], strict=True)) for i in range(SPACE)]
    same = sp.Poly(sum(x**2 for x in vector), *q) == square
    return (-factor, row) if same else None


def lanes_of(bodies: int) -> int:
    """Number of SIMD lanes that holds the given number of bodies: a power of two, at least 4."""
    return max(4, 1 << (bodies - 1).bit_length())


def _pad(row: Sequence | sp.Matrix, lanes: int, filler: int = 0) -> list:
    return [*row, *[filler] * (lanes - len(row))]


def _of_pairs(found: list[tuple[sp.Expr, list]], back: sp.Matrix, lanes: int) -> list[list]:
    """The rows ``pairs`` of `planet_lanes.Planets`, with a pair of bodies in each SIMD lane.

    For each pair they have the coefficients of the vector between its bodies, and the weight of its inverse distance.
    ``found`` is the list of pairs (w_a, c_a) that `distances` returns, ``back`` the matrix of q = back Q.
    """
    rows, n = [], back.rows
    for first in range(0, len(found), lanes):
        block = found[first : first + lanes]
        M = sp.Matrix([c for _, c in block]) * back
        rows += [_pad(M.col(k), lanes) for k in range(n)]
        rows += [_pad([0] * len(block), lanes, 1), _pad([w for w, _ in block], lanes)]
        rows += [_pad(M.row(a) if a < len(block) else [], lanes) for a in range(lanes)]
    return rows


def _of_bodies(part: KeplerPart, lanes: int) -> list[list]:
    """The rows ``parts`` of `planet_lanes.Planets`: a number for each body, padded to SIMD lanes.

    They are mu, the mass, its inverse as the sum of two doubles, m mu, and 1 if the motion is free.
    """
    inverse = [1 / sp.Rational(m) for m in part.masses]
    high = [codegen.to_number(x, DOUBLE) for x in inverse]
    low = [x - sp.Rational(y) for x, y in zip(inverse, high, strict=True)]
    return [
        _pad(part.mu, lanes),
        _pad(part.masses, lanes, 1),
        _pad(high, lanes),
        _pad(low, lanes),
        _pad([m * mu for m, mu in zip(part.masses, part.mu, strict=True)], lanes),
        _pad([int(mu == 0) for mu in part.mu], lanes, 1),
    ]


def prepare(part: KeplerPart, system: Hamiltonian, tables: dict) -> Prepared | None:
    """Prepare the kernel (compiled loop over steps) with bodies in SIMD lanes; None if the system does not allow it.

    ``part`` is the `KeplerPart` of the system.  ``tables`` are the fields substeps, corrector and series of `Planets`,
    by name.
    """
    n = len(part.masses)
    if not codegen.compiled() or part.dimension != SPACE or not FEWEST <= n <= MOST:
        return None
    if not all(sp.sympify(m).is_Rational for m in part.masses):
        return None
    found = distances(system.potential, system.q)
    if found is None:
        return None
    lanes, change = lanes_of(n), part.matrix
    back = change.inv()
    maps = [back.T, change.T, back, change]
    step = Planets(
        **tables,
        like=(0.0,) * lanes,
        bodies=(0.0,) * n,
        maps=array([_pad(M.row(k), lanes) for M in maps for k in range(n)], DOUBLE),
        parts=array(_of_bodies(part, lanes), DOUBLE),
        pairs=array(_of_pairs(found, back, lanes), DOUBLE),
    )
    return Prepared(run, step, max(lanes, system.d), -(-ROWS // (3 * LEVELS + 1)), implicit=False)
