"""A user's own problem: from a Python file, or from a formula.

A file is written like a module of this package: ``make(**parameters) -> Problem``, the parameters' values in
``PARAMETERS`` or as defaults of ``make``; without parameters, a ``problem = Problem(...)`` is enough.  Its code is
executed.  A formula is parsed (`systems.formula`), never evaluated as Python.

Either is checked against the contract of all problems before it is integrated: finite initial data, off the
singularities, and invariants I with dI/dt = 0 along the flow ({I, H} = 0 for a canonical system), to 30 digits near its
first orbit.
"""

from __future__ import annotations

import inspect
import re
import types
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from math import isfinite
from pathlib import Path
from typing import Any

import mpmath
import numpy as np

from phasebench.integrators.compile.lazy import sympy as sp
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.systems import deferred, formula
from phasebench.integrators.systems.constrained import ConstrainedHamiltonian
from phasebench.integrators.systems.hamiltonian import Hamiltonian, PartitionedSystem
from phasebench.integrators.systems.parts import SplitHamiltonian

from . import user_file
from .base import Orbit, Problem
from .index import PROBLEMS, real_parameters
from .kepler_found import with_kepler_part

DIGITS = 30
#: The largest dI/dt of an invariant, relative to the sum of its terms' sizes: its constants may be rounded to doubles.
KEPT = 1e-12
WRITE = "write q and p, q1, p1, q2, p2, ..., or names of your own and theirs with a p before: x, px, y, py"
#: Number and displacement of points near the first orbit's start: at it, a zero momentum may hide that I varies.
POINTS, AWAY = 3, 0.01


def from_file(path: str | Path, **parameters: float | str) -> Problem:
    """Make the problem that a user's Python file defines, and check it.

    The file defines a function ``make`` or a `Problem` named ``problem``; ``parameters`` are values of its parameters.
    If its id is that of a registered problem, the path replaces the id.  Raises InvalidInput for a file that cannot be
    read or raises (naming line and error), or a problem that breaks the contract.
    """
    module = user_file.load(str(path))
    make = getattr(module, "make", None)
    if make is None:
        problem, values = getattr(module, "problem", None), {}
        if problem is None:
            raise InvalidInput(f"{path} has no function 'make' that returns a Problem, and no 'problem = Problem(...)'")
        real_parameters(str(path), (), parameters)
    else:
        values = _values(module, make, str(path), parameters)
        with user_file.users_code(str(path), f"make({', '.join(f'{k}={v!r}' for k, v in values.items())})"):
            problem = make(**values)
    if not isinstance(problem, Problem):
        what = "what make returns is" if make else "problem is"
        hint = ": write Problem(id=..., name=..., source=..., system=it, orbits=...)"
        raise InvalidInput(f"{path}: {what} of type {type(problem).__name__}, no Problem{hint}")
    if problem.id in PROBLEMS:
        problem = replace(problem, id=str(path))
    return normalize(replace(problem, parameters=problem.parameters or values), str(path))


def from_formula(
    text: str,
    q: Sequence[float] | None,
    p: Sequence[float] | None,
    constants: Mapping[str, float] | None = None,
    id: str | None = None,
    constraints: Sequence[str] = (),
    parts: Sequence[str] = (),
) -> Problem:
    """Make the problem of a Hamiltonian that is typed as text, in q and p, in q1 .. qd and p1 .. pd, or in x, px, ...

    Parameters
    ----------
    text : the formula of H, as `systems.formula.parse` reads it
    q, p : d numbers each, the initial state; of x, px, y, py, ... in alphabetical order
    constants : values of the other names in the formula, taken as exact doubles
    id : the problem's name; by default the formula
    constraints : formulae or equations of constraints g(q) = 0; the system is a `ConstrainedHamiltonian` then
    parts : formulae of parts with exact flows, whose sum is H; the system is a `SplitHamiltonian` then

    Raises InvalidInput for a formula, constants or an initial state that do not fit one another.
    """
    constants = real_parameters("the formula", constants or {}, constants or {})
    names = sorted(
        {x for part in (text, *constraints, *parts) for side in part.split("=") for x in formula.names(side)}
    )
    coordinates, momenta = _variables(names, constants)
    d, variables = len(coordinates), [*coordinates, *momenta]
    for name in constants:
        if name in variables:
            option = "--q" if name in coordinates else "--p"
            raise InvalidInput(f"'{name}' is a variable of the formula: its initial value is given by {option}")
        if name not in names or name in formula.FUNCTIONS:
            raise InvalidInput(f"the formula has no constant '{name}'")
    known = {*variables, *constants, *formula.CONSTANTS, *formula.FUNCTIONS}
    missing = [x for x in names if x not in known]
    if "t" in missing and (constraints or parts):
        raise InvalidInput(formula.time_hint(d + 1))
    missing = [x for x in missing if x != "t"]
    if missing:
        raise InvalidInput(
            f"the formula has {', '.join(missing)} besides the variables {', '.join(variables)}: "
            f"give a constant its value, --set {missing[0]}=2"
        )
    for name, value in (("q", q), ("p", p)):
        if value is None:
            example = ",".join(["0.5"] * d)
            raise InvalidInput(f"a formula has no initial data: give them, --{name} {example}")
        if len(value) != d:
            raise InvalidInput(f"--{name} has {len(value)} components; the formula has d = {d}: {', '.join(variables)}")
    orbit = Orbit("start", *(_state(Orbit("start", q, p), name, d, "the formula") for name in "qp"))
    start = orbit.q if d > 1 else ()
    if constraints and parts:
        raise InvalidInput("constraints and parts are given; a system has the one or the other")
    bound, parts = tuple(constraints), tuple(parts)
    more = [bound] if bound else [parts, "parts"] if parts else []
    key = deferred.key_of("formula", text, variables, sorted(constants.items()), start, *more)
    system = deferred.system(key, partial(_of_formula, text, variables, constants, start, bound, parts))
    name = id or text.strip()
    problem = Problem(name, "a formula", "the command line", system, (orbit,), parameters=constants)
    _check_start(system, problem.orbits[0], "the formula", "--q={} --p={}")
    return problem


def _of_formula(
    text: str,
    names: Sequence[str],
    constants: Mapping[str, float],
    start: tuple[float, ...],
    constraints: Sequence[str] = (),
    parts: Sequence[str] = (),
) -> PartitionedSystem:
    """Make the system of a formula of H in the variables ``names``, first all q, then all p."""
    variables = {name: sp.Symbol(name, real=True) for name in names}
    known = variables | {k: sp.Rational(v) for k, v in constants.items()}
    H = formula.parse(text, {"t": sp.Symbol("t", real=True)} | known)
    symbols, d = list(variables.values()), len(names) // 2
    if constraints:
        bound = [formula.parse_equation(g, known) for g in constraints]
        return ConstrainedHamiltonian(q=symbols[:d], p=symbols[d:], H=H, constraints=bound)
    if parts:
        given = [formula.parse(part, known) for part in parts]
        return SplitHamiltonian(q=symbols[:d], p=symbols[d:], parts=given, H=H)
    return with_kepler_part(Hamiltonian(q=symbols[:d], p=symbols[d:], H=H), start)


def _variables(names: Sequence[str], constants: Iterable[str]) -> tuple[list[str], list[str]]:
    """Return the coordinates and momenta among the names in a formula: q and p, q1 .. qd and p1 .. pd, or x and px."""
    other = {*constants, *formula.CONSTANTS, *formula.FUNCTIONS}
    own = {*names} - other
    momenta = [x for x in own if re.fullmatch(r"p[A-Za-z]\w*", x) and f"p{x}" not in own and x[1:] not in other]
    numbered = {int(m[1]) for m in (re.fullmatch(r"[qp]([1-9]\d{0,3})", n) for n in names) if m}
    plain = [n for n in names if n in ("q", "p")]
    if plain and numbered:
        raise InvalidInput(f"the formula has {plain[0]} and numbered variables; {WRITE}")
    if plain:
        return ["q"], ["p"]
    if not numbered and any(x[1:] in own for x in momenta):
        return sorted(x[1:] for x in momenta), sorted(momenta)
    if not numbered:
        raise InvalidInput(f"the formula has no variable: {WRITE}")
    gaps = sorted(set(range(1, max(numbered))) - numbered)
    if gaps:
        raise InvalidInput(
            f"the formula has q{max(numbered)} or p{max(numbered)}, but neither q{gaps[0]} nor p{gaps[0]}"
        )
    numbers = range(1, max(numbered) + 1)
    return [f"q{i}" for i in numbers], [f"p{i}" for i in numbers]


# -- files -------------------------------------------------------------------------------------------------------------


def _like(default: object, value: float) -> float:
    """Return a parameter's value, as an int if it is whole and its default is an int: 4 instead of 4.0."""
    whole = isinstance(default, int) and isinstance(value, float) and value.is_integer()
    return int(value) if whole else value


def _values(module: types.ModuleType, make: Any, path: str, parameters: Mapping[str, float]) -> dict[str, float]:
    """Return name -> value of a problem file's parameters: those given, else from PARAMETERS or ``make``'s defaults."""
    if not callable(make):
        raise InvalidInput(f"{path}: make is a {type(make).__name__}, no function")
    stated = inspect.signature(make).parameters.values()
    named = [a for a in stated if a.kind in (a.POSITIONAL_OR_KEYWORD, a.KEYWORD_ONLY)]
    values = {a.name: a.default for a in named if a.default is not a.empty}
    own = getattr(module, "PARAMETERS", {})
    if not isinstance(own, Mapping):
        raise InvalidInput(f"{path}: PARAMETERS is a {type(own).__name__}; write PARAMETERS = {{'k': 2.0}}")
    values |= own
    given = {name: _like(values.get(name), value) for name, value in parameters.items()}
    values = real_parameters(path, {a.name for a in named} | set(values), {**values, **given})
    for a in named:
        if a.name not in values:
            raise InvalidInput(f"{path}: make needs a value of {a.name}: write it in PARAMETERS, or --set {a.name}=2")
    return values


# -- the contract of a problem -----------------------------------------------------------------------------------------


def normalize(problem: Problem, where: str) -> Problem:
    """Check a user's problem, and return it with initial data as doubles and invariants as expressions.

    Raises InvalidInput, naming ``where``, for a problem without an energy, with malformed or non-finite initial data,
    or with an invariant that is not conserved.
    """
    system = problem.system
    if not isinstance(system, PartitionedSystem):
        raise InvalidInput(
            f"{where}: system is a {type(system).__name__}; write system=Hamiltonian(q=..., p=..., H=...)"
        )
    if not system.has_energy:
        raise InvalidInput(f"{where}: the system has no energy: give PartitionedSystem(..., energy=...) an invariant")
    if not isinstance(problem.invariants, Mapping):
        raise InvalidInput(
            f"{where}: invariants is a {type(problem.invariants).__name__}; write {{'name': expression}}"
        )
    orbits = (problem.orbits,) if isinstance(problem.orbits, Orbit) else tuple(problem.orbits)
    if not orbits or not all(isinstance(o, Orbit) for o in orbits):
        raise InvalidInput(f"{where}: orbits is {problem.orbits!r}; write orbits=(Orbit('start', (1.0,), (0.0,)),)")
    if len({o.name for o in orbits}) < len(orbits):
        raise InvalidInput(f"{where}: two orbits have one name")
    orbits = tuple(replace(o, q=_state(o, "q", system.d, where), p=_state(o, "p", system.d, where)) for o in orbits)
    for o in orbits:
        _check_start(system, o, where if len(orbits) == 1 else f"{where}, orbit {o.name}")
    invariants = {}
    for name, e in problem.invariants.items():
        try:
            invariants[name] = system._formula(e)
        except (InvalidInput, sp.SympifyError, TypeError) as error:
            hint = "; make its symbols with real=True, as the system's are, or write it as text"
            raise InvalidInput(f"{where}: the invariant '{name}': {error}{hint}") from None
    kept = {f"the invariant '{name}'": e for name, e in invariants.items()}
    kept |= {f"invariant {i} of the system": e for i, e in enumerate(system.invariants, 1)}
    if not system.canonical:
        kept["the energy"] = system.H
    for name, e in kept.items():
        _check_kept(system, e, orbits[0], f"{where}: {name}")
    system = with_kepler_part(system, orbits[0].q)
    return replace(problem, system=system, orbits=orbits, invariants=invariants)


def _state(orbit: Orbit, name: str, d: int, where: str) -> tuple[float, ...]:
    """Return the initial q or p (``name``) of an orbit as a tuple of d floats; raise InvalidInput unless finite."""
    given = getattr(orbit, name)
    try:
        value = tuple(float(x) for x in np.atleast_1d(given))
    except (TypeError, ValueError, OverflowError):
        value = ()
    if len(value) != d or not all(map(isfinite, value)):
        raise InvalidInput(f"{where}: {name} of orbit '{orbit.name}' is {given!r}; it must be {d} finite numbers")
    return value


def _check_start(system: PartitionedSystem, orbit: Orbit, where: str, paste: str = "q={}, p={}") -> None:
    """Refuse a start where H or the field is not finite, at a singularity, or off constraints."""
    q, p = np.array([orbit.q]), np.array([orbit.p])
    if system.constrained:
        try:
            system.check_start(q[0], p[0], paste)
        except InvalidInput as error:
            raise InvalidInput(f"{where}: {error}") from None
    energy = system.energies(q, p)[0]
    if system.loops and not isinstance(system.H, sp.Basic):  # loops without a formula
        rates = system.vector_field()(0.0, np.concatenate([q[0], p[0]]))
        if not (isfinite(energy) and np.isfinite(rates).all()):
            raise InvalidInput(f"{where}: the loops give no finite numbers at the start")
        return _check_distances(system, q, p, where)
    rates = system.rates(q, p)[:, 0]
    if not isfinite(energy) or not np.isfinite(rates).all():
        names = ["the energy", *(f"d{x}/dt" for x in (*system.q, *system.p))]
        for name, value in zip(names, (energy, *rates), strict=True):
            if isfinite(value):
                continue
            raise InvalidInput(f"{where}: {name} is {value} at the start: it is at a singularity or outside H's domain")
    _check_distances(system, q, p, where)


def _check_distances(system: PartitionedSystem, q: np.ndarray, p: np.ndarray, where: str) -> None:
    for i, distance in enumerate(system.distances(q, p)[:, 0] if system.singularities else (), 1):
        if not distance != 0 or not isfinite(distance):
            raise InvalidInput(
                f"{where}: the distance {i} of 'singular' is {distance} at the start: it is at a singularity"
            )


def _check_kept(system: PartitionedSystem, expression: sp.Expr, orbit: Orbit, what: str) -> None:
    """Raise InvalidInput if an expression I is no invariant: dI/dt along the flow is not zero at or near the start."""
    variables, sides = (*system.q, *system.p), system.sides
    steps = list(system.definitions)
    if not expression.free_symbols:
        raise InvalidInput(f"{what} is the constant {expression}")
    rates = [expression.diff(x) * dx for x, dx in zip(variables, sides, strict=True)]
    rng = np.random.default_rng(0)
    with mpmath.workdps(DIGITS):
        f = sp.lambdify([variables], [expression, *rates], "mpmath", cse=(lambda e: (steps, e)) if steps else True)
        start = [mpmath.mpf(x) for x in (*orbit.q, *orbit.p)]
        for n in range(POINTS):
            moved = (
                start
                if n == 0
                else [
                    x + AWAY * (1 + abs(x)) * float(u)
                    for x, u in zip(start, rng.uniform(-1, 1, len(start)), strict=True)
                ]
            )
            if system.constrained and n:
                near = np.array(moved, float)
                moved = [mpmath.mpf(x) for x in np.concatenate(system.retract(near[: system.d], near[system.d :]))]
            try:
                value, *terms = f(moved)
                good = all(mpmath.isfinite(x) and mpmath.im(x) == 0 for x in (value, *terms))
            except (ArithmeticError, ValueError, TypeError, NameError):
                good = False
            if not good:
                if n == 0:
                    raise InvalidInput(f"{what} or its slope is not finite at the start")
                continue
            rate, size = mpmath.fsum(terms), mpmath.fsum(terms, absolute=True)
            if abs(rate) > KEPT * size:
                state = ", ".join(f"{x} = {float(y):.6g}" for x, y in zip(variables, moved, strict=True))
                raise InvalidInput(
                    f"{what} is not conserved: d/dt of {expression} is {float(rate):.6g} along the flow at {state}"
                )
