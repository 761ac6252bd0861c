"""Measurements without round-off on a system of each kind, for a process with NUMBA_DISABLE_JIT=1: prints JSON.

``python exact.py NAME`` measures a name of `multiprecision.CELLS`.  A kernel does one thing on a separable H and
another on one that is not; `pytest benchmarks` measures every method on every system (the page of orders).
"""

from __future__ import annotations

import json
import sys

from phasebench.benchmarks.measure import multiprecision
from phasebench.benchmarks.measure.battery import by_label, high_order_variants, variants
from phasebench.integrators.engine.codegen import precision

#: A system is left out where the method runs on this one of its kind, of as many degrees of freedom or more.
SAME_KIND = {"pendulum": "henon-heiles", "perturbed-kepler": "henon-heiles", "tao": "coupled"}
ALL = by_label(variants() + high_order_variants())


def one_of_each_kind(names: list[str]) -> list[str]:
    """The systems without those of which another of the same kind is among them."""
    return [n for n in names if SAME_KIND.get(n) not in names]


def cells(what: str) -> list[tuple[str, str]]:
    """(label, system) of every cell that is measured here."""
    choose = multiprecision.CELLS[what][1]
    return [(label, name) for label, m in ALL.items() for name in one_of_each_kind(choose(m))]


def measurements(what: str) -> dict:
    """{label: {system: measurement}}, as of `multiprecision.everywhere`."""
    out: dict = {label: {} for label in ALL}
    for label, name in cells(what):
        out[label][name] = multiprecision.measure(what, label, name)
    return out


if __name__ == "__main__":
    with precision(multiprecision.DIGITS):
        print(json.dumps({"result": measurements(sys.argv[1])}))
