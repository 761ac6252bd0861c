"""What every method declares, measured in 40 digits or more: its order on a system, the defects of its step map."""

from __future__ import annotations

from collections import UserList
from collections.abc import Callable
from functools import cached_property
from typing import Any

from phasebench.benchmarks.judge.evidence import NO_DEFECT
from phasebench.integrators.compile.codegen import precision

from . import multiprecision
from .battery import expected_order

#: Measured property -> the attribute of `Method` that declares it.
PROPERTIES = {"symplecticity": "symplectic", "symmetry": "symmetric", "volume": "keeps_volume"}
#: Above this order the defect of a step is so small that only the digits in which it is measured set a bound.
HIGH = 8
#: A processor of many stages is even in h to a high order, so that a processed method is nearly symmetric.
NEARLY = 1e-25


class Keys(UserList):
    """Keys of cells, listed when they are first asked for: that builds all test systems."""

    def __init__(self, make: Callable[[], list[dict]]) -> None:
        self._make = make

    @cached_property
    def data(self) -> list[dict]:
        """The keys."""
        return self._make()


ORDERS = Keys(lambda: [{"method": label, "problem": name} for label, name in multiprecision.cells("orders")])
STRUCTURE = Keys(
    lambda: [
        {"method": label, "property": name}
        for label, chosen in multiprecision.methods().items()
        for name in PROPERTIES
        if multiprecision.CELLS[name][1](chosen)
    ]
)


def order(method: str, problem: str) -> dict:
    """The observed and the declared order of the method with this label on a test system."""
    chosen = multiprecision.methods()[method]
    found = multiprecision.observed_order(_measured("orders", method, problem))
    row = {"declared": expected_order(chosen, problem), "order": found.value, "low": found.low, "high": found.high}
    return row | {"points": found.points, "digits": multiprecision.digits(chosen)}


def structure(method: str, property: str) -> dict:
    """The largest defect of a property of the method with this label over all test systems, and if it is declared."""
    systems = [system for label, system in multiprecision.cells(property) if label == method]
    declared = getattr(multiprecision.methods()[method], PROPERTIES[property])
    defect = max(_measured(property, method, system) for system in systems)
    return {"declared": declared, "defect": defect, "systems": ", ".join(systems)}


def least_visible(label: str, name: str) -> float:
    """Return the least defect of a step that shows that a method (by its label) lacks a property of `PROPERTIES`.

    A smaller one may be an error of the measurement.
    """
    method = multiprecision.methods().get(label)
    if method is None:
        return NO_DEFECT
    if method.order > HIGH:
        return 10.0 ** (-multiprecision.digits(method) / 2)
    return NEARLY if name == "symmetry" and method.family == "processed" else NO_DEFECT


def _measured(what: str, label: str, system: str) -> Any:
    with precision(multiprecision.DIGITS):
        found = multiprecision.measure(what, label, system)
    if isinstance(found, str):
        raise RuntimeError(f"{label} on {system}: {found}")
    return found
