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
    solvers,
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

    ``solver="banded"`` solves the equations of a method of one stage in a narrow band (`records.solvers`).

    Raises
    ------
    InvalidInput
        For an unknown id (naming the nearest) or parameter, or a value that is no number.
    """
    solver = parameters.pop("solver", None)
    if not isinstance(id, Method) and id not in BY_ID:
        raise unknown("method", id, BY_ID)
    record = id if isinstance(id, Method) else BY_ID[id]
    record = record(**parameters) if parameters else record
    return record if solver is None else solvers.solved(record, solver)
