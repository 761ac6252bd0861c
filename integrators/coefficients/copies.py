r"""Substep lengths of methods on two copies of the state, and the explicit Runge-Kutta method that they amount to.

With the copies (q, p) and (x, y) the substeps are A, the flow of H(q, y), and B, the flow of H(x, p), as in
`families.extended` and `families.semiexplicit`.  They alternate; in steps A B A over fractions :math:`\gamma_k` of h
the last A of a step is merged with the first of the next, so that the lengths are

.. math::
    \tfrac{\gamma_1}2,\ \gamma_1,\ \tfrac{\gamma_1 + \gamma_2}2,\ \gamma_2,\ \dots,\ \gamma_n,\ \tfrac{\gamma_n}2 .
"""

from __future__ import annotations

from collections.abc import Sequence

from phasebench.integrators.compile.lazy import mpmath

from .fractions import DIGITS


def lengths_of_a(fractions: Sequence[mpmath.mpf]) -> list[mpmath.mpf]:
    """The lengths of the substeps A, neighbours merged, of steps A B A over these fractions of h; one more."""
    with mpmath.workdps(DIGITS):
        half = [f / 2 for f in fractions]
        return [x + y for x, y in zip([0, *half], [*half, 0], strict=True)]


def midpoint_tableau(fractions: Sequence[mpmath.mpf]) -> tuple[tuple[mpmath.mpf, ...], ...]:
    """The Runge-Kutta tableau (rows of A, then b) of a method on two copies of the state that ends with their mean.

    A step begins with two equal copies.  A substep is a stage: it moves half of the variables of both copies by the
    field at the other half.  Hence a stage of A depends on the earlier ones of B, and vice versa, with their lengths as
    coefficients, and its weight in b is half of its length.
    """
    with mpmath.workdps(DIGITS):
        w = [x for pair in zip(lengths_of_a(fractions), [*fractions, 0], strict=True) for x in pair][:-1]
        rows = [[w[j] if j < i and (i - j) % 2 else mpmath.mpf(0) for j in range(len(w))] for i in range(len(w))]
        return (*map(tuple, rows), tuple(x / 2 for x in w))
