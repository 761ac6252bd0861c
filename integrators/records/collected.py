"""Records of splittings and of compositions of Stormer-Verlet that a survey lists (``published/collected.toml``)."""

from __future__ import annotations

from phasebench.integrators.coefficients import GROUPS
from phasebench.integrators.record import Method

from . import splittings
from .compositions import BASES, compose

METHODS: tuple[Method, ...] = tuple(
    compose(BASES["stormer-verlet"], t.name, id=t.name) if t.gamma else splittings.record(t)
    for t in GROUPS["collected"]
)
