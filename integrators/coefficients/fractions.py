r"""Step fractions of symmetric compositions that raise the order of a symmetric method; splittings as compositions.

Triple jump (Yoshida): from order k to k + 2, :math:`\gamma_1 = 1/(2 - 2^{1/(k+1)})`, :math:`\gamma_2 = 1 - 2\gamma_1`.
Suzuki's fractal: five steps, :math:`\gamma_1 = 1/(4 - 4^{1/(k+1)})`, :math:`\gamma_3 = 1 - 4\gamma_1`.

A splitting into drifts and kicks is at once a composition of the two symplectic Euler methods (`substeps`), which act
on every H, not only on separable ones, with the same order.

Sources: M. Suzuki, Phys. Lett. A 146 (1990) 319-323; H. Yoshida, Phys. Lett. A 150 (1990) 262-268; M. Z. Qin,
W. J. Zhu, Computing 47 (1991) 309-321; R. I. McLachlan, SIAM J. Sci. Comput. 16 (1995) 151-168; Hairer,
Lubich, Wanner (2006), II.4.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction

from phasebench.integrators.compile.lazy import mpmath

DIGITS = 60


def _fractal(order: int, outer: int) -> tuple[mpmath.mpf, ...]:
    if order < 2 or order % 2:
        raise ValueError(f"a symmetric composition has an even order of at least 2, not {order}")
    with mpmath.workdps(DIGITS):
        fractions = (mpmath.mpf(1),)
        for k in range(2, order, 2):
            g = 1 / (2 * outer - mpmath.root(2 * outer, k + 1))
            side = tuple(g * f for f in fractions) * outer
            fractions = side + tuple((1 - 2 * outer * g) * f for f in fractions) + side
        return fractions


def triple_jump(order: int) -> tuple[mpmath.mpf, ...]:
    """Step fractions of Yoshida's triple jump, repeated up to an even ``order``: 3**(order/2 - 1) of them."""
    return _fractal(order, 1)


def suzuki(order: int) -> tuple[mpmath.mpf, ...]:
    """Step fractions of Suzuki's fractal composition, repeated up to an even ``order``: 5**(order/2 - 1) of them."""
    return _fractal(order, 2)


def mirror(half: Sequence) -> tuple:
    """The palindrome (x_1, ..., x_m, ..., x_1) with the first half (x_1, ..., x_m), which includes the middle x_m."""
    return (*half, *reversed(half[:-1]))


def times(fraction: mpmath.mpf | Fraction, part: mpmath.mpf | Fraction | int) -> mpmath.mpf | Fraction:
    """Multiply a step fraction by another exact number, to `DIGITS` digits."""
    if isinstance(fraction, Fraction) and isinstance(part, (Fraction, int)):
        return fraction * part
    with mpmath.workdps(DIGITS):
        if isinstance(part, mpmath.mpf):
            return fraction * part
        return fraction * part.numerator / part.denominator


#: A substep shorter than this is none: the weights of the drifts and of the kicks have the same sum to round-off.
NONE = 1e-50


def substeps(steps: Iterable[tuple[str, mpmath.mpf]]) -> tuple[tuple, ...]:
    """Write alternating drifts ("A") and kicks ("B") as substeps (c, mu, lambda) of the two symplectic Euler methods.

    ``steps`` are pairs (letter, weight), a substep is as in `records.classical.one_stage`: (mu, lambda) = (1, 0) if it
    begins with a drift, (0, 1) if with a kick.  The weight of a drift or kick is shared by two neighbouring substeps,
    so that each c is a weight minus the c before it.  Raises ValueError if drifts and kicks differ in their sums.
    """
    out, c = [], mpmath.mpf(0)
    with mpmath.workdps(DIGITS):
        for letter, weight in steps:
            c = weight - c
            if abs(c) > NONE:
                out.append((c, 1, 0) if letter == "A" else (c, 0, 1))
    if abs(c) > NONE:
        raise ValueError(f"the drifts and kicks differ in their sums by {mpmath.nstr(c, 3)}")
    return tuple(out)


SCHEMES = {"yoshida": triple_jump, "suzuki": suzuki}
