"""PROBLEMS: one module per problem, loaded when it is asked for (SymPy is slow to import)."""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Mapping
from functools import lru_cache
from math import isfinite
from numbers import Integral, Real
from pathlib import Path
from typing import TYPE_CHECKING

from phasebench.integrators.errors import InvalidInput, unknown

from .user_file import is_file

if TYPE_CHECKING:
    from .base import Problem

#: Id -> (module, one line, its orbits: the first is the default).  The test of problems holds it to the modules.
PROBLEMS: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "harmonic-oscillator": ("harmonic_oscillator", "harmonic oscillator", ("unit",)),
    "pendulum": ("pendulum", "mathematical pendulum", ("swinging", "rotating")),
    "kepler": ("kepler", "Kepler problem", ("e",)),
    "perturbed-kepler": ("perturbed_kepler", "Kepler problem with the Schwarzschild term", ("e",)),
    "henon-heiles": ("henon_heiles", "Henon-Heiles", ("chaotic", "box")),
    "outer-solar-system": ("outer_solar_system", "the Sun and five outer planets", ("september-1994",)),
    "lotka-volterra": ("lotka_volterra", "Lotka-Volterra in its own variables", ("2-2", "4-8", "4-2", "6-2")),
    "lotka-volterra-log": ("lotka_volterra_log", "Lotka-Volterra in logarithms", ("2-2", "4-8", "4-2", "6-2")),
    "fpu": ("fpu", "Fermi-Pasta-Ulam with stiff springs", ("one-spring",)),
    "nls": ("nls", "nonlinear Schroedinger equation on N points", ("plane-wave", "soliton")),
    "klein-gordon": ("klein_gordon", "complex Klein-Gordon equation on N points", ("collision",)),
    "double-pendulum": ("double_pendulum", "double pendulum", ("chaotic", "regular")),
    "duffing": ("duffing", "Duffing oscillator", ("one-well", "near-separatrix", "both-wells")),
    "quadrupole-boson": ("quadrupole_boson", "quadrupole boson Hamiltonian", ("benchmark", "h20")),
    "figure-eight": ("three_body", "figure eight of three bodies", ("simo",)),
    "toda": ("toda", "periodic Toda lattice", ("three", "cnoidal")),
    "rigid-body": (
        "rigid_body",
        "free rigid body in Andoyer's variables",
        ("around-e3", "around-e1", "near-separatrix"),
    ),
    "charged-particle": ("charged_particle", "charged particle in a magnetic field", ("drift",)),
    "schwarzschild": (
        "schwarzschild",
        "geodesics of the Schwarzschild metric",
        ("precessing", "zoom-whirl", "isco", "photon-sphere"),
    ),
    "lennard-jones": ("lennard_jones", "frozen argon crystal of seven atoms", ("argon",)),
    "n-body": ("n_body", "gravitational N-body problem", ("pythagorean",)),
}


def problem(name: str | Path, **parameters) -> Problem:
    """The problem ``id`` or ``id:orbit``, with values for its parameters: ``problem("kepler", e=0.2)``.

    A name with .py or a slash is the path of a user's own problem, see `benchmarks.problems.user`:
    ``problem("./my_problem.py:orbit", k=2)``.  One with .csv is a table of bodies, see `benchmarks.problems.planetary`.

    Raises
    ------
    InvalidInput
        For an unknown id, orbit or parameter (naming the nearest) or a value outside its range, or a file that makes
        no problem.
    """
    path, orbit = file_and_orbit(str(name))
    if path is not None and path.lower().endswith(".csv"):
        from . import planetary

        return planetary.from_file(path, **parameters)
    if path is not None:
        from . import user

        whole = user.from_file(path, **parameters)
        return whole.at(orbit) if orbit else whole
    id, _, orbit = str(name).partition(":")
    if id not in PROBLEMS:
        raise unknown("problem", id, PROBLEMS)
    try:
        whole = _whole(id, **{name: _plain(value) for name, value in parameters.items()})
    except TypeError:  # a parameter that is no number, and perhaps not hashable
        whole = _derived(id, **parameters)
    return whole.at(orbit) if orbit else whole


def _plain(value: object) -> object:
    """A real number of any type as Python's own, by which the cache knows it; anything else as it is."""
    if not _finite(value):
        return value
    return int(value) if isinstance(value, Integral) else float(value)


@lru_cache(maxsize=128, typed=True)
def _whole(id: str, /, **parameters) -> Problem:
    """The problem, the same object each time, from the cache where that has it."""
    from .kept import whole

    return whole(id, parameters, lambda: _derived(id, **parameters))


def _derived(id: str, /, **parameters) -> Problem:
    """The problem with its formulae."""
    module = importlib.import_module(f".{PROBLEMS[id][0]}", __name__)
    return _made(module, **(module.PARAMETERS | real_parameters(f"problem '{id}'", module.PARAMETERS, parameters)))


@lru_cache(maxsize=128, typed=True)
def _made(module, **parameters) -> Problem:
    """The problem of a module, the same object each time: what was derived from its formulae is kept with it."""
    return module.make(**parameters)


def labels(names: Iterable[str] = ()) -> list[str]:
    """The labels, as `Problem.label`, that names stand for: a label, or an id for each of its orbits; all at first.

    Raises
    ------
    InvalidInput
        For an unknown problem or orbit.
    """
    out: list[str] = []
    for name in list(names) or PROBLEMS:
        id, _, wanted = name.partition(":")
        if id not in PROBLEMS:
            raise unknown("problem", id, PROBLEMS)
        orbits = PROBLEMS[id][2]
        if wanted and wanted not in orbits:
            raise unknown(f"orbit of '{id}'", wanted, orbits)
        out += [id if len(orbits) == 1 else f"{id}:{orbit}" for orbit in ([wanted] if wanted else orbits)]
    return list(dict.fromkeys(out))


def file_and_orbit(name: str) -> tuple[str | None, str]:
    """(path, orbit) of ``./my_problem.py:orbit`` (a drive's colon is part of the path); (None, "") for an id."""
    head, _, orbit = name.rpartition(":")
    if not name.lower().endswith(".py") and head.lower().endswith(".py"):
        return head, orbit
    return (name, "") if is_file(name) else (None, "")


def _finite(value: object) -> bool:
    try:
        return isinstance(value, Real) and not isinstance(value, bool) and isfinite(value)
    except OverflowError:  # a whole number, or a fraction of such, beyond the doubles
        return False


def real_parameters(what: str, known: Iterable[str], values: Mapping[str, object]) -> dict[str, int | float]:
    """The parameters as Python's numbers; raises InvalidInput for one that is not ``known`` or no finite number."""
    for key, value in values.items():
        if key not in known:
            has = f"has {', '.join(known)}" if known else "has none"
            raise InvalidInput(f"{what} has no parameter '{key}'; it {has}")
        if not _finite(value):
            raise InvalidInput(f"the parameter {key} of {what} is {value!r:.80}; it must be a finite number")
    return {key: _plain(value) for key, value in values.items()}


__all__ = ["PROBLEMS", "labels", "problem"]
