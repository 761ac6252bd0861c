"""Measure properties of methods in multiprecision, on a system of each kind; a script that prints JSON.

It needs a process with NUMBA_DISABLE_JIT=1.

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
#: The least visible defect of symplecticity and symmetry.
VISIBLE = 1e-22


def numbers(row: dict) -> dict:
    """Return the row of a measurement; fail if it is empty or an entry is an error message."""
    assert row
    assert not [x for x in row.values() if isinstance(x, str)], row
    return row


def one_of_each_kind(names: list[str]) -> list[str]:
    """Return the names of systems without those for which another one of the same kind (`SAME_KIND`) is listed."""
    return [n for n in names if SAME_KIND.get(n) not in names]


def substeps(m: Method) -> tuple:
    """Return the substeps of a composition method, as its record holds them."""
    return m.data[1] if m.family == "parametric" else m.data


def bare_substeps(m: Method):
    """Return what remains of a high-order composition without the lengths of its substeps; None for other methods.

    It is (family, parameter "order", set of the kinds of substeps), equal for compositions that differ in lengths only.
    """
    if m.order <= LOW_ORDER or m.family not in ("parametric", "schemes_iv_v"):
        return None
    return m.family, m.parameters.get("order"), frozenset((row[1], row[-1]) for row in substeps(m))


def _shortest() -> dict:
    """Return {kinds of substeps: label of the shortest composition made of them}, for high-order compositions."""
    found: dict = {}
    for label, m in sorted(ALL.items(), key=lambda item: len(substeps(item[1]))):
        found.setdefault(bare_substeps(m), label)
    return {what: label for what, label in found.items() if what}


SHORTEST = _shortest()


def shortest(label: str) -> str:
    """Return the label of the shortest composition with the same kinds of substeps; other methods keep their label."""
    return SHORTEST.get(bare_substeps(ALL[label]), label)


def systems_for(what: str, label: str) -> list[str]:
    """Return the names of the systems on which the property ``what`` of the method with this label is measured.

    A high-order composition that is not the shortest of its kind is measured on separable systems only.
    """
    names = one_of_each_kind(multiprecision.CELLS[what][1](ALL[label]))
    return names if shortest(label) == label else [n for n in names if n not in NON_SEPARABLE]


def cells(what: str) -> list[tuple[str, str]]:
    """List all (method's label, system's name) for which this module makes the measurement ``what``."""
    return [(label, name) for label in ALL for name in systems_for(what, label)]


def measurements(what: str) -> dict:
    """Make the measurement ``what`` of `multiprecision` on this module's methods and systems.

    Returns {method's label: {system: value}}.
    """
    if what not in multiprecision.CELLS:
        return multiprecision.MEASUREMENTS[what]()
    out: dict = {label: {} for label in ALL}
    for label, name in cells(what):
        out[label][name] = multiprecision.measure(what, label, name)
    return out


if __name__ == "__main__":
    with precision(multiprecision.DIGITS):
        print(json.dumps({"result": {what: measurements(what) for what in sys.argv[1:]}}))
