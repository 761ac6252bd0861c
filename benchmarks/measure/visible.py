"""The least defect of a step map that shows that a method lacks a structure, such as symplecticity.

Defects are measured by `multiprecision`, in 40 digits, or in more for high orders; a smaller defect may be an error of
the measurement.
"""

from __future__ import annotations

from functools import cache

from phasebench.benchmarks.judge.evidence import NO_DEFECT
from phasebench.integrators.record import Method

from . import multiprecision

#: Above this order the defect of a step is so small that only the digits in which it is measured set a bound.
HIGH = 8
#: A processor of many stages is even in h to a high order, so that a processed method is nearly symmetric.
NEARLY = 1e-25


@cache
def _methods() -> dict[str, Method]:
    return multiprecision.methods()


def least_visible(label: str, name: str) -> float:
    """Return the least defect of a step in multiprecision that shows that a method lacks a property.

    ``label`` is the method's label, ``name`` the property: "symplecticity", "symmetry" or "volume".
    """
    method = _methods().get(label)
    if method is None:
        return NO_DEFECT
    if method.order > HIGH:
        return 10.0 ** (-multiprecision.digits(method) / 2)
    return NEARLY if name == "symmetry" and method.family == "processed" else NO_DEFECT
