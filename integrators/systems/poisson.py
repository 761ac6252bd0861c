r"""Poisson systems :math:`\dot y = B(y)\nabla H(y)`, y = (q, p), with a skew matrix B that fulfils the Jacobi identity

.. math::
    \sum_{l}\Bigl(\frac{\partial B_{ij}}{\partial y_l} B_{lk} + \frac{\partial B_{jk}}{\partial y_l} B_{li}
    + \frac{\partial B_{ki}}{\partial y_l} B_{lj}\Bigr) = 0 \quad\text{for all } i, j, k .

Functions C with :math:`B\nabla C = 0` are Casimirs: the flow of every H conserves them.  A map y_0 -> y_1 is a Poisson
map if its Jacobian M satisfies :math:`M B(y_0) M^T = B(y_1)`; the exact flow is a Poisson map.

Source: E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration (2006), VII.2, (2.8)-(2.10), and VII.4.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import TYPE_CHECKING, Any

from numba import types

from phasebench.integrators.compile import codegen
from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.compile.lazy import sympy as sp
from phasebench.integrators.errors import InvalidInput

from .hamiltonian import PartitionedSystem, _symbols, read

if TYPE_CHECKING:
    from phasebench.integrators.values.kinds import Function

    from .hamiltonian import Formula, Names


def jacobi_defects(B: sp.Matrix, y: Sequence[sp.Symbol]) -> list[sp.Expr]:
    """The left-hand sides of the Jacobi identity for i < j < k, simplified: all zero where B is a Poisson structure."""

    def term(i: int, j: int, k: int) -> sp.Expr:
        return sum(sp.diff(B[i, j], y[m]) * B[m, k] for m in range(len(y)))

    return [sp.simplify(term(i, j, k) + term(j, k, i) + term(k, i, j)) for i, j, k in combinations(range(len(y)), 3)]


class PoissonSystem(PartitionedSystem):
    """The system y' = B(y) grad H(y), y = (q, p).

    Parameters
    ----------
    q, p : sequences of symbols or names, of equal length d
    B : matrix of shape (2 d, 2 d) of expressions or formulae, the structure matrix
    H : expression or formula
    dq, dp : sequences of d expressions or formulae, optional
        The components of B grad H in the form in which they are to be evaluated.
    singular, invariants : as in `PartitionedSystem`; Casimirs are invariants

    Raises
    ------
    InvalidInput
        If B has another shape or is not skew, or dq, dp are not B grad H.  The Jacobi identity is not checked here:
        see `jacobi_defects`.
    """

    poisson = True

    def __init__(
        self,
        *,
        q: Names,
        p: Names,
        B: sp.Matrix | Sequence[Sequence[Any]],
        H: Formula,
        dq: Sequence[Formula] | None = None,
        dp: Sequence[Formula] | None = None,
        singular: Sequence[Formula] = (),
        invariants: Sequence[Formula] = (),
    ) -> None:
        q, p = _symbols(q), _symbols(p)
        y, d = (*q, *p), len(q)
        known = {str(s): s for s in y}
        if not isinstance(B, sp.MatrixBase):
            B = sp.Matrix([[read(x, known) for x in row] for row in B])
        if B.shape != (2 * d, 2 * d):
            raise InvalidInput(f"B has shape {B.shape}; for d = {d} it is {(2 * d, 2 * d)}")
        if any(sp.simplify(B[i, j] + B[j, i]) != 0 for i in range(2 * d) for j in range(i + 1)):
            raise InvalidInput("B is not skew")
        H = read(H, known)
        flow = B * sp.Matrix([sp.diff(H, x) for x in y])
        given = [read(e, known) for e in (*(flow[:d] if dq is None else dq), *(flow[d:] if dp is None else dp))]
        if any(sp.simplify(a - b) != 0 for a, b in zip(flow, given, strict=True)):
            raise InvalidInput("dq, dp are not B grad H")
        super().__init__(q=q, p=p, dq=given[:d], dp=given[d:], energy=H, singular=singular, invariants=invariants)
        self.B = B

    def gradient(self, arithmetic: str = DOUBLE) -> Function:
        """Make the function (q, p, h, lam) -> (H_q, H_p) of tuples or arrays (d,); it ignores h and lam.

        It has these arguments so that it can replace a vector field that depends on a step h and a parameter lambda.
        """

        def results() -> list[list[sp.Expr]]:
            return [[sp.diff(self.H, x) for x in part] for part in (self.q, self.p)]

        return self.field_like("gradient", results, arithmetic)

    def structure(self, arithmetic: str = DOUBLE) -> Function:
        """Make the function (q, p, a, b) -> the two halves of B(q, p) (a, b), the structure matrix times a vector."""
        T, d = codegen.value_type(self.d), self.d
        a, b = (sp.symbols([f"{n}{i}_" for i in range(d)]) for n in ("a", "b"))

        def results() -> list[list[sp.Expr]]:
            product = self.B * sp.Matrix([*a, *b])
            return [product[:d], product[d:]]

        arguments = [("q", self.q), ("p", self.p), ("a", a), ("b", b)]
        kind = f"structure {sp.srepr(self.B)}"
        return self.make_function(kind, arguments, results, types.Tuple((T, T))(T, T, T, T), arithmetic)
