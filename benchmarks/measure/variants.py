"""The parameter values with which each method is run in the experiments that compare all methods."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from phasebench.integrators.record import Method
from phasebench.integrators.registry import METHODS

#: Values of lambda in the tables of the talk (see `studies.said.talks`), and the schemes in these tables.
LAMBDAS = ("-1", "1/3", "3/2", "2")
TABULATED = ("scheme-i", "scheme-ii", "scheme-iii")


def variants(methods: Iterable[Method] = METHODS) -> Iterator[tuple[str, tuple[tuple[str, str], ...]]]:
    """Yield (id, pairs of parameter and value as text) of every method, for a run of all methods.

    Methods in `TABULATED` come once for each value in `LAMBDAS`, those with a parameter ``order`` for the orders 3 and
    4.
    """
    for m in methods:
        if m.id in TABULATED:
            yield from ((m.id, (("lam", lam),)) for lam in LAMBDAS)
        elif "order" in m.parameters:
            yield from ((m.id, (("order", str(r)),)) for r in (3, 4))
        else:
            yield m.id, ()
