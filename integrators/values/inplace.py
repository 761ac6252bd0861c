"""Versions of a system's functions that write their results into arrays passed to them, for large d.

A function f(q, ...) -> g, or -> (g, k), becomes f(q, ..., g) -> None, or f(q, ..., g, k) -> None; `vector.writes`
recognizes the type of such functions.  A method whose loop can use them takes the `in_place_version` of a system, and
sets the number of degrees of freedom above which it does so.  That number may be small: avoiding the allocation of
arrays pays even for states that would still fit in registers.
"""

from __future__ import annotations

import ast
import copy
from collections.abc import Callable
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

from numba import types

from phasebench.integrators.compile.codegen import DOUBLE, compiled, value_kind

if TYPE_CHECKING:
    from phasebench.integrators.systems.hamiltonian import PartitionedSystem


def signature(returning: Any) -> Any:
    """Return the Numba signature of a function's version that writes its results into further arguments.

    ``returning`` is the signature of the version that returns them.
    """
    results = returning.return_type
    many = results.types if isinstance(results, types.BaseTuple) else (results,)
    return types.none(*returning.args, *many)


def write_in_place(build: Callable[[str], str]) -> Callable[[str], str]:
    """Convert a writer of source text: the functions that it writes store their results instead of returning them.

    ``build(arithmetic)`` returns the text of a function that ends in ``return value((...)), ...``; the converted writer
    returns the text in which these results are stored in further arguments ``out0``, ``out1``, ...
    """
    return lambda arithmetic: _rewrite(build(arithmetic))


def _rewrite(text: str) -> str:
    """Rewrite the text of a function that returns vectors as one that writes them into ``out0``, ``out1``, ..."""
    tree = ast.parse(text)
    f = tree.body[0]
    results = f.body[-1].value
    values = results.elts if isinstance(results, ast.Tuple) else [results]
    f.body.pop()
    for k, value in enumerate(values):
        f.args.args.append(ast.arg(f"out{k}"))
        f.body += [ast.parse(f"out{k}[{i}] = {ast.unparse(e)}").body[0] for i, e in enumerate(value.args[0].elts)]
    return ast.unparse(tree) + "\n"


#: System -> its version whose functions write.
_versions: WeakKeyDictionary = WeakKeyDictionary()


def in_place_version(system: PartitionedSystem, arithmetic: str, most: int) -> PartitionedSystem:
    """Return a copy of the system whose functions write results into arrays; the system itself if states are tuples.

    States are tuples up to ``most`` degrees of freedom, or up to `codegen.TUPLE_LIMIT` if that is smaller.  The system
    itself is returned, too, if nothing is compiled or the arithmetic is not double.  Repeated calls return the same
    object.
    """
    if arithmetic != DOUBLE or not compiled() or value_kind(system.d, arrays=system.d > most) == "tuple":
        return system
    if system not in _versions:
        other = copy.copy(system)
        other._functions, other.fills = {}, True
        _versions[system] = other
    return _versions[system]
