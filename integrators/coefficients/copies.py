r"""Lengths of the substeps of two copies of the state, and the explicit Runge-Kutta method that they are.

The substeps A and B of `families.extended` and `families.semiexplicit` alternate; in composed steps over fractions
:math:`\gamma_k` of h the last A of a step and the first of the next are one:

.. math::
    \tfrac{\gamma_1}2,\ \gamma_1,\ \tfrac{\gamma_1 + \gamma_2}2,\ \gamma_2,\ \dots,\ \gamma_n,\ \tfrac{\gamma_n}2 .
"""

from __future__ import annotations

from collections.abc import Sequence

import mpmath

from .fractions import DIGITS


def lengths_of_a(fractions: Sequence[mpmath.mpf]) -> list[mpmath.mpf]:
    """The lengths of the substeps A, as fractions of h, of steps A B A that are composed over these fractions of h.

    A's that meet are one: there is one more than there are steps.
    """
    with mpmath.workdps(DIGITS):
        half = [f / 2 for f in fractions]
        return [x + y for x, y in zip([0, *half], [*half, 0], strict=True)]


def midpoint_tableau(fractions: Sequence[mpmath.mpf]) -> tuple[tuple[mpmath.mpf, ...], ...]:
    """The explicit tableau, rows of A and then b, of two equal copies that take composed steps and end at their mean.

    A substep moves half of the variables of both copies, and evaluates the field at the other half.  So each stage is
    made of those before it of the other kind, with their lengths, and each has half its length for a weight.
    """
    with mpmath.workdps(DIGITS):
        w = [x for pair in zip(lengths_of_a(fractions), [*fractions, 0], strict=True) for x in pair][:-1]
        rows = [[w[j] if j < i and (i - j) % 2 else mpmath.mpf(0) for j in range(len(w))] for i in range(len(w))]
        return (*map(tuple, rows), tuple(x / 2 for x in w))
