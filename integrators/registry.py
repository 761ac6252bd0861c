"""METHODS: the registry of all integration methods, one record (`record.Method`) each.

To add a method whose family (kind of kernel) exists, add a record to a module of `records` (see CONTRIBUTING).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from .names import Records, unknown_method
from .record import Method
from .records import (
    adaptive,
    classical,
    collocation,
    compositions,
    constrained,
    energy,
    extended,
    magnetic,
    multistep,
    oscillatory,
    parametric,
    parts,
    poisson,
    processed,
    projection,
    rigid,
    solvers,
    splittings,
    variational,
    wisdom_holman,
)

if TYPE_CHECKING:
    from .keywords import Value

#: The modules of records, in the order in which methods are listed.
MODULES = (
    *(classical, parametric, splittings, compositions, processed, collocation, adaptive, variational, energy),
    *(projection, extended, oscillatory, wisdom_holman, poisson, magnetic, constrained, rigid, parts, multistep),
)
_RECORDS: tuple[Method, ...] = tuple(m for module in MODULES for m in module.METHODS)
BY_ID = {m.id: m for m in _RECORDS}


def parameter_names(method: str | Method) -> list[str]:
    """The names of a method's parameters, ``solver`` included; an empty list for an unknown method."""
    record = method if isinstance(method, Method) else BY_ID.get(method) if isinstance(method, str) else None
    return [] if record is None else [*record.parameters, "solver"]


def method(id: str | Method, **parameters: Value) -> Method:
    """The record of the method with this id, with values for its parameters: ``method("scheme-i", lam=-1)``.

    ``solver="banded"`` solves the equations of a method of one stage in a narrow band (`records.solvers`).

    Raises
    ------
    InvalidInput
        For an unknown id (naming the nearest) or parameter, or a value that is no number.
    """
    solver = parameters.pop("solver", None)
    if not isinstance(id, Method) and id not in BY_ID:
        raise unknown_method(id, BY_ID)
    record = id if isinstance(id, Method) else BY_ID[id]
    record = record(**parameters) if parameters else record
    return record if solver is None else solvers.with_solver(record, solver)


#: All methods; ``METHODS["rk4"]`` is ``method("rk4")``.
METHODS: Records[Method] = Records.of(_RECORDS, method)
