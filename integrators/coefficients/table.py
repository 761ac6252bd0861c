"""The record of a published table of coefficients, and the sequence of substeps that it defines."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from phasebench.integrators.compile.lazy import mpmath

from .fractions import DIGITS, mirror

if TYPE_CHECKING:
    import numpy as np

#: A decimal of more digits is a rounded number, which may be polished; a shorter one, or a fraction, is a choice.
EXACT_DIGITS = 6


@dataclass(frozen=True)
class Table:
    """The coefficients of a symmetric composition or of a splitting, as published.

    Attributes
    ----------
    name : kebab-case
    kind : how its order is computed, one of `order_conditions.KINDS`
    order : ``(p,)``, or the generalised order of a near-integrable splitting
    source, cite : author, year, equation or table; keys of the bibliography
    gamma : fractions of a composition, the first half with the middle one
    a, b : weights of the drifts and the kicks of a splitting: the first half with the middle one where it is
        symmetric, else all; decimal strings or fractions
    first : the letter of its first substep, "A" (drift) or "B" (kick)
    symmetric : whether the halves are mirrored
    good : the number of decimals that are correct, if some that were printed are not; else None
    printed : True if its numbers solve no order conditions, and are used as printed
    """

    name: str
    kind: str
    order: tuple[int, ...]
    source: str
    cite: tuple[str, ...]
    gamma: tuple[str, ...] = ()
    a: tuple[str, ...] = ()
    b: tuple[str, ...] = ()
    first: str = "B"
    symmetric: bool = True
    good: int | None = None
    printed: bool = False
    #: The fields that determine the numbers.
    USED: ClassVar[tuple[str, ...]] = ("kind", "order", "gamma", "a", "b", "first", "symmetric")

    @property
    def published(self) -> tuple[str, ...]:
        """Every published number as text: gamma, or a and then b."""
        return self.gamma + self.a + self.b

    @property
    def digest(self) -> str:
        """A hash of the published numbers and of how they are used; polished numbers count while it is the same."""
        used = tuple(getattr(self, name) for name in self.USED)
        return hashlib.sha256(repr(used).encode()).hexdigest()[:16]

    @property
    def classical_order(self) -> int:
        """The order for a system without a small parameter."""
        return self.order[-1]

    @property
    def accuracy(self) -> mpmath.mpf:
        """How far a published number may lie from the polished one, if it is only rounded and not misprinted.

        It is 10^-``good`` if that is given, else ten units of the last digit of the shortest number.
        """
        if self.good is not None:
            return mpmath.mpf(10) ** -self.good
        return 10 * max((unit(x) for x in self.published if not is_exact(x)), default=mpmath.mpf(10) ** -DIGITS)

    def steps(self, numbers: Sequence[mpmath.mpf]) -> list:
        """All substeps, from numbers in the order of `published`: fractions, or pairs (letter, weight)."""
        if self.gamma:
            return list(mirror(numbers))
        parts = {"A": list(numbers[: len(self.a)]), "B": list(numbers[len(self.a) :])}
        letter, out = self.first, []
        while parts[letter]:
            out.append((letter, parts[letter].pop(0)))
            letter = "B" if letter == "A" else "A"
        if parts[letter]:
            raise ValueError(f"the drifts and kicks of {self.name} do not alternate")
        return list(mirror(out)) if self.symmetric else out

    def residual(self, numbers: Sequence[mpmath.mpf]) -> np.ndarray:
        """The residuals of the order conditions at ``numbers``; of a symmetric method those of odd degree."""
        import numpy as np

        from . import order_conditions

        degrees = tuple(p - (self.symmetric and p % 2 == 0) for p in self.order)
        errors = order_conditions.residuals(self.kind, self.steps(numbers), degrees)
        keys = [key for key in order_conditions.conditions(errors, self.order) if key[0] % 2 or not self.symmetric]
        return np.concatenate([errors[key] for key in keys])

    def excess(self, numbers: Sequence[mpmath.mpf]) -> mpmath.mpf:
        """The largest residual of the order conditions at ``numbers``, in absolute value."""
        from . import order_conditions

        return order_conditions.excess(
            order_conditions.residuals(self.kind, self.steps(numbers), self.order), self.order
        )


def is_exact(text: str) -> bool:
    """True if a published number is a fraction or has few digits: a choice, which polishing leaves as it is."""
    return "/" in text or len(text.partition(".")[2].rstrip("0")) <= EXACT_DIGITS


def value(text: str) -> mpmath.mpf:
    """The number that a published text (decimal or fraction) stands for, in full precision."""
    numerator, _, denominator = text.partition("/")
    with mpmath.workdps(DIGITS):
        return mpmath.mpf(numerator) / mpmath.mpf(denominator or 1)


def unit(text: str) -> mpmath.mpf:
    """One unit of the last printed digit of a published decimal: 0.01 for "0.25"."""
    with mpmath.workdps(DIGITS):
        return mpmath.mpf(10) ** -len(text.partition(".")[2])
