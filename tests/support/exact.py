"""Measure properties of a method of each kind in multiprecision, on a system of each kind; a script that prints JSON.

It needs a process with NUMBA_DISABLE_JIT=1.

``python exact.py NAME ...`` measures names of `multiprecision.CELLS` and `slips.MEASUREMENTS`.  `pytest benchmarks`
measures every method on every system (the pages of orders and structure).
"""

from __future__ import annotations

import json
import sys

from phasebench.benchmarks.measure import multiprecision
from phasebench.benchmarks.measure.battery import by_label, high_order_variants, variants
from phasebench.integrators.compile.codegen import precision
from support.one_of_each import kinds
from support.slips import MEASUREMENTS

#: System -> one of the same kind with at least as many degrees of freedom, which stands for it.
SAME_KIND = {"pendulum": "henon-heiles", "perturbed-kepler": "henon-heiles", "tao": "coupled"}
RECORDS = by_label(variants() + high_order_variants())
#: Methods of which tests say more than of their kind.
ALSO = (
    *(f"scheme-i(lam={lam})" for lam in ("-1", "1/3", "1/2", "3/2")),
    "scheme-iv",
    "scheme-v",
    "gauss-4",
    "he-splitting-4",
)
ALL = kinds(RECORDS.values()) | {label: RECORDS[label] for label in ALSO}
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


def systems_for(what: str, label: str) -> list[str]:
    """Return the names of the systems on which the property ``what`` of the method with this label is measured."""
    return one_of_each_kind(multiprecision.CELLS[what][1](ALL[label]))


def cells(what: str) -> list[tuple[str, str]]:
    """List all (method's label, system's name) for which this module makes the measurement ``what``."""
    return [(label, name) for label in ALL for name in systems_for(what, label)]


def measurements(what: str) -> dict:
    """Make the measurement ``what`` of `multiprecision` on this module's methods and systems.

    Returns {method's label: {system: value}}.
    """
    if what not in multiprecision.CELLS:
        return MEASUREMENTS[what]()
    out: dict = {label: {} for label in ALL}
    for label, name in cells(what):
        out[label][name] = multiprecision.measure(what, label, name)
    return out


if __name__ == "__main__":
    with precision(multiprecision.DIGITS):
        print(json.dumps({"result": {what: measurements(what) for what in sys.argv[1:]}}))
