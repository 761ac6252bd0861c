"""Measurements without round-off on a system of each kind, for a process with NUMBA_DISABLE_JIT=1: prints JSON.

``python exact.py NAME ...`` measures names of `multiprecision.MEASUREMENTS`.  A kernel does one thing on a separable H
and another on one that is not: every method is measured on both, but of compositions of high order that differ in their
fractions alone only the shortest.  `pytest benchmarks` measures every method on every system (the page of orders).
"""

from __future__ import annotations

import json
import sys

from phasebench.benchmarks.measure import multiprecision
from phasebench.benchmarks.measure.battery import LOW_ORDER, NON_SEPARABLE, by_label, high_order_variants, variants
from phasebench.integrators.engine.codegen import precision
from phasebench.integrators.record import Method

#: A system is left out where the method runs on this one of its kind, of as many degrees of freedom or more.
SAME_KIND = {"pendulum": "henon-heiles", "perturbed-kepler": "henon-heiles", "tao": "coupled"}
ALL = by_label(variants() + high_order_variants())


def one_of_each_kind(names: list[str]) -> list[str]:
    """The systems without those of which another of the same kind is among them."""
    return [n for n in names if SAME_KIND.get(n) not in names]


def substeps(m: Method) -> tuple:
    """The rows of a composition's record."""
    return m.data[1] if m.family == "parametric" else m.data


def repeated(m: Method):
    """The substeps that a composition of a high order repeats, without their lengths; None of any other method."""
    if m.order <= LOW_ORDER or m.family not in ("parametric", "schemes_iv_v"):
        return None
    return m.family, m.parameters.get("order"), frozenset((row[1], row[-1]) for row in substeps(m))


def _shortest() -> dict:
    """What compositions repeat -> the label of the shortest of them."""
    found: dict = {}
    for label, m in sorted(ALL.items(), key=lambda item: len(substeps(item[1]))):
        found.setdefault(repeated(m), label)
    return {what: label for what, label in found.items() if what}


SHORTEST = _shortest()


def shortest(label: str) -> str:
    """The label of the shortest composition that differs from this one in its fractions alone; or this label."""
    return SHORTEST.get(repeated(ALL[label]), label)


def chosen(what: str, label: str) -> list[str]:
    """The systems of which a method is measured here."""
    names = one_of_each_kind(multiprecision.CELLS[what][1](ALL[label]))
    return names if shortest(label) == label else [n for n in names if n not in NON_SEPARABLE]


def cells(what: str) -> list[tuple[str, str]]:
    """(label, system) of every cell that is measured here."""
    return [(label, name) for label in ALL for name in chosen(what, label)]


def measurements(what: str) -> dict:
    """A measurement of `multiprecision`; {label: {system: it}} of the cells here, as of `multiprecision.everywhere`."""
    if what not in multiprecision.CELLS:
        return multiprecision.MEASUREMENTS[what]()
    out: dict = {label: {} for label in ALL}
    for label, name in cells(what):
        out[label][name] = multiprecision.measure(what, label, name)
    return out


if __name__ == "__main__":
    with precision(multiprecision.DIGITS):
        print(json.dumps({"result": {what: measurements(what) for what in sys.argv[1:]}}))
