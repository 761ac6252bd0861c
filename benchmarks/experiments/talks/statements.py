"""SECTIONS: every statement of the two talks, in their order."""

from __future__ import annotations

from dataclasses import dataclass

from . import general, introduction
from .checks_base import TABLE as CHECKS
from .record import TABLE as CURVES
from .statement import Statement

FIRST, SECOND = "introduction", "general integrator"


@dataclass(frozen=True)
class Section:
    """A part of a talk that has a page.

    Attributes
    ----------
    id, title : of the page; the title is a question
    talk : which of the two
    tables : that its judges read
    statements : in the talk's order
    """

    id: str
    title: str
    talk: str
    tables: tuple[str, ...]
    statements: tuple[Statement, ...]


SECTIONS: tuple[Section, ...] = (
    Section("maps", "What the introduction says of flows, maps and methods: does it hold?", FIRST,
            (CHECKS, CURVES, "matrix", "multiprecision", "structure"), introduction.MAPS_AND_METHODS),
    Section("lotka-volterra", "What the introduction says of Lotka–Volterra: does it hold?", FIRST,
            (CHECKS, CURVES, "multiprecision", "structure"), introduction.LOTKA_VOLTERRA),
    Section("schemes", "What the second talk says of Scheme I and of its field: does it hold?", SECOND,
            (CHECKS, "matrix", "multiprecision", "structure", "multisymplectic"), general.SCHEMES),
    Section("generating", "What the second talk says of generating functions and compositions: does it hold?", SECOND,
            (CHECKS, "multiprecision", "structure"), general.GENERATING),
    Section("preserving", "What the second talk says of keeping energy and quadratic invariants: does it hold?", SECOND,
            (CHECKS, CURVES, "energy_preservation", "matrix", "multiprecision", "pde", "structure"),
            general.PRESERVING),
    Section("experiments", "What the second talk's tables and figures show: is it reproduced?", SECOND,
            (CHECKS, CURVES, "energy_preservation", "pde", "printed"), general.EXPERIMENTS),
)  # fmt: skip
