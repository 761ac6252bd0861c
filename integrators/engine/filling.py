"""Functions that write their results into arrays handed to them: of large d, for kernels that work in place.

Of a function (q, ...) -> g or (g, k) it is the one (q, ..., g) -> None or (q, ..., g, k) -> None, with `vector.writes`
of its type.  A family whose kernel takes such functions asks the `twin` of a system for them, and says from how many
degrees of freedom on: arrays that nothing allocates pay before registers are full of other numbers.
"""

from __future__ import annotations

import ast
import copy
from collections.abc import Callable
from weakref import WeakKeyDictionary

from numba import types

from .codegen import DOUBLE, compiled, value_kind


def signature(returning):
    """The signature that writes of one that returns an array or several."""
    results = returning.return_type
    many = results.types if isinstance(results, types.BaseTuple) else (results,)
    return types.none(*returning.args, *many)


def written(build: Callable[[str], str]) -> Callable[[str], str]:
    """What writes the text of a function, f(q, ...) that ends on ``return value((...)), ...``, so that it writes."""
    return lambda arithmetic: _writing(build(arithmetic))


def _writing(text: str) -> str:
    tree = ast.parse(text)
    f = tree.body[0]
    results = f.body[-1].value
    values = results.elts if isinstance(results, ast.Tuple) else [results]
    f.body.pop()
    for k, value in enumerate(values):
        f.args.args.append(ast.arg(f"out{k}"))
        f.body += [ast.parse(f"out{k}[{i}] = {ast.unparse(e)}").body[0] for i, e in enumerate(value.args[0].elts)]
    return ast.unparse(tree) + "\n"


#: The twins of systems.
_twins: WeakKeyDictionary = WeakKeyDictionary()


def twin(system, arithmetic: str, most: int):
    """The system up to ``most`` degrees of freedom or the tuples' limit; above, the one whose functions write.

    That is always the same one.
    """
    if arithmetic != DOUBLE or not compiled() or value_kind(system.d, arrays=system.d > most) == "tuple":
        return system
    if system not in _twins:
        other = copy.copy(system)
        other._functions, other.fills = {}, True
        _twins[system] = other
    return _twins[system]
