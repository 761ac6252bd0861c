"""`problem` returns a test problem by its name; each has a module of its own, loaded on demand (SymPy is slow)."""

from __future__ import annotations

import importlib
from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

from phasebench.integrators.errors import InvalidInput, unknown_name

from .index import PROBLEMS, plain, real_parameters
from .user_file import SUFFIXES, file_and_object, is_file

if TYPE_CHECKING:
    from types import ModuleType

    from .base import Problem

#: Characters of formulas; no name of a problem or orbit has one.
OPERATORS = frozenset("*+^()")


def problem(name: str | Path, **parameters: float | str) -> Problem:
    """Return a test problem by its id, with values for its parameters: ``problem("kepler", e=0.2)``.

    The name ``id:orbit`` chooses one of its orbits, which are named initial states.

    A name with .py or a slash is the path of a user's own problem, see `benchmarks.problems.user`:
    ``problem("./my_problem.py:orbit", k=2)``.  One with .csv is a table of bodies, see `benchmarks.problems.planetary`.

    Raises
    ------
    InvalidInput
        For an unknown id, orbit or parameter (naming the nearest), a formula, a value outside its range, or a file that
        defines no problem.
    """
    path, orbit = file_and_orbit(str(name))
    if OPERATORS & set(str(name)) and not (path or "").lower().endswith(SUFFIXES):
        raise InvalidInput(
            f"no problem has the name '{name}'; a formula is given by --hamiltonian, in Python by Hamiltonian(q, p, H)"
        )
    if path is not None and path.lower().endswith(".csv"):
        from . import planetary

        return planetary.from_file(path, **parameters)
    if path is not None:
        from . import user

        whole = user.from_file(path, **parameters)
        return whole.at(orbit) if orbit else whole
    id, _, orbit = str(name).partition(":")
    if id not in PROBLEMS:
        raise unknown_name("problem", id, PROBLEMS)
    try:
        whole = _cached_problem(id, **{name: plain(value) for name, value in parameters.items()})
    except TypeError:  # a parameter that is no number, and perhaps not hashable
        whole = _build(id, **parameters)
    return whole.at(orbit) if orbit else whole


@lru_cache(maxsize=128, typed=True)
def _cached_problem(id: str, /, **parameters: float | str) -> Problem:
    from .kept import load_or_make

    return load_or_make((id, sorted(parameters.items())), partial(_build, id, **parameters))


def _build(id: str, /, **parameters: float | str) -> Problem:
    module = importlib.import_module(f".{PROBLEMS[id][0]}", __name__)
    return _call_make(module, **(module.PARAMETERS | real_parameters(f"problem '{id}'", module.PARAMETERS, parameters)))


@lru_cache(maxsize=128, typed=True)
def _call_make(module: ModuleType, **parameters: float) -> Problem:
    """Make a problem by its module, once for the same values, so that nothing is derived again from its formulae."""
    made = module.make(**parameters)
    return made if made.parameters else replace(made, parameters=parameters)


def labels(names: Iterable[str] = ()) -> list[str]:
    """List the orbits of the registered problems in ``names``, each as a label ``id:orbit``, or ``id`` if it is alone.

    An id without an orbit stands for all its orbits, and an empty ``names`` for all problems.  Raises InvalidInput for
    an unknown problem or orbit.
    """
    out: list[str] = []
    for name in list(names) or PROBLEMS:
        id, _, wanted = name.partition(":")
        if id not in PROBLEMS:
            raise unknown_name("problem", id, PROBLEMS)
        orbits = PROBLEMS[id][2]
        if wanted and wanted not in orbits:
            raise unknown_name(f"orbit of '{id}'", wanted, orbits)
        out += [id if len(orbits) == 1 else f"{id}:{orbit}" for orbit in ([wanted] if wanted else orbits)]
    return list(dict.fromkeys(out))


def file_and_orbit(name: str) -> tuple[str | None, str]:
    """Split a user's ``./my_problem.py:orbit`` into path and orbit ("" if none is named); (None, "") for an id."""
    if not is_file(name):
        return None, ""
    return (name, "") if name.lower().endswith(".py") else file_and_object(name)


__all__ = ["PROBLEMS", "labels", "problem"]
