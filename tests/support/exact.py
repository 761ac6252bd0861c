"""Measurements in multiprecision on a system of each kind, for a process with NUMBA_DISABLE_JIT=1: prints JSON.

``python exact.py NAME ...`` measures names of `multiprecision.MEASUREMENTS`. Kernels differ between separable and
non-separable H, so every method is measured on both; of high-order compositions that differ only in their fractions,
only the shortest. `pytest benchmarks` measures every method on every system (the page of orders).
"""

from __future__ import annotations

import json
import sys

from phasebench.benchmarks.measure import multiprecision
from phasebench.benchmarks.measure.battery import LOW_ORDER, NON_SEPARABLE, by_label, high_order_variants, variants
from phasebench.integrators.compile.codegen import precision
from phasebench.integrators.record import Method

#: System -> one of the same kind with at least as many degrees of freedom, which stands for it.
SAME_KIND = {"pendulum": "henon-heiles", "perturbed-kepler": "henon-heiles", "tao": "coupled"}
ALL = by_label(variants() + high_order_variants())


def one_of_each_kind(names: list[str]) -> list[str]:
    """The names of systems without those for which another one in the list stands (`SAME_KIND`)."""
    return [n for n in names if SAME_KIND.get(n) not in names]


def substeps(m: Method) -> tuple:
    """The substeps of a composition method."""
    return m.data[1] if m.family == "parametric" else m.data


def bare_substeps(m: Method):
    """The substeps of a high-order composition without their lengths; None for any other method."""
    if m.order <= LOW_ORDER or m.family not in ("parametric", "schemes_iv_v"):
        return None
    return m.family, m.parameters.get("order"), frozenset((row[1], row[-1]) for row in substeps(m))


def _shortest() -> dict:
    """{set of substeps: label of the shortest composition with it}."""
    found: dict = {}
    for label, m in sorted(ALL.items(), key=lambda item: len(substeps(item[1]))):
        found.setdefault(bare_substeps(m), label)
    return {what: label for what, label in found.items() if what}


SHORTEST = _shortest()


def shortest(label: str) -> str:
    """Label of the shortest composition with the same substeps up to their lengths, or the label itself."""
    return SHORTEST.get(bare_substeps(ALL[label]), label)


def systems_for(what: str, label: str) -> list[str]:
    """Names of the systems on which property ``what`` of method ``label`` is measured."""
    names = one_of_each_kind(multiprecision.CELLS[what][1](ALL[label]))
    return names if shortest(label) == label else [n for n in names if n not in NON_SEPARABLE]


def cells(what: str) -> list[tuple[str, str]]:
    """All (label of a method, system) for which a measurement is made in this module."""
    return [(label, name) for label in ALL for name in systems_for(what, label)]


def measurements(what: str) -> dict:
    """Results of a measurement of `multiprecision` on this module's methods and systems: {label: {system: value}}."""
    if what not in multiprecision.CELLS:
        return multiprecision.MEASUREMENTS[what]()
    out: dict = {label: {} for label in ALL}
    for label, name in cells(what):
        out[label][name] = multiprecision.measure(what, label, name)
    return out


if __name__ == "__main__":
    with precision(multiprecision.DIGITS):
        print(json.dumps({"result": {what: measurements(what) for what in sys.argv[1:]}}))
