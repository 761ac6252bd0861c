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

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mpmath

from .fractions import DIGITS, mirror
from .polished_file import PolishedFile
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

    @property
    def published(self) -> tuple[str, ...]:
        """Every published number: the kernel's, then the processor's."""
        return tuple(x for x in (*self.gamma, *self.a, *self.b, *self.processor) if x != IMPLIED)

    @property
    def digest(self) -> str:
        """A hash of the published numbers and of the fields that say how they are used.

        Polished numbers are stored with it; they count as those of this table if it has not changed.
        """
        kernel = self.kind, self.order, self.gamma, self.repeat, self.a, self.b, self.first, self.palindromic
        return hashlib.sha256(repr((*kernel, self.processor)).encode()).hexdigest()[:16]

    def _parts(self, numbers: Sequence[mpmath.mpf]) -> dict[str, list[mpmath.mpf]]:
        """Divide ``numbers``, as in `published`, into lists for "gamma", "a", "b" and "processor", and complete these.

        A number that is not published follows from the sum over the substeps, 1 for the kernel and 0 for the processor.
        """
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
        """All substeps of the processor, fractions or pairs (letter, weight), in the order in which they act."""
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


def _composition(
    name: str, order: int, source: str, cite: str, gamma: str, processor: str, **more: Any
) -> ProcessedTable:
    fractions, half = tuple(gamma.split()), tuple(processor.split())
    return ProcessedTable(name, "composition", (order,), source, (cite,), gamma=fractions, processor=half, **more)


def _near_integrable(
    name: str, order: tuple[int, ...], first: str, a: str, b: str, drifts: str, kicks: str
) -> ProcessedTable:
    alternating = tuple(x for pair in zip(drifts.split(), kicks.split(), strict=True) for x in pair)
    source = f"Blanes, Casas & Ros 2000, processed, ({','.join(map(str, order))})"
    return ProcessedTable(
        name,
        "near-integrable",
        order,
        source,
        ("blanes-casas-ros2000",),
        a=tuple(a.split()),
        b=tuple(b.split()),
        first=first,
        processor=alternating,
    )


def _two_stages() -> ProcessedTable:
    """Make the table whose kernel has two stages; its numbers have a closed form, which polishing keeps."""
    with mpmath.workdps(DIGITS):
        root = mpmath.sqrt(1 + 2 / mpmath.sqrt(3))
        less, more = (f"{mpmath.nstr((1 + sign * root) / 2, DIGITS)}/1" for sign in (-1, 1))
    source = "Blanes, Casas & Ros 2000, processed, (6,4,3)"
    return ProcessedTable(
        "blanes-casas-ros-p2",
        "near-integrable",
        (6, 4, 3),
        source,
        ("blanes-casas-ros2000",),
        a=(less, more),
        b=(more, less),
        first="A",
        palindromic=False,
        processor=(
            *("0", "-1/2", "-0.4842296798457861", "-0.071444491827245766"),
            *("0.3104400973059574", "0.5119423407689261", "0.9112603236884162", "-0.2256471548948410"),
        ),
    )


_MURUA = "blanes-casas-murua2006"

TABLES: tuple[ProcessedTable, ...] = (
    _composition(
        "blanes-p7-6",
        6,
        "Blanes 2001, processed, order 6, kernel of 7 stages",
        "blanes2001",
        "0.513910778424374 0.364193022833858 -0.867423280969274 *",
        "* -0.461165940466494 -0.074332422810238 0.384998538774070 0.375012038697862",
    ),
    _composition(
        "blanes-casas-murua-p11-6",
        6,
        "Blanes, Casas & Murua 2006, processed, order 6, kernel of 11 stages",
        _MURUA,
        "0.1705768865009222157 -0.423366140892658048 *",
        "* -0.20621953139126 0.23651387483203 0.09086982276241 0.24687306977659 -0.1",
        repeat=(4, 1, 1),
    ),
    _composition(
        "blanes-casas-murua-p13-6",
        6,
        "Blanes, Casas & Murua 2006, processed, order 6, kernel of 13 stages",
        _MURUA,
        "0.125696288720106 0.148070660114965 -0.350856370823828 *",
        "0.1 0.225080298761176 0.191244694511161 -0.212763792194890 -0.09660157306582295 *",
        repeat=(4, 1, 1, 1),
    ),
    _composition(
        "blanes-casas-murua-p13-8",
        8,
        "Blanes, Casas & Murua 2006, processed, order 8, kernel of 13 stages",
        _MURUA,
        "0.168 0.585550530805562 -0.460090457516872 0.172863148729731 0.179664539695039 *",
        "* -0.008488123494574411 -0.337188967354338 0.333987768164597 0.588351189003849 0.162324207599241 "
        "-0.511744926116413 0.236885952363384 0.598212975943381 -0.543415765371656",
        repeat=(2, 1, 1, 1, 1, 1),
    ),
    _composition(
        "blanes-casas-murua-p23-10",
        10,
        "Blanes, Casas & Murua 2006, processed, order 10, kernel of 23 stages",
        _MURUA,
        "0.121657748919383 -0.511318780154828 -0.172858614884985 0.123016258833066 0.441503951671565 "
        "-0.327071324165477 0.070952700957766 *",
        "* 0.4727142080578221 0.01344750613191108 -0.4637104712987078 -0.3045590922565247 -0.5382945821834320 "
        "-0.1899795533199732 0.1548256472553489 -0.3594148033156072 0.3430345669677392 0.5334030283695922 "
        "0.009116042043427756",
        repeat=(5, 1, 1, 1, 1, 1, 1, 1),
        good=8,
    ),
    _two_stages(),
    _near_integrable(
        "blanes-casas-ros-p3",
        (7, 6, 4),
        "A",
        "0.5600879810924619 *",
        "1.5171479707207228 *",
        "-0.3346222298730800 1.097567990732164 -1.038088746096783 0.6234776317921379 -1.102753206303191 "
        "-0.0141183222088869",
        "-1.621810118086801 0.0061709468110142 0.8348493592472594 -0.0511253369989315 0.5633782670698199 -0.5",
    ),
    _near_integrable(
        "blanes-casas-ros-p4",
        (7, 6, 5, 4),
        "B",
        "-0.6659279171311354 *",
        "0.0962499147414666 -0.0649951074268679 *",
        "-0.5682049251492933 0.2817876004745961 0.7168960305523042 0.4332386614652446 -0.3552157340165512 "
        "-0.5825683076056897",
        "0.2005780724079215 -0.3923456667727871 -0.9517071967056039 -0.0443156930081850 0.7361124293734198 "
        "0.3776113804258454",
    ),
)
FILE = PolishedFile("phasebench.integrators.coefficients.processed", TABLES)


def kernel(name: str) -> list:
    """The substeps of the kernel of the table ``name``, to 60 digits, in units of h.

    They are fractions for a composition, or pairs (letter, weight) for a splitting, "A" for drifts and "B" for kicks.
    """
    with mpmath.workdps(DIGITS):
        return FILE.table(name).kernel(FILE.numbers(name))


def pre(name: str) -> list:
    """The substeps of the processor of the table ``name``, to 60 digits: fractions or pairs, as from `kernel`."""
    with mpmath.workdps(DIGITS):
        return FILE.table(name).pre(FILE.numbers(name))


if __name__ == "__main__":
    FILE.write()
