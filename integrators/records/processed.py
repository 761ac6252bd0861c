"""Records of processed splittings P K^n P^-1, from the tables of `coefficients`.

K is the kernel, which is repeated in n steps, P the processor, applied once before and undone after them.  The base
method of compositions is Stormer-Verlet's, kick-drift-kick.
"""

from __future__ import annotations

from collections.abc import Iterable

from phasebench.integrators.coefficients import GROUPS, polished_numbers
from phasebench.integrators.coefficients.fractions import DIGITS
from phasebench.integrators.coefficients.processed import ProcessedTable
from phasebench.integrators.compile.lazy import mpmath
from phasebench.integrators.record import SYMPLECTIC, Method

from .splittings import generalised

#: Orders where T is quadratic, [B, [B, [B, A]]] = 0, of tables whose order is lower otherwise; to the digits printed.
QUADRATIC = {"blanes-casas-ros-p2": 4, "blanes-casas-ros-p4": 6}


def letters(steps: Iterable) -> list[tuple[str, mpmath.mpf]]:
    """Substeps as pairs (letter, weight): a fraction g is a kick of g/2, a drift of g, a kick of g/2."""
    with mpmath.workdps(DIGITS):
        parts = [[x] if isinstance(x, tuple) else [("B", x / 2), ("A", x), ("B", x / 2)] for x in steps]
    return [x for part in parts for x in part]


def rows(steps: Iterable[tuple[str, mpmath.mpf]]) -> tuple[tuple[mpmath.mpf, mpmath.mpf], ...]:
    """Group pairs (letter, weight) into rows (drift, the kick after it), neighbours of the same letter merged."""
    out = []
    with mpmath.workdps(DIGITS):
        for letter, weight in steps:
            if letter == "A" and out and out[-1][1] == 0:
                out[-1][0] += weight
            elif letter == "A":
                out.append([weight, mpmath.mpf(0)])
            elif out:
                out[-1][1] += weight
            else:
                out.append([mpmath.mpf(0), weight])
    return tuple(map(tuple, out))


def weights(steps: Iterable[tuple[str, mpmath.mpf]]) -> tuple[tuple, tuple]:
    """The weights (a, b) of drifts and kicks as in `splittings.weights`, from pairs (letter, weight)."""
    drifts, kicks = zip(*rows(steps), strict=True)
    if drifts[0] == 0:
        return drifts[1:], kicks
    return drifts, (mpmath.mpf(0), *kicks)


def parts_of(table: ProcessedTable) -> tuple[list, list]:
    """The substeps of a table's kernel and of its processor, to 60 digits: fractions, or pairs (letter, weight)."""
    with mpmath.workdps(DIGITS):
        numbers = polished_numbers(table.name)
        return table.kernel(numbers), table.pre(numbers)


def _data(table: ProcessedTable) -> tuple[tuple, tuple]:
    kernel, pre = map(letters, parts_of(table))
    return weights(kernel), rows(pre)


def _record(table: ProcessedTable) -> Method:
    return Method(
        id=table.name,
        name=f"{table.source}: processed {'composition' if table.gamma else 'splitting'}{generalised(table)}",
        family="processed",
        order=QUADRATIC.get(table.name, table.classical_order),
        source=table.source,
        cite=(*table.cite, "blanes-casas-murua2024"),
        requires=("separable", *(("quadratic kinetic energy",) if table.name in QUADRATIC else ())),
        data=lambda: _data(table),
        **(SYMPLECTIC | {"symmetric": False}),
    )


METHODS: tuple[Method, ...] = tuple(map(_record, GROUPS["processed"]))
