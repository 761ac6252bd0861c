"""Choose the solver of a method's stage equations; the default is fixed-point iteration, then Newton's method."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.record import Method

if TYPE_CHECKING:
    from phasebench.integrators.keywords import Value

#: The solvers that can be named: Newton's method for equations in a narrow band (`families.banded`).
BANDED = "banded"
SOLVERS = (BANDED,)


def with_solver(base: Method, solver: str) -> Method:
    """Return the method ``base`` with another solver of its stage equations; ``solver`` becomes one of its parameters.

    Raises InvalidInput for an unknown solver, or a method that is not of one stage.
    """
    if solver not in SOLVERS:
        raise InvalidInput(f"the solver is {solver!r}; it must be {' or '.join(SOLVERS)}, or be left out")
    if base.family == "banded":
        return base
    if base.family != "parametric":
        families = "implicit methods of one stage and their compositions"
        raise InvalidInput(f"'{base.id}' has no banded solver; {families} have one, such as implicit-midpoint")

    def again(solver: str, **values: Value) -> dict:
        made = with_solver(base(**values), solver)
        return {"data": made.data, "order": made.order, "symmetric": made.symmetric}

    return replace(base, family="banded", parameters=dict(base.parameters) | {"solver": solver}, with_parameters=again)
