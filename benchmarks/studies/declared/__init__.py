"""Is a method what it declares: of its order, the structure of its steps, and energy and drift over long times?"""

from __future__ import annotations

from . import drift, invariants, matrix, orders, structure

STUDIES = (orders.STUDY, structure.STUDY, matrix.STUDY, invariants.STUDY, drift.STUDY)
