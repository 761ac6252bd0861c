"""SECTIONS: every statement of the two talks, grouped into sections in the talks' order."""

from __future__ import annotations

from dataclasses import dataclass

from . import general, introduction
from .checks_base import TABLE as CHECKS
from .record import TABLE as CURVES
from .statement import Statement

FIRST, SECOND = "introductory talk", "talk on a general integrator"


@dataclass(frozen=True)
class Section:
    """A part of a talk whose statements are judged on one page of the report.

    Attributes
    ----------
    id : suffix of the page's id
    subject : subject of the statements
    talk : `FIRST` or `SECOND`
    tables : names of the measured tables from which the statements are judged
    statements : the section's statements in the talk's order
    """

    id: str
    subject: str
    talk: str
    tables: tuple[str, ...]
    statements: tuple[Statement, ...]

    @property
    def statements_of(self) -> str:
        """A phrase that names the section's statements: "statements of the (talk) about (subject)"."""
        return f"statements of the {self.talk} about {self.subject}"

    @property
    def question(self) -> str:
        """The title of the section's page: the question whether the statements hold."""
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
