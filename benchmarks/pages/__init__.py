"""PAGES: the pages of a report, in the order in which a reader wants them."""

from __future__ import annotations

from .equip import PAGE as EQUIP
from .invariants import PAGE as INVARIANTS
from .methods import PAGE as METHODS
from .orders import PAGE as ORDERS
from .page import Page
from .peers import PAGE as PEERS
from .printed import PAGE as PRINTED
from .speed import PAGE as SPEED
from .structure import PAGE as STRUCTURE

PAGES: tuple[Page, ...] = (PRINTED, ORDERS, STRUCTURE, INVARIANTS, EQUIP, PEERS, SPEED, METHODS)

__all__ = ["PAGES", "Page"]
