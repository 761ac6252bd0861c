"""All methods, with the parameter values at which a sweep runs them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from phasebench.integrators.record import Method
from phasebench.integrators.registry import METHODS

#: Values of lambda in the tables of the talk (see `experiments.talks`), and the schemes in these tables.
LAMBDAS = ("-1", "1/3", "3/2", "2")
TABULATED = ("scheme-i", "scheme-ii", "scheme-iii")


def variants(methods: Iterable[Method] = METHODS) -> Iterator[tuple[str, tuple[tuple[str, str], ...]]]:
    """(id, parameters) of every method: `TABULATED` ones at each lam of `LAMBDAS`, those with an order at 3 and 4."""
    for m in methods:
        if m.id in TABULATED:
            yield from ((m.id, (("lam", lam),)) for lam in LAMBDAS)
        elif "order" in m.parameters:
            yield from ((m.id, (("order", str(r)),)) for r in (3, 4))
        else:
            yield m.id, ()
