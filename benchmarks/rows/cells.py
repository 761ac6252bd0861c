"""A cell: one independent measurement, what its rows are found by, and the hash of what they depend on."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, is_dataclass
from fractions import Fraction
from functools import cache
from typing import Any

import mpmath

from phasebench.benchmarks.problems import PROBLEMS
from phasebench.reference.certificates import stored

from . import sources

#: Where a cell is measured: on all cores, on all cores without compiling, or with nothing beside it (it is timed).
POOL, UNCOMPILED, ALONE = "pool", "uncompiled", "alone"


class Unavailable(RuntimeError):
    """What a cell needs is not on this machine; the message says what."""


Rows = dict[str, list[dict[str, Any]]]


@dataclass(frozen=True)
class Cell:
    """One independent measurement.

    Attributes
    ----------
    experiment : the folder of the question that it belongs to
    tables : the tables that its rows are in
    key : columns with their values, by which its rows are told from those of every other cell in its tables
    measure, arguments : a function of a module and what it is called with (they travel to other processes); it returns
        table -> rows
    content : the hash of what the rows depend on
    names : what a user may ask for it by: ids of methods, peers, problems and scenes
    where : `POOL`, `UNCOMPILED` or `ALONE`
    own : whether its rows are of the machine as much as of the code
    quick : whether it is one of the handful that shows the whole way in a minute
    """

    experiment: str
    tables: tuple[str, ...]
    key: Mapping[str, object]
    measure: Callable[..., Rows]
    arguments: tuple
    content: str
    names: frozenset[str] = field(default_factory=frozenset)
    where: str = POOL
    own: bool = False
    quick: bool = False

    @property
    def id(self) -> str:
        """What tells it from every other cell."""
        return "|".join([self.tables[0], *(f"{k}={text(v)}" for k, v in self.key.items())])

    @property
    def label(self) -> str:
        """Its key for a person."""
        return ", ".join(text(v) for v in self.key.values()) or self.tables[0]

    def __call__(self) -> Rows:
        """Measure it."""
        return self.measure(*self.arguments)


def text(value) -> str:
    """A value as the tables hold it: doubles by their shortest digits, nothing for what is missing."""
    if value is None or value != value:
        return ""
    if hasattr(value, "item"):  # a scalar of NumPy
        value = value.item()
    return repr(value) if isinstance(value, float) else str(value)


def exact(value) -> str:
    """A text that is the same for equal data alone, whatever the working precision."""
    if isinstance(value, mpmath.mpf):
        return "mpf" + repr(tuple(int(part) for part in value._mpf_))
    if isinstance(value, Mapping):
        return "{" + ",".join(f"{exact(k)}:{exact(v)}" for k, v in value.items()) + "}"
    if isinstance(value, (tuple, list)):
        return "(" + ",".join(map(exact, value)) + ")"
    if is_dataclass(value) and hasattr(value, "family"):
        return record(value)
    if callable(value):
        name = getattr(value, "__qualname__", repr(type(value)))
        known = getattr(getattr(value, "__self__", None), "__module__", "") or getattr(value, "__module__", "")
        return f"{known}.{name}:{getattr(value, '__name__', '')}"
    if isinstance(value, (Fraction, int, float, str, type(None))):
        return repr(value)
    return repr(value)


#: What of a method's record its rows depend on.
RECORD = ("id", "family", "order", "symmetric", "symplectic", "energy", "quadratic", "requires", "parameters", "data")


def record(method) -> str:
    """What a `Method` is, without its prose."""
    return "method" + exact(tuple(getattr(method, name) for name in RECORD))


def content(*parts: object, code: Iterable[str] = ()) -> str:
    """The hash of data (methods and peers by what they are) and of the ``code``'s modules with all that they import."""
    modules = list(code)
    pieces = []
    for part in parts:
        if hasattr(part, "family"):
            pieces.append(record(part))
            modules += _families(part)
        elif hasattr(part, "package") and hasattr(part, "claims"):
            pieces.append(exact((part.id, part.package, part.adaptive, part.order, part.tol, part.least)))
            modules += [f"phasebench.reference.peers.{m}" for m in ("run", "record", part.package)]
        elif isinstance(part, Problem):
            pieces.append(exact((part.name, part.parameters)))
            modules.append(part.module)
        else:
            pieces.append(exact(part))
    return hashlib.sha256("|".join([*pieces, _digest(tuple(sorted(set(modules))))]).encode()).hexdigest()[:16]


@dataclass(frozen=True)
class Problem:
    """A problem that need not be made to know what its rows depend on: its name with its orbit, and its parameters."""

    name: str
    parameters: tuple[tuple[str, object], ...] = ()

    @property
    def id(self) -> str:
        """Its name without the orbit."""
        return self.name.partition(":")[0]

    @property
    def module(self) -> str:
        """The module that makes it."""
        return f"phasebench.benchmarks.problems.{PROBLEMS[self.id][0]}"


@cache
def states(id: str) -> str:
    """The digest of the certified states of a problem; empty where it has none."""
    path = stored.DIRECTORY / f"{id}.json"
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.exists() else ""


@cache
def _digest(modules: tuple[str, ...]) -> str:
    return sources.digest(m for m in modules if m)


def _families(method) -> list[str]:
    """The modules of a method's kernel, and of the methods that it is built on."""
    modules = [f"phasebench.integrators.families.{method.family}", "phasebench.integrators.driver"]
    modules += [f for part in method.data if hasattr(part, "family") for f in _families(part)]
    modules += [part.__module__ for part in method.data if callable(part) and hasattr(part, "__module__")]
    return [m for m in modules if m.startswith("phasebench")]
