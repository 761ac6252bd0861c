"""PAGES: the pages of a report, in the order in which a reader wants them."""

from __future__ import annotations

from .audit import PAGE as AUDIT
from .coefficients import PAGE as COEFFICIENTS
from .equip import PAGE as EQUIP
from .invariants import PAGE as INVARIANTS
from .kepler import PAGE as KEPLER
from .matrix import PAGE as MATRIX
from .methods import PAGE as METHODS
from .orders import PAGE as ORDERS
from .oscillatory import PAGE as OSCILLATORY
from .page import Page
from .pde import PAGE as PDE
from .printed import PAGE as PRINTED
from .references import PAGE as REFERENCES
from .speed import PAGE as SPEED
from .structure import PAGE as STRUCTURE
from .wisdom_holman import PAGE as WISDOM_HOLMAN

PAGES: tuple[Page, ...] = (
    PRINTED,
    MATRIX,
    ORDERS,
    COEFFICIENTS,
    STRUCTURE,
    INVARIANTS,
    EQUIP,
    OSCILLATORY,
    PDE,
    KEPLER,
    WISDOM_HOLMAN,
    AUDIT,
    REFERENCES,
    SPEED,
    METHODS,
)

__all__ = ["PAGES", "Page"]
