"""The methods that are pushed to their limits: one of each kind, and those that change the step along the orbit."""

from __future__ import annotations

from typing import TYPE_CHECKING

from phasebench.integrators.registry import BY_ID, METHODS

if TYPE_CHECKING:
    from phasebench.integrators.record import Method

#: One of each kind, cheap ones first.
REPRESENTATIVE = (
    "symplectic-euler-p",
    "stormer-verlet",
    "rk4",
    "mclachlan-s2",
    "forest-ruth",
    "pefrl",
    "blanes-moan-s6",
    "kahan-li-8",
    "implicit-midpoint",
    "scheme-i",
    "scheme-ii",
    "scheme-iii",
    "gauss-2",
    "gauss-4",
    "avf",
    "scheme-iv",
    "scheme-v",
    "rk4-projected-energy",
)
#: Words in the names of families whose methods change the step along the orbit.
TRANSFORMED = ("transform", "variable", "adaptive", "field", "sundman", "controller")


def step_changing_methods() -> tuple[str, ...]:
    """Return the ids of methods that change the step along the orbit, or are built on a method that does."""
    return tuple(m.id for m in METHODS if any(word in family for family in _families(m) for word in TRANSFORMED))


def _families(method: Method) -> list[str]:
    """Return the families of a method and of the methods that it is built on."""
    return [method.family, *(f for part in method.data if hasattr(part, "family") for f in _families(part))]


def record(id: str) -> Method:
    """Return the registered method with this id."""
    return BY_ID[id]
