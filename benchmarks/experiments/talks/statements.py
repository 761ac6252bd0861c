"""SECTIONS: every statement of the two talks, in the talks' order."""

from __future__ import annotations

from dataclasses import dataclass

from . import general, introduction
from .checks_base import TABLE as CHECKS
from .record import TABLE as CURVES
from .statement import Statement

FIRST, SECOND = "introductory talk", "talk on a general integrator"


@dataclass(frozen=True)
class Section:
    """A part of a talk that has a page.

    Attributes
    ----------
    id : suffix of the page's id
    subject : subject of the statements
    talk : `FIRST` or `SECOND`
    tables : names of the tables that its judges read
    statements : its statements in the talk's order
    """

    id: str
    subject: str
    talk: str
    tables: tuple[str, ...]
    statements: tuple[Statement, ...]

    @property
    def statements_of(self) -> str:
        """A phrase that names the section's statements by talk and subject."""
        return f"statements of the {self.talk} about {self.subject}"

    @property
    def question(self) -> str:
        """The question that the section's page answers, its title."""
        return f"Do the {self.statements_of} hold?"


SECTIONS: tuple[Section, ...] = (
    Section("maps", "flows, maps and methods", FIRST,
            (CHECKS, CURVES, "matrix", "multiprecision", "structure"), introduction.MAPS_AND_METHODS),
    Section("lotka-volterra", "Lotka–Volterra", FIRST,
            (CHECKS, CURVES, "multiprecision", "structure"), introduction.LOTKA_VOLTERRA),
    Section("schemes", "known methods and Scheme I", SECOND,
            (CHECKS, "matrix", "multiprecision", "structure", "multisymplectic"), general.SCHEMES),
    Section("generating", "generating functions and compositions", SECOND,
            (CHECKS, "multiprecision", "structure"), general.GENERATING),
    Section("preserving", "energy and quadratic invariants", SECOND,
            (CHECKS, CURVES, "energy_preservation", "matrix", "multiprecision", "pde", "structure"),
            general.PRESERVING),
    Section("experiments", "numerical experiments", SECOND,
            (CHECKS, CURVES, "energy_preservation", "pde", "printed"), general.EXPERIMENTS),
)  # fmt: skip
