"""Decorators that check keyword arguments: misspelt and renamed ones, and parameters of methods given as keywords."""

from __future__ import annotations

import functools
import inspect
import sys
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, Any, ParamSpec, TypeAlias, TypeVar

from .errors import InvalidInput

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

#: The value of a method's parameter: a number, a NumPy scalar, a fraction, or a text such as "1/3".
Value: TypeAlias = "float | str | Fraction | np.number[Any]"
#: Values of a method's parameters by name.
Parameters: TypeAlias = "Mapping[str, Value]"

#: A state: d numbers; states: a row for each orbit.
State: TypeAlias = "Sequence[float] | NDArray[np.floating[Any]] | NDArray[np.integer[Any]]"
States: TypeAlias = "Sequence[State] | NDArray[np.floating[Any]] | NDArray[np.integer[Any]]"

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def check_names(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Decorator: an unknown keyword raises InvalidInput, which names the nearest known one."""
    known = list(inspect.signature(function).parameters)

    @functools.wraps(function)
    def call(*given: Arguments.args, **named: Arguments.kwargs) -> Result:
        for name in named:
            if name not in known:
                raise _unknown(function.__name__, name, known)
        return function(*given, **named)

    return call


def _deprecated(message: str) -> None:
    """Issue a DeprecationWarning at the line that calls a decorated function, however many decorators it has."""
    frame, level = sys._getframe(), 1
    while frame.f_code.co_filename == __file__ and frame.f_back is not None:
        frame, level = frame.f_back, level + 1
    warnings.warn(message, DeprecationWarning, stacklevel=level)


def _near(name: str, known: list[str]) -> list[str]:
    from difflib import get_close_matches

    return get_close_matches(name, known, n=1)


def _unknown(function: str, name: str, known: list[str], more: str = "") -> InvalidInput:
    near = _near(name, known)
    hint = f"did you mean {near[0]}?" if near else f"{function} takes {', '.join(known)}{more}"
    return InvalidInput(f"unknown argument {name}; {hint}")


def rename_arguments(**new: str) -> Callable[[Callable[Arguments, Result]], Callable[Arguments, Result]]:
    """Decorator: accept arguments by their old names, with a DeprecationWarning.

    Its keywords are the renamed arguments: ``rename_arguments(old="new")``.  A call of the function with both names of
    an argument raises InvalidInput.
    """

    def decorate(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
        @functools.wraps(function)
        def call(*given: Arguments.args, **named: Arguments.kwargs) -> Result:
            for old in [name for name in named if name in new]:
                if new[old] in named:
                    raise InvalidInput(f"{old} is now {new[old]}, and both are given; leave out {old}")
                _deprecated(f"{old}= is now {new[old]}=")
                named[new[old]] = named.pop(old)
            return function(*given, **named)

        return call

    return decorate


def method_parameters(
    names: Callable[[Any], Iterable[str]],
) -> Callable[[Callable[Arguments, Result]], Callable[Arguments, Result]]:
    """Decorator of a function with an argument ``method``: accept the method's parameters as keywords, too.

    Such keywords are moved to the argument ``parameters``, with a DeprecationWarning; any other unknown keyword raises
    InvalidInput.  A type checker sees the function's own signature.  ``names(method)`` returns the names of the
    parameters of a method.
    """

    def decorate(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
        known = list(inspect.signature(function).parameters)
        place = known.index("method")

        @functools.wraps(function)
        def call(*given: Arguments.args, **named: Arguments.kwargs) -> Result:
            foreign = {name: value for name, value in named.items() if name not in known}
            if not foreign:
                return function(*given, **named)
            own = {name: value for name, value in named.items() if name in known}
            method = given[place] if len(given) > place else own.get("method")
            spelt = _merge_keywords(function.__name__, foreign, own.get("parameters"), names(method), known)
            return function(*given, **own | {"parameters": spelt})  # type: ignore[arg-type]

        return call

    return decorate


def _merge_keywords(
    function: str, foreign: dict[str, Any], parameters: Any, names: Iterable[str], known: list[str]
) -> dict[str, Any]:
    """Return ``parameters`` with the keywords ``foreign`` added, which must be among the method's ``names``."""
    names = list(names)
    for name in foreign:
        if name in names:
            continue
        if (near := _near(name, names)) and not _near(name, known):
            raise InvalidInput(f"unknown argument {name}; did you mean parameters={{'{near[0]}': {foreign[name]!r}}}?")
        takes = f"; the method's parameters are parameters={{...}} of {', '.join(names)}" if names else ""
        raise _unknown(function, name, known, takes)
    _deprecated(f"{', '.join(f'{k}={v!r}' for k, v in foreign.items())} is now parameters={foreign!r}")
    return {**(parameters or {}), **foreign}
