"""`Subject`: the integrator to be certified (step, adaptive run or coefficients), found by path, name or object."""

from __future__ import annotations

import importlib
import inspect
import re
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from phasebench.benchmarks.judge.evidence import EPS
from phasebench.benchmarks.measure import coefficients, own_step
from phasebench.benchmarks.measure.integrator import Integrator, integrator
from phasebench.benchmarks.measure.own_step import OwnStep, System
from phasebench.benchmarks.problems import user_file
from phasebench.integrators.errors import InvalidInput, unknown_name
from phasebench.integrators.names import unknown_method
from phasebench.integrators.prepared import prepare
from phasebench.integrators.record import Method
from phasebench.integrators.registry import BY_ID as METHODS
from phasebench.integrators.systems.hamiltonian import PartitionedSystem
from phasebench.integrators.values.kinds import Number
from phasebench.reference.peers import BY_ID as PEERS
from phasebench.reference.peers import Peer

from . import battery

if TYPE_CHECKING:
    from .stepping import Exact

NAMED = re.compile(r"^[A-Za-z_][\w.]*:[A-Za-z_][\w.]*$")


@dataclass(frozen=True)
class Subject:
    """An integrator to be certified.

    Attributes
    ----------
    own : the step with its claims and the traits that a system must have
    run : (system, q, p, t_end, tol) -> (q, p), the run of an adaptive integrator, which has no step
    integrator : the registered method or peer, if it is one
    eps : the rounding of its arithmetic, relative to the state; that of doubles unless it is found to be coarser
    """

    own: OwnStep
    run: Callable[..., tuple[Any, Any]] | None = None
    integrator: Integrator | None = None
    eps: float = EPS

    @property
    def id(self) -> str:
        """The integrator's name, or the path of its file."""
        return self.own.id

    @property
    def adaptive(self) -> bool:
        """True if the integrator takes a tolerance in place of a step."""
        return self.run is not None

    def lacks(self, system: PartitionedSystem) -> str | None:
        """Why the integrator cannot run on a system, or None if it can."""
        return self.own.lacks(system) or (self.integrator.lacks(system) if self.integrator else None)


def subject(
    target: str | Path | Callable[..., Any] | Mapping[str, Any] | Method | Peer | Integrator | OwnStep | Subject,
    claims: Mapping[str, Any] | None = None,
    requires: tuple[str, ...] = (),
) -> Subject:
    """The integrator that a target of `validate` names, with claims and requirements added to its own.

    Raises InvalidInput for a target that cannot be found, read or called, and for an unknown claim or trait.
    """
    made = _build(target)
    own = made.own
    stated = {**own.claims, **own_step.checked_claims(claims or {}, "what is claimed")}
    wanted = tuple(dict.fromkeys((*own.requires, *requires)))
    traits = battery.oscillator().system.traits
    for trait in wanted:
        if trait not in traits:
            raise unknown_name("trait of systems", str(trait), traits)
    return replace(made, own=replace(own, claims=stated, requires=wanted))


def _build(
    target: str | Path | Callable[..., Any] | Mapping[str, Any] | Method | Peer | Integrator | OwnStep | Subject,
) -> Subject:
    if isinstance(target, (str, Path)):
        return _find(str(target))
    if isinstance(target, Subject):
        return target
    if isinstance(target, OwnStep):
        return Subject(target)
    if isinstance(target, Mapping):
        return Subject(coefficients.own_step(target, "coefficients"))
    if isinstance(target, (Method, Peer, Integrator)):
        return _of_registered(integrator(target))
    if callable(target):
        return _of_function(target)
    raise InvalidInput(f"the integrator is {target!r}; give a path, package.module:callable, a step, or coefficients")


def _find(name: str) -> Subject:
    if name.lower().endswith(".json"):
        return Subject(coefficients.from_file(name))
    if NAMED.match(name) and not user_file.is_file(name):
        return _import_object(name)
    if name in METHODS or name in PEERS:
        return _of_registered(integrator(name))
    if not user_file.is_file(name):
        hint = "write ./mine.py, ./mine.json or package.module:callable"
        if Path(f"{name}.py").is_file():
            raise InvalidInput(f"there is no integrator '{name}'; did you mean ./{name}.py?")
        raise InvalidInput(f"{unknown_method(name, [*METHODS, *PEERS], 'integrator')}; {hint}")
    file, dotted = user_file.file_and_object(name)
    if not dotted:
        module = user_file.load(file, "method")
        dotted = "run" if callable(getattr(module, "run", None)) and not hasattr(module, "step") else ""
    if dotted.split(".")[-1] == "run":
        owner, run = own_step.find_step(f"{file}:{dotted}", "run")
        _binds(run, ("system", "q", "p", "t_end", "tol"), name)
        return Subject(own_step.build_own_step(name, owner, run), run)
    return Subject(own_step.from_file(name))


def _import_object(name: str) -> Subject:
    owner, found = imported(name)
    return replace(_of_function(found), own=own_step.build_own_step(name, owner, found))


def imported(name: str) -> tuple[Any, Callable]:
    """Import ``package.module:name``, also from the working folder as with `python -m`: (who has its claims, it).

    Raises InvalidInput if it cannot be imported or called.
    """
    home, _, path = name.partition(":")
    here = str(Path.cwd())
    added = here not in sys.path and "" not in sys.path
    if added:
        sys.path.insert(0, here)
    try:
        with user_file.users_code(home, f"importing {home}"):
            owner = found = importlib.import_module(home)
            for part in path.split("."):
                found = getattr(found, part)
                if any(hasattr(found, says) for says in ("CLAIMS", "REQUIRES")):
                    owner = found
    finally:
        if added:
            sys.path.remove(here)
    if not callable(found):
        raise InvalidInput(f"{name} is a {type(found).__name__}, which cannot be called")
    return owner, found


def _of_function(function: Callable) -> Subject:
    try:
        names = list(inspect.signature(function).parameters)
    except (TypeError, ValueError):
        names = []
    # A tolerance of a step's own solver has a default; that of a run is passed.
    if "tol" not in names or ("t_end" not in names and _takes(function, ("system", "q", "p", "h"))):
        return Subject(own_step.from_function(function))
    where = getattr(getattr(function, "__code__", None), "co_filename", "the run")
    _binds(function, ("system", "q", "p", "t_end", "tol"), where)
    return Subject(OwnStep(getattr(function, "__name__", "run"), function, where=where), function)


def _takes(function: Callable, names: tuple[str, ...]) -> bool:
    try:
        inspect.signature(function).bind(*names)
    except (TypeError, ValueError):
        return False
    return True


def _binds(function: Callable, names: tuple[str, ...], where: str) -> None:
    try:
        inspect.signature(function).bind(*names)
    except (TypeError, ValueError) as error:
        called = f"{getattr(function, '__name__', 'run')}({', '.join(names)})"
        raise InvalidInput(f"{where}: it is called as {called}: {error}") from None


def _of_registered(chosen: Integrator) -> Subject:
    """The subject of a registered method or peer, called one step at a time, in doubles."""

    prepared: dict = {}

    def step(system: System | Exact, q: np.ndarray, p: np.ndarray, h: Number) -> tuple[np.ndarray, np.ndarray]:
        if system.whole.constrained and isinstance(chosen.record, Method):  # measures call it beside the constraints
            if system.whole not in prepared:
                prepared[system.whole] = prepare(system.whole, chosen.record, q0=q, p0=p)
            q, p, status = prepared[system.whole](h, 1, q, p)
            if status != "ok":
                raise ArithmeticError(status)
            return q, p
        end = chosen.run(system.whole, h=h, steps=1, q0=q, p0=p, save_every=0)
        if end.status != "ok":
            raise ArithmeticError(f"{end.status}: {end.reason}")
        return end.q[-1], end.p[-1]

    def run(system: System, q: np.ndarray, p: np.ndarray, t_end: float, tol: float) -> tuple[np.ndarray, np.ndarray]:
        end = chosen.run(system.whole, t_end=t_end, tol=max(tol, chosen.record.least), q0=q, p0=p, save_every=0)
        return end.q[-1], end.p[-1]

    adaptive = chosen.adaptive
    requires = tuple(getattr(chosen.record, "requires", ()))
    stated = {name: getattr(chosen.claims, name) for name in ("order", "symplectic", "reversible", "energy")}
    claims = {name: value for name, value in stated.items() if value is not None}
    own = OwnStep(chosen.label, run if adaptive else step, claims, requires)
    return Subject(own, run if adaptive else None, chosen)
