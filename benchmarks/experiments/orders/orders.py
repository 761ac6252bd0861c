"""Orders and structure of every method without round-off, measured in 40 digits or more."""

from __future__ import annotations

from phasebench.benchmarks.measure import multiprecision
from phasebench.benchmarks.measure.battery import expected_order
from phasebench.benchmarks.store.cells import UNCOMPILED, Cell, Rows, content
from phasebench.integrators.compile.codegen import precision

#: Measured property -> the attribute of `Method` that declares it.
PROPERTIES = {"symplecticity": "symplectic", "symmetry": "symmetric", "volume": "keeps_volume"}
CODE = ("phasebench.benchmarks.measure.multiprecision", "phasebench.benchmarks.measure.battery")


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`): one for each method on each system, one for each property of a method.

    The list is empty if ``quick``.
    """
    if quick:
        return []
    return [_order(*of) for of in multiprecision.cells("orders")] + [
        _structure(name, label)
        for label, chosen in multiprecision.methods().items()
        for name in PROPERTIES
        if multiprecision.CELLS[name][1](chosen)
    ]


def _order(label: str, problem: str) -> Cell:
    chosen = multiprecision.methods()[label]
    return Cell(
        "orders",
        ("multiprecision",),
        {"method": label, "problem": problem},
        order,
        (label, problem),
        content("order", label, chosen, problem, code=CODE),
        frozenset({chosen.id, problem}),
        UNCOMPILED,
    )


def _structure(name: str, label: str) -> Cell:
    chosen = multiprecision.methods()[label]
    return Cell(
        "orders",
        ("structure",),
        {"method": label, "property": name},
        structure,
        (name, label),
        content("structure", name, label, chosen, code=CODE),
        frozenset({chosen.id}),
        UNCOMPILED,
    )


def order(label: str, problem: str) -> Rows:
    """Measure the order of the method with this label on a system in many digits: one row, by table name.

    Raises RuntimeError if it cannot be measured.
    """
    chosen = multiprecision.methods()[label]
    row = _measure_or_raise("orders", label, problem)
    found = multiprecision.observed_order(row)
    about = {"method": label, "problem": problem, "declared": expected_order(chosen, problem)}
    about |= {"order": found.value, "low": found.low, "high": found.high, "points": found.points}
    return {"multiprecision": [about | {"digits": multiprecision.digits(chosen)}]}


def structure(name: str, label: str) -> Rows:
    """Measure the largest defect of a property of the method ``label`` over all test systems: one row, by table name.

    ``name`` is the property: "symplecticity", "symmetry" or "volume".  Raises RuntimeError if a measurement fails.
    """
    systems = [system for known, system in multiprecision.cells(name) if known == label]
    defects = {system: _measure_or_raise(name, label, system) for system in systems}
    declared = getattr(multiprecision.methods()[label], PROPERTIES[name])
    row = {"method": label, "property": name, "declared": declared, "defect": max(defects.values())}
    return {"structure": [row | {"systems": ", ".join(defects)}]}


def _measure_or_raise(what: str, label: str, system: str) -> dict | float:
    with precision(multiprecision.DIGITS):
        found = multiprecision.measure(what, label, system)
    if isinstance(found, str):
        raise RuntimeError(f"{label} on {system}: {found}")
    return found
