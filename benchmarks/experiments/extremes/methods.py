"""Which methods are pushed: one of each kind, and whatever the registry has of time-transformed ones."""

from __future__ import annotations

from phasebench.integrators.registry import BY_ID, METHODS

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
#: What the name of a family says of methods that change the step along the orbit.
TRANSFORMED = ("transform", "variable", "adaptive", "sundman", "controller")


def transformed() -> tuple[str, ...]:
    """The methods whose family, or a family that they are built on, takes steps of another time."""
    return tuple(m.id for m in METHODS if any(word in family for family in _families(m) for word in TRANSFORMED))


def _families(method) -> list[str]:
    return [method.family, *(f for part in method.data if hasattr(part, "family") for f in _families(part))]


def record(id: str):
    """A method's record."""
    return BY_ID[id]
