"""Store certified states of orbits with their uncertainty: one JSON file per problem, verified at every reading.

A state is the quadruple-precision run of `taylor` as decimal strings.  Its uncertainty, the horizon and the
comparisons with other solvers come from `make`; nothing is integrated here.  A file is tied to its problem by the
initial doubles, the parameters and a fingerprint: 20 digits of the energy (and of the vector field, if the system is
not canonical) at a state near the initial one, which do not depend on how a formula is written.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import os
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from decimal import Decimal, InvalidOperation, localcontext
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from phasebench.integrators.errors import InvalidInput
from phasebench.reference.files import write_file

DIRECTORY = Path(__file__).with_name("states")
FORMAT = 2
#: Significant digits of a stored component: the full quadruple precision.
DIGITS = 34
#: Digits of a fingerprint, and working digits for its evaluation.
PRINT, WORK = 20, 50
#: Largest uncertainty of a comparing solver, relative to the state's size; with a larger one it would agree with any
#: orbit of that size.
TELLING = 0.01


@dataclass(frozen=True)
class Check:
    """Comparison of the state of an orbit at one time with that of another solver.

    Attributes
    ----------
    solver : the other solver's name
    distance : max norm over (q, p) of its state minus that of the high-precision run, the largest up to this time
    uncertainty : the error of the other solver, estimated from two step sizes or tolerances and its round-off
    """

    solver: str
    distance: float
    uncertainty: float


@dataclass(frozen=True)
class End:
    """A certified state of an orbit at one time: digits and a bound of their error.  Errors are max norms over (q, p).

    Attributes
    ----------
    t : the time
    q_text, p_text : d decimal strings each, from the quadruple-precision run
    uncertainty : a bound of the strings' error at this and at earlier stored times (`make`)
    long_double : the largest error so far of a run in long double, which is the uncertainty of a `taylor.Reference`
    energy : the change of the energy since the start, relative to the sum of the absolute terms of H, computed with 50
        digits
    checks : the comparisons with other solvers
    """

    t: float
    q_text: tuple[str, ...]
    p_text: tuple[str, ...]
    uncertainty: float
    long_double: float
    energy: float
    checks: tuple[Check, ...] = ()

    @property
    def q(self) -> np.ndarray:
        """The coordinates, array (d,), rounded to double."""
        return np.array([float(x) for x in self.q_text])

    @property
    def p(self) -> np.ndarray:
        """The momenta, array (d,), rounded to double."""
        return np.array([float(x) for x in self.p_text])

    @property
    def texts(self) -> tuple[str, ...]:
        """(q, p) as 2 d decimal strings."""
        return self.q_text + self.p_text

    @property
    def size(self) -> float:
        """The max norm of (q, p)."""
        return max(abs(float(x)) for x in self.texts)

    def compares(self, check: Check) -> bool:
        """True if a solver's uncertainty is small enough for a comparison: at most `TELLING` of the state's size."""
        return check.uncertainty <= TELLING * self.size

    def agrees(self, check: Check) -> bool:
        """True if the comparison is valid and the distance is within the solver's plus the state's uncertainty."""
        return self.compares(check) and check.distance <= check.uncertainty + self.uncertainty

    def format(self, check: Check) -> str:
        """A comparison in words."""
        text = f"{check.solver}: {check.distance:.2g} (own {check.uncertainty:.2g})"
        return text if self.compares(check) else f"{text}, no comparison"

    @property
    def agree(self) -> bool:
        """True if there is a valid comparison with another solver, and all of them agree."""
        compared = [c for c in self.checks if self.compares(c)]
        return bool(compared) and all(self.agrees(c) for c in compared)


@dataclass(frozen=True)
class Certificate:
    """The certified states of an orbit, and how long the orbit can be followed.

    Attributes
    ----------
    problem, orbit, parameters : the problem's label, its orbit's name, its parameters
    q0, p0 : the initial doubles
    fingerprint : text that identifies the problem's formulae (`fingerprint`)
    t_end : the last time
    limit : the error relative to the state's max norm that defines the horizons
    bits : mantissa bits of the run that measured the digits' error
    horizon : the time up to which rounding to long double stays within the limit, in the median of seeded draws, on a
        grid of spacing ``spacing`` (see the module `horizon`)
    earliest, latest : 95 of 100 runs in long double leave the limit between these times
    growth : the exponent k with which the distance of neighbouring trajectories grows as t^k over the later part of the
        span
    rate : if they separate exponentially, the rate in 1 / time, else None
    ends : the states, by time
    """

    problem: str
    orbit: str
    parameters: dict[str, float]
    q0: tuple[float, ...]
    p0: tuple[float, ...]
    fingerprint: str
    t_end: float
    limit: float
    bits: int
    spacing: float
    horizon: float
    earliest: float
    latest: float
    growth: float
    rate: float | None
    ends: tuple[End, ...]

    def at(self, t: float) -> End | None:
        """The stored state at exactly the time t, or None if none is stored there."""
        return next((e for e in self.ends if e.t == t), None)

    @property
    def digits_horizon(self) -> float:
        """The last stored time up to which the digits' uncertainties are within the limit; 0 if there is none."""
        good = [e.t for e in itertools.takewhile(lambda e: e.uncertainty <= self.limit * e.size, self.ends)]
        return good[-1] if good else 0.0


# -- the fingerprint of a problem ---------------------------------------------------------------------------------


def evaluate(problem: Any, expressions: Sequence, q: Sequence, p: Sequence) -> list:
    """The values of expressions at a state (doubles or decimal strings), in mpmath's working precision.

    The expressions may refer to the system's intermediate results.
    """
    import mpmath
    import sympy as sp

    from phasebench.integrators.compile.printing import share

    system = problem.system
    names = [*system.q, *system.p]
    values = [mpmath.mpf(x if isinstance(x, str) else float(x)) for x in (*q, *p)]
    shared = partial(share, list(system.definitions))
    return sp.lambdify(names, list(expressions), modules="mpmath", cse=shared)(*values)


def fingerprint(problem: Any) -> str:
    """Text that identifies a problem's formulae, however they are written: digits at a state near the initial one."""
    import mpmath

    system = problem.system
    beside = [float(x) * (1 + (i + 1) / 1024) + (i + 1) / 4096 for i, x in enumerate((*problem.q0, *problem.p0))]
    defining = [system.H] if system.canonical else [system.H, *system.sides]
    with mpmath.workdps(WORK):
        values = evaluate(problem, defining, beside[: system.d], beside[system.d :])
        return " ".join(mpmath.nstr(x, PRINT) for x in values)


def energy_change(problem: Any, q: Sequence, p: Sequence) -> float:
    """H at (q, p) minus H at the initial state, relative to the sum of the absolute terms of H; in 50 digits."""
    import mpmath
    import sympy as sp

    terms = sp.Add.make_args(problem.system.H)
    with mpmath.workdps(WORK):
        now, then = (evaluate(problem, terms, *z) for z in ((q, p), (problem.q0, problem.p0)))
        scale = max(sum(abs(x) for x in now), sum(abs(x) for x in then))
        return float((sum(now) - sum(then)) / scale)


# -- on disk ------------------------------------------------------------------------------------------------------


def _path(id: str, directory: Path | str | None) -> Path:
    return Path(DIRECTORY if directory is None else directory) / f"{id}.json"


def _bad(path: Path, what: str, label: str) -> InvalidInput:
    return InvalidInput(f"{path}: {what}; to compute it anew: phasebench certify {label} --update")


def _digest(content: dict) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def write(id: str, certificates: Sequence[Certificate], versions: dict, directory: Path | str | None = None) -> Path:
    """Write all certificates of the problem ``id`` to its file, atomically; return the path."""
    content = {
        "format": FORMAT,
        "problem": id,
        "command": f"phasebench certify {id} --update",
        "versions": dict(versions),
        "references": [asdict(c) for c in certificates],
    }
    content = json.loads(json.dumps(content))  # turn tuples into lists, so that the digest matches after reading
    path = _path(id, directory)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_file(path, json.dumps(content | {"sha256": _digest(content)}, indent=1) + "\n")
    return path


def keep(new: Certificate, labels: Sequence[str], versions: dict, directory: Path | str | None = None) -> Path:
    """Store a certificate in its problem's file, replacing the one with the same orbit and parameters.

    ``labels`` are the labels of the problem's orbits, in the order that the file is to have; certificates of other
    orbits are removed, and an unreadable or edited file counts as empty.  Returns the path of the file.
    """
    id = new.problem.partition(":")[0]
    try:
        others, _ = read(id, directory)
    except InvalidInput:
        others = ()
    kept = {(c.problem, tuple(c.parameters.items())): c for c in (*others, new) if c.problem in labels}
    return write(id, sorted(kept.values(), key=lambda c: labels.index(c.problem)), versions, directory)


def read(id: str, directory: Path | str | None = None) -> tuple[tuple[Certificate, ...], dict]:
    """(all certificates of the problem ``id``, package versions at their computation); ((), {}) if none is stored.

    Raises
    ------
    InvalidInput
        If the file is truncated or was edited; the message names it and the remedy.
    """
    path = _path(id, directory)
    if not os.path.exists(path):  # the id of a formula is its text, which may be too long for a file name
        return (), {}
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise _bad(path, f"it is no JSON ({error})", id) from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise _bad(path, f"it is no file of format {FORMAT}", id)
    if content.pop("sha256", None) != _digest(content):
        raise _bad(path, "its content does not match its checksum", id)
    if content.get("problem") != id:
        raise _bad(path, f"it is of the problem {content.get('problem')!r}", id)
    try:
        return tuple(_certificate(c) for c in content["references"]), content["versions"]
    except (KeyError, TypeError, ValueError, InvalidOperation) as error:
        raise _bad(path, f"a reference in it cannot be read ({type(error).__name__}: {error})", id) from None


def _certificate(c: dict) -> Certificate:
    ends = []
    for e in c["ends"]:
        checks = tuple(Check(**x) for x in e["checks"])
        texts = {k: tuple(map(str, e[k])) for k in ("q_text", "p_text")}
        if any(len(x) != len(c["q0"]) or not all(Decimal(y).is_finite() for y in x) for x in texts.values()):
            raise ValueError(f"the state at t = {e['t']!r} is not {len(c['q0'])} finite numbers of each kind")
        ends.append(End(**e | texts | {"checks": checks}))
    return Certificate(**c | {"q0": tuple(c["q0"]), "p0": tuple(c["p0"]), "ends": tuple(ends)})


# -- look-up ------------------------------------------------------------------------------------------------------


def find(problem: Any, directory: Path | str | None = None) -> Certificate | None:
    """The certificate of a problem's orbit at its parameters, or None if none is stored.

    Raises
    ------
    InvalidInput
        If the file is damaged, or the problem has changed since the certificate was computed.
    """
    stored, _ = read(problem.id, directory)
    same = [c for c in stored if c.problem == problem.label and c.parameters == dict(problem.parameters)]
    if not same:
        return None
    certificate, path = same[0], _path(problem.id, directory)
    if (certificate.q0, certificate.p0) != tuple(tuple(float(x) for x in z) for z in (problem.q0, problem.p0)):
        raise _bad(path, f"the initial data of {problem.label} are no longer those it was computed from", problem.label)
    if certificate.fingerprint != fingerprint(problem):
        raise _bad(path, f"the formulae of {problem.label} are no longer those it was computed from", problem.label)
    return certificate


def load(problem: Any, directory: Path | str | None = None) -> tuple[End, ...]:
    """The certified states of a problem's orbit, by time; raises InvalidInput as `find` does, and if there are none."""
    certificate = find(problem, directory)
    if certificate is None:
        values = ", ".join(f"{k} = {v!r}" for k, v in problem.parameters.items())
        at = f" at {values}" if values else ""
        raise _bad(_path(problem.id, directory), f"it has no reference of {problem.label}{at}", problem.label)
    return certificate.ends


def end(problem: Any, t: float, directory: Path | str | None = None) -> End | None:
    """The certified state of a problem's orbit at exactly ``t``, or None; raises InvalidInput as `find` does."""
    certificate = find(problem, directory)
    return None if certificate is None else certificate.at(float(t))


def distance(one: Iterable[str], other: Iterable[str]) -> float:
    """The max norm of the difference of two states of decimal strings, computed without round-off."""
    with localcontext(prec=200):
        return float(max(abs(Decimal(a) - Decimal(b)) for a, b in zip(one, other, strict=True)))
