"""`Cell`: one independent measurement, the key that identifies its rows, and the hash of what they depend on."""

from __future__ import annotations

import hashlib
import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, is_dataclass
from fractions import Fraction
from functools import cache
from typing import Any

import mpmath

from phasebench.benchmarks.problems import PROBLEMS
from phasebench.integrators.compile import digest
from phasebench.integrators.record import Method
from phasebench.reference.certificates import stored
from phasebench.reference.installed import version_of

#: Where a cell is measured: on all cores; on all cores, without Numba; alone on the machine, because it is timed.
POOL, UNCOMPILED, ALONE = "pool", "uncompiled", "alone"


class Unavailable(RuntimeError):
    """Raised if a cell (one measurement) needs something that is not on this machine; the message names it."""


Rows = dict[str, list[dict[str, Any]]]


@dataclass(frozen=True)
class Cell:
    """One independent measurement, which gives rows of one or more tables.

    Attributes
    ----------
    experiment, tables : the id of the study to which it belongs, and the names of the tables that contain its rows
    key : column -> value; identifies its rows among those of all cells in its tables
    measure, arguments : a module-level function and its arguments (both are sent to other processes)
    content : the hashes of the data, the code and the packages on which the rows depend (`content`)
    names : names by which a user may select it: ids of methods, peers, problems and scenes
    where : `POOL`, `UNCOMPILED` or `ALONE`
    own : True if its rows are times, which depend on the machine and do not become stale when code changes
    dear : True if it is measured on request because it is one of many or takes long
    quick : True if it belongs to the few cells of a quick run of about a minute
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
    dear: bool = False

    @property
    def id(self) -> str:
        """The unique id of the cell: its first table and its key."""
        return "|".join([self.tables[0], *(f"{k}={text(v)}" for k, v in self.key.items())])

    @property
    def label(self) -> str:
        """The values of the cell's key as text, for messages."""
        return ", ".join(text(v) for v in self.key.values()) or self.tables[0]

    @property
    def available(self) -> bool:
        """True if all packages on which the rows depend are installed."""
        return not self.content.endswith(SEPARATOR)

    def outdated(self, content: str) -> bool:
        """True if rows with this hash were measured with other data or, unless they are times, with other code."""
        parts = 1 if self.own else 2
        return content.split(SEPARATOR)[:parts] != self.content.split(SEPARATOR)[:parts]

    def __call__(self) -> Rows:
        """Make the measurement and return its rows, by table."""
        return self.measure(*self.arguments)


def text(value: Any) -> str:
    """A value as text in the tables: doubles by their shortest digits, "" for None and NaN."""
    if value is None or value != value:
        return ""
    if hasattr(value, "item"):  # a scalar of NumPy
        value = value.item()
    return repr(value) if isinstance(value, float) else str(value)


def exact(value: Any) -> str:
    """Convert data to a text, for hashing; two texts are equal if and only if the data are equal.

    Raises TypeError for an object of unknown type.
    """
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
    if isinstance(value, (Fraction, int, float, str, bytes, type(None))):
        return repr(value)
    raise TypeError(f"a row cannot depend on {value!r}: no text tells it from other objects of {type(value)}")


#: Attributes of a method's record that its rows depend on.
RECORD = ("id", "family", "order", "symmetric", "symplectic", "energy", "quadratic", "requires", "parameters", "data")


#: id of a method in memory -> (the method, its text), which takes long to write.
_records: dict[int, tuple[Method, str]] = {}


def record(method: Method) -> str:
    """Return a text, for hashing, of the entries of a `Method` on which results depend: not its name and citations."""
    if id(method) not in _records:
        _records[id(method)] = method, "method" + exact(tuple(getattr(method, name) for name in RECORD))
    return _records[id(method)][1]


#: Packages that compile and run all code here.
COMPILERS = ("numba", "llvmlite", "numpy")
#: The folder of the modules of peers, and of files that list them.
PEERS = digest.ROOT / "reference" / "peers"
#: Stands between the hashes of a cell's content.
SEPARATOR = "-"


@dataclass(frozen=True)
class Package:
    """Stands for the installed version of a package among the parts of `content`."""

    package: str


def content(*parts: object, code: Iterable[str] = ()) -> str:
    """The hashes of all that a measurement depends on, "data-code-packages"; the last is empty if a package is missing.

    ``parts`` are data; methods, peers and problems among them stand for their records, the modules that define them and
    the versions of their packages.  ``code`` are names of further modules, which count with all their imports.
    """
    modules, listed = list(code), ""
    packages = {*COMPILERS}
    pieces = []
    for part in parts:
        if hasattr(part, "family"):
            pieces.append(record(part))
            modules += [*digest.families(part), "phasebench.integrators.driver"]
        elif hasattr(part, "package") and hasattr(part, "claims"):
            pieces.append(exact((part.id, part.package, part.adaptive, part.order, part.tol, part.least)))
            modules += [f"phasebench.reference.peers.{m}" for m in ("run", "record", part.package)]
            listed += _listed(part.package)
            packages.add(part.package)
        elif isinstance(part, ProblemKey):
            pieces.append(exact((part.name, part.parameters)))
            modules.append(part.module)
        elif isinstance(part, Package):
            packages.add(part.package)
        else:
            pieces.append(exact(part))
    versions = [version_of(name) for name in sorted(packages)]
    told = "" if None in versions else _hash(exact([*zip(sorted(packages), versions, strict=True)]), 6)
    made_by = _digest(tuple(sorted(set(modules))))
    made_by = _hash(made_by + listed, 10) if listed else made_by[:10]
    return SEPARATOR.join([_hash("|".join(pieces), 10), made_by, told])


def _hash(text: str, digits: int) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:digits]


@dataclass(frozen=True)
class ProblemKey:
    """Identifies a problem without building it: its name, as "henon-heiles:box" with the orbit, and its parameters."""

    name: str
    parameters: tuple[tuple[str, object], ...] = ()

    @property
    def id(self) -> str:
        """The problem's name without the orbit."""
        return self.name.partition(":")[0]

    @property
    def module(self) -> str:
        """The module that builds the problem."""
        return f"phasebench.benchmarks.problems.{PROBLEMS[self.id][0]}"


@cache
def states(id: str) -> str:
    """The digest of the file of certified states of the problem ``id``; "" if there is none."""
    path = stored.DIRECTORY / f"{id}.json"
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.exists() else ""


@cache
def _listed(package: str) -> str:
    path = PEERS / f"{package}.toml"
    return _hash(exact(tomllib.loads(path.read_text(encoding="utf-8"))), 10) if path.exists() else ""


@cache
def _digest(modules: tuple[str, ...]) -> str:
    return digest.digest(m for m in modules if m)
