"""METHODS: every method, one record each.

A new method of a family that exists is one more record in a module of `records` (see CONTRIBUTING).
"""

from __future__ import annotations

from .errors import unknown
from .record import Method
from .records import (
    adaptive,
    classical,
    collocation,
    compositions,
    energy,
    oscillatory,
    parametric,
    poisson,
    projection,
    splittings,
    variational,
)
from .records import (
    wisdom_holman as kepler,
)

METHODS: tuple[Method, ...] = (
    *classical.METHODS,
    *parametric.METHODS,
    *splittings.METHODS,
    *compositions.METHODS,
    *collocation.METHODS,
    *adaptive.METHODS,
    *variational.METHODS,
    *energy.METHODS,
    *projection.METHODS,
    *oscillatory.METHODS,
    *kepler.METHODS,
    *poisson.METHODS,
)

BY_ID = {m.id: m for m in METHODS}


def method(id: str | Method, **parameters) -> Method:
    """The method of that id, with values for its parameters: ``method("scheme-i", lam=-1)``.

    Raises
    ------
    InvalidInput
        For an unknown id (naming the nearest) or parameter, or a value that is no number.
    """
    if isinstance(id, Method):
        return id(**parameters) if parameters else id
    if id not in BY_ID:
        raise unknown("method", id, BY_ID)
    record = BY_ID[id]
    return record(**parameters) if parameters else record
