"""What may be claimed of an integrator: the names of claims and their values."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from numbers import Real
from typing import Any

from phasebench.integrators import record
from phasebench.integrators.errors import InvalidInput, unknown

#: What a step may claim of how the energy is kept.
ENERGY = ("preserved", record.EXACT, record.ROUND_OFF, record.BOUNDED, record.DRIFT, record.NONE)


def _flag(x) -> bool:
    return isinstance(x, bool)


def _positive(x) -> bool:
    return isinstance(x, Real) and not isinstance(x, bool) and 0 < x < float("inf")


#: Claim -> (what its value must be, whether a value is that).
CLAIMS: dict[str, tuple[str, Callable[[Any], bool]]] = {
    "order": ("a positive integer", lambda x: isinstance(x, int) and not isinstance(x, bool) and x > 0),
    "symplectic": ("True or False", _flag),
    "symmetric": ("True or False", _flag),
    "reversible": ("True or False", _flag),
    "energy": (f"one of {', '.join(ENERGY)}", lambda x: isinstance(x, str) and x in ENERGY),
    "bilinear": (f"one of {', '.join(ENERGY)}", lambda x: isinstance(x, str) and x in ENERGY),
    "quadratic": (f"one of {', '.join(ENERGY)}", lambda x: isinstance(x, str) and x in ENERGY),
    "stability": ("a positive number, the limit of h omega", _positive),
    "tolerance": ("a positive number, the most that an error is of the tolerance", _positive),
}


def checked_claims(claims, where: str) -> dict[str, Any]:
    """The claims, name -> value; raises InvalidInput, which begins with ``where``, for one that is none."""
    if not isinstance(claims, Mapping):
        raise InvalidInput(f"{where} is {claims!r}; write {{'order': 2, 'symplectic': True}}")
    for name, value in claims.items():
        if name not in CLAIMS:
            raise InvalidInput(f"{where}: {unknown('claim', str(name), CLAIMS)}")
        words, right = CLAIMS[name]
        if not right(value):
            raise InvalidInput(f"{where} has {name} = {value!r}; it must be {words}")
    return dict(claims)
