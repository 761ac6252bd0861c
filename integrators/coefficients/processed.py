r"""Coefficients of processed splittings :math:`P K P^{-1}`: a cheap kernel K, and a processor P that raises its order.

n steps are :math:`P K^n P^{-1}`: P and its inverse act only where a state is stored, and a step costs the kernel alone.
The order is that of the whole sequence, by the conditions of `order_conditions`; the kernel alone has a lower order.
The processor is, with substeps in the order in which they act,

- for a composition of a symmetric method of order 2: steps over :math:`\gamma_1, \dots, \gamma_k`, then over
  :math:`-\gamma_1, \dots, -\gamma_k`;
- for a splitting of A + eps B: a drift and a kick in turn.

A number that follows from the others is written ``*``: the fractions of a kernel add up to 1, as do its drifts and its
kicks; those of a processor add up to 0.  Polishing (`polish`) keeps these sums.

Sources: S. Blanes, Appl. Numer. Math. 37 (2001) 289-306; S. Blanes, F. Casas, A. Murua, SIAM J. Sci. Comput. 27 (2006)
1817-1843 (compositions); S. Blanes, F. Casas, J. Ros, Celest. Mech. Dyn. Astron. 77 (2000) 17-36 (near-integrable);
collected in S. Blanes, F. Casas, A. Murua, Acta Numerica 33 (2024) 1-161, tables 8.1 and 8.5.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from phasebench.integrators.compile.lazy import mpmath

from .fractions import mirror
from .table import Table

#: Stands for the number that the others determine.
IMPLIED = "*"


@dataclass(frozen=True)
class ProcessedTable(Table):
    """The coefficients of a processed method, kernel and processor, as published.

    Attributes
    ----------
    gamma, a, b, first : those of the kernel, as in `Table`; if it is a palindrome only the first half of the numbers,
        with the middle one, else all
    repeat : for each number of ``gamma``, how many steps of this length follow each other; () if always one
    processor : for a composition the fractions of its first half (its second half are the same fractions with a minus
        sign); for a splitting the weights of a drift and a kick in turn
    palindromic : True if the kernel is a palindrome
    symmetric : True if the whole sequence (processor, kernel, inverse of the processor) is a palindrome
    """

    repeat: tuple[int, ...] = ()
    processor: tuple[str, ...] = ()
    palindromic: bool = True
    symmetric: bool = False
    USED = ("kind", "order", "gamma", "repeat", "a", "b", "first", "palindromic", "processor")

    @property
    def published(self) -> tuple[str, ...]:
        """Every published number: the kernel's, then the processor's."""
        return tuple(x for x in (*self.gamma, *self.a, *self.b, *self.processor) if x != IMPLIED)

    def _parts(self, numbers: Sequence[mpmath.mpf]) -> dict[str, list[mpmath.mpf]]:
        """Divide ``numbers``, as in `published`, into "gamma", "a", "b" and "processor", and complete these."""
        left, parts = list(numbers), {}
        for part in ("gamma", "a", "b", "processor"):
            texts = getattr(self, part)
            values = [mpmath.mpf(0) if x == IMPLIED else left.pop(0) for x in texts]
            if IMPLIED in texts:
                k, times = texts.index(IMPLIED), self._times(part)
                total = 0 if part == "processor" else 1
                values[k] = (total - mpmath.fsum(n * x for n, x in zip(times, values, strict=True))) / times[k]
            parts[part] = values
        return parts

    def _times(self, part: str) -> list[int]:
        """How many times each number of a part ("gamma", "a", "b" or "processor") occurs among the substeps."""
        n = len(getattr(self, part))
        if part == "processor" or not self.palindromic:
            return [1] * n
        if part == "gamma":
            return [2 * k for k in (self.repeat or (1,) * n)[:-1]] + [1]
        middle = (len(self.a) > len(self.b)) if len(self.a) != len(self.b) else (self.first == "B")
        return [2] * (n - 1) + [1 if middle == (part == "a") else 2]

    def kernel(self, numbers: Sequence[mpmath.mpf]) -> list:
        """All substeps of the kernel, fractions or pairs (letter, weight), from numbers in the order of `published`."""
        parts = self._parts(numbers)
        if self.gamma:
            repeat = self.repeat or (1,) * len(self.gamma)
            return list(mirror([g for g, n in zip(parts["gamma"], repeat, strict=True) for _ in range(n)]))
        whole = Table(self.name, self.kind, self.order, "", (), a=self.a, b=self.b, first=self.first)
        steps = whole.steps([*parts["a"], *parts["b"]])
        return steps if self.palindromic else steps[: (len(steps) + 1) // 2]

    def pre(self, numbers: Sequence[mpmath.mpf]) -> list:
        """All substeps of the processor, likewise, in the order in which they act."""
        found = self._parts(numbers)["processor"]
        if self.gamma:
            return found + [-g for g in found]
        return [("AB"[k % 2], x) for k, x in enumerate(found)]

    def steps(self, numbers: Sequence[mpmath.mpf]) -> list:
        """All substeps of a processed step: the processor, the kernel, the processor's inverse."""
        first = self.pre(numbers)
        return first + self.kernel(numbers) + inverse(first)


def inverse(steps: Sequence) -> list:
    """The inverse of a sequence of substeps, fractions or pairs (letter, weight): reversed, with opposite signs."""
    return [(x[0], -x[1]) if isinstance(x, tuple) else -x for x in reversed(steps)]
