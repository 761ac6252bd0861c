"""Orders and structure without round-off: a cell is a method on a system, measured in 40 digits or more."""

from __future__ import annotations

from phasebench.benchmarks.measure import multiprecision
from phasebench.benchmarks.measure.battery import expected_order
from phasebench.benchmarks.rows.cells import UNCOMPILED, Cell, Rows, content
from phasebench.integrators.engine.codegen import precision

#: Of a structure's table: the measurement, and the declaration that it is held to.
PROPERTIES = {"symplecticity": "symplectic", "symmetry": "symmetric"}
CODE = ("phasebench.benchmarks.measure.multiprecision", "phasebench.benchmarks.measure.battery")


def cells(quick: bool = False) -> list[Cell]:
    """A cell for each method on each system, and one for each property of a method; none of the quick tier."""
    if quick:
        return []
    return [_order(*of) for of in multiprecision.cells("orders")] + [
        _structure(name, label) for label in multiprecision.methods() for name in PROPERTIES
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
    """The observed order of a method on a system; raises RuntimeError where it cannot be measured."""
    chosen = multiprecision.methods()[label]
    row = _measured("orders", label, problem)
    found = multiprecision.observed_order(row)
    about = {"method": label, "problem": problem, "declared": expected_order(chosen, problem)}
    about |= {"order": found.value, "low": found.low, "high": found.high, "points": found.points}
    return {"multiprecision": [about | {"digits": multiprecision.digits(chosen)}]}


def structure(name: str, label: str) -> Rows:
    """The largest defect of a property over the systems where it is measured."""
    systems = [system for known, system in multiprecision.cells(name) if known == label]
    defects = {system: _measured(name, label, system) for system in systems}
    declared = getattr(multiprecision.methods()[label], PROPERTIES[name])
    row = {"method": label, "property": name, "declared": declared, "defect": max(defects.values())}
    return {"structure": [row | {"systems": ", ".join(defects)}]}


def _measured(what: str, label: str, system: str):
    with precision(multiprecision.DIGITS):
        found = multiprecision.measure(what, label, system)
    if isinstance(found, str):
        raise RuntimeError(f"{label} on {system}: {found}")
    return found
