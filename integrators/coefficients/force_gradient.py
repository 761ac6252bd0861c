r"""Splittings with modified kicks, :math:`e^{b h B + c h^3 C}` with :math:`C = [B, [A, B]]`.

A is the drift by T(p), B the kick by V(q).  Where T is quadratic C is a kick,
:math:`p \leftarrow p + c h^3\,\nabla(\nabla V\cdot M^{-1}\nabla V)`.  A step is a product of drifts and modified kicks,
a series over words of A and B modulo :math:`[B, [B, [B, A]]] = 0`, as that of a Nystrom splitting (`order_conditions`);
its order is the degree up to which it equals :math:`e^{A + B}`.

Sources: M. Takahashi, M. Imada, J. Phys. Soc. Jpn. 53 (1984) 3765-3769; S. A. Chin, Phys. Lett. A 226 (1997) 344-348;
S. A. Chin, C. R. Chen, J. Chem. Phys. 117 (2002) 1409-1415; I. P. Omelyan, I. M. Mryglod, R. Folk, Phys. Rev. E 66
(2002) 026701 and Comput. Phys. Commun. 151 (2003) 272-314; J. Laskar, P. Robutel, Celest. Mech. Dyn. Astron. 80 (2001)
39-62 (correctors); K. Schaefers et al., arXiv:2403.10370 (Hessian-free).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import TYPE_CHECKING, TypeAlias

from phasebench.integrators.compile.lazy import mpmath

from .fractions import mirror
from .table import Table

if TYPE_CHECKING:
    import numpy as np

#: A drift ("A", a, 0) or a modified kick ("B", b, c).
Substep: TypeAlias = "tuple[str, mpmath.mpf, mpmath.mpf]"


@dataclass(frozen=True)
class ForceGradientTable(Table):
    """A symmetric splitting into drifts exp(a h A) and modified kicks exp(b h B + c h^3 C), as published.

    Attributes
    ----------
    a, b, ... : as in `Table`: a are the coefficients of the drifts, b those of the kicks
    c : coefficients of the force gradient C = [B, [A, B]], as text, one for each number of ``b``
    hessian_free : True if the kick is approximated by two evaluations of the force, without the Hessian
    """

    c: tuple[str, ...] = ()
    hessian_free: bool = False
    USED = ("order", "a", "b", "c", "first", "hessian_free")

    @property
    def published(self) -> tuple[str, ...]:
        """Every published number as text: a, b, and then c."""
        return self.a + self.b + self.c

    def steps(self, numbers: Sequence[mpmath.mpf]) -> list[Substep]:
        """All substeps, drifts ("A", a, 0) and modified kicks ("B", b, c), from numbers in the order of `published`."""
        n, m = len(self.a), len(self.a) + len(self.b)
        drifts = [("A", a, mpmath.mpf(0)) for a in numbers[:n]]
        kicks = [("B", b, c) for b, c in zip(numbers[n:m], numbers[m:], strict=True)]
        rows = zip_longest(drifts, kicks) if self.first == "A" else zip_longest(kicks, drifts)
        return list(mirror([x for row in rows for x in row if x is not None]))

    def residual(self, numbers: Sequence[mpmath.mpf]) -> np.ndarray:
        r"""The residuals of the order conditions at ``numbers``: those of odd degree, since the step is symmetric.

        A kick without the Hessian differs from the modified one by :math:`2 c^2 h^5 / b\,V'''(M^{-1}\nabla V,
        M^{-1}\nabla V)` and terms of degree 7, so that order 6 needs the sum of :math:`c^2 / b` to vanish, too.
        """
        import numpy as np

        from .order_conditions import modified_residuals

        steps = self.steps(numbers)
        found = np.concatenate(modified_residuals(steps, self.order[0] - 1)[1::2])
        if not self.hessian_free or self.order[0] < 6:
            return found
        return np.append(found, mpmath.fsum(c * c / b for letter, b, c in steps if letter == "B"))

    def excess(self, numbers: Sequence[mpmath.mpf]) -> mpmath.mpf:
        """The largest residual at ``numbers``, in absolute value."""
        return max(map(abs, self.residual(numbers)))
