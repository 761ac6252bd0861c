"""Read results of integrators in other languages, computed on another machine, from a file.

A file is CSV.  Its first lines are its header, ``# name: value`` each:

    # phasebench-elsewhere: 1        version of this format
    # package: IRKGaussLegendre
    # version: 0.2.9
    # language: Julia 1.11
    # machine: AMD Ryzen 9 7950X, Linux
    # problem: henon-heiles:box      as `phasebench list problems` names it
    # q0: 0.0, -0.082                its initial state
    # p0: 0.18140678414362935, 0.0
    # energy: 0.02                   H of that state, as it was computed there
    # t_end: 100                     from t = 0

and, where they are needed, ``set`` (values of the problem's parameters, ``e=0.6, mu=0.1``), ``source`` (where the rows
were published) and ``date``.  Then follow the names of the columns and the rows: ``method``; ``h`` (the step) or
``tol`` (the tolerance of an adaptive integrator), the other may be left out or empty; ``evaluations`` of the gradient;
the end state ``q1 .. qd, p1 .. pd`` in all digits of a double, or, of published tables without one, ``energy_error``,
H - H0 at the end with its sign; ``steps`` and ``NAME_error`` of an invariant of the problem are optional.

Errors of a state are computed here, against the certified reference; times of another machine are refused.
"""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from phasebench.benchmarks.measure.global_error import end_error
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.base import Problem
from phasebench.integrators.errors import InvalidInput, unknown_name

#: The name that begins a file, and the version that is read and written.
FORMAT, VERSION = "phasebench-elsewhere", 1
REQUIRED = ("package", "version", "language", "machine", "problem", "q0", "p0", "energy", "t_end")
OPTIONAL = ("set", "source", "date")
COUNTS = ("steps", "evaluations")
#: Names of columns of times.
TIMES = re.compile(r"(seconds|time|wall.*|cpu.*|ns|ms|us|.*_(s|ms|ns|us|seconds))")
#: Significant digits that the longest number of a state has at least; a double has up to 17.
DIGITS = 15
#: Largest difference of two energies that count as the same, relative to the largest of them and 1.
SAME = 1e-12


@dataclass(frozen=True)
class Elsewhere:
    """The content of a file of results that were computed elsewhere, by a package in another language.

    Each row has method, h, tol, steps, evaluations, q and p (arrays (d,), or None), energy_error, and the stated errors
    of invariants.
    """

    path: Path
    header: dict[str, str]
    problem: Problem
    t_end: float
    rows: tuple[dict[str, Any], ...]

    @property
    def by(self) -> str:
        """The package with its version and language."""
        return f"{self.header['package']} {self.header['version']}, {self.header['language']}"


def read(path: Path | str) -> Elsewhere:
    """The content of a file of rows measured elsewhere; raises InvalidInput, which names the fault, and what to do."""
    path = Path(path)
    header, lines = _parts(path)
    made = _problem(path, header)
    t_end = _number(path, "the entry t_end", header["t_end"])
    if not t_end > 0:
        raise InvalidInput(f"{path}: t_end is {t_end:g}; it must be positive, runs begin at t = 0")
    table = list(csv.reader(lines))
    if len(table) < 2:
        raise InvalidInput(
            f"{path} has no rows: after the header it has a line of columns' names, and a row for each run"
        )
    names = [name.strip() for name in table[0]]
    _check_columns(path, names, made)
    rows = tuple(_row(f"{path}, row {k}", names, cells, made) for k, cells in enumerate(table[1:], start=1))
    return Elsewhere(path, header, made, t_end, rows)


def problem_key(path: Path) -> tuple[str, dict[str, float], str]:
    """(Name of the problem, its parameters, name of the package) from a file's header; builds no problem."""
    header, _ = _parts(path)
    return header["problem"], _parameters(path, header), header["package"]


def _parts(path: Path) -> tuple[dict[str, str], list[str]]:
    try:
        lines = [line for line in path.read_text(encoding="utf-8-sig").splitlines() if line.strip()]
    except (OSError, UnicodeDecodeError) as error:
        raise InvalidInput(f"{path} cannot be read: {getattr(error, 'strerror', None) or error}") from None
    header = _header(path, [line for line in lines if line.startswith("#")])
    return header, [line for line in lines if not line.startswith("#")]


def _header(path: Path, lines: list[str]) -> dict[str, str]:
    entries = {}
    for line in lines:
        name, colon, value = line.lstrip("# ").partition(":")
        if not colon:
            raise InvalidInput(f"{path}: the line {line!r} of the header is not '# name: value'")
        entries[name.strip()] = value.strip()
    version = entries.pop(FORMAT, None)
    if version is None:
        raise InvalidInput(
            f"{path} does not begin with '# {FORMAT}: {VERSION}': is it a file of rows measured elsewhere?"
        )
    if version != str(VERSION):
        raise InvalidInput(
            f"{path} has the format {version!r}; this version of phasebench reads format {VERSION} alone"
        )
    for name in entries:
        if name not in (*REQUIRED, *OPTIONAL):
            raise unknown_name(f"entry of the header of {path}", name, [*REQUIRED, *OPTIONAL])
    missing = [name for name in REQUIRED if not entries.get(name)]
    if missing:
        raise InvalidInput(f"{path}: the header lacks {', '.join(missing)}: write '# {missing[0]}: ...'")
    return entries


def _number(path: Path | str, what: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not isfinite(value):
        raise InvalidInput(f"{path}: {what} is {text!r}; it must be a finite number")
    return value


def _parameters(path: Path, header: dict[str, str]) -> dict[str, float]:
    given: dict[str, float] = {}
    for part in filter(None, (p.strip() for p in header.get("set", "").split(","))):
        name, equals, value = part.partition("=")
        if not equals:
            raise InvalidInput(f"{path}: the entry set is {header['set']!r}; it must be like 'e=0.6, mu=0.1'")
        given[name.strip()] = _number(path, f"the parameter {name.strip()}", value)
    return given


def _problem(path: Path, header: dict[str, str]) -> Problem:
    """The problem that a header names, if its initial state and energy are those of the header."""
    try:
        made = problem(header["problem"], **_parameters(path, header))
    except InvalidInput as error:
        raise InvalidInput(f"{path}: {error}") from None
    for name, ours in (("q0", made.q0), ("p0", made.p0)):
        theirs = tuple(_number(path, f"the entry {name}", text) for text in header[name].split(","))
        if theirs != tuple(map(float, ours)):
            told = ", ".join(repr(float(x)) for x in ours)
            raise InvalidInput(
                f"{path}: {name} is {header[name]}, and of {made.label} it is {told}: integrate from the same doubles"
            )
    here = float(made.system.observe(made.system.H, np.array([made.q0]), np.array([made.p0]))[0])
    there = _number(path, "the entry energy", header["energy"])
    if abs(here - there) > SAME * max(1.0, abs(here)):
        raise InvalidInput(
            f"{path}: the initial energy is {there!r} there, and {here!r} here: is it another Hamiltonian, or are its "
            "parameters others? (`# set: name=value`)"
        )
    return made


def _state_columns(d: int) -> list[str]:
    return [f"{x}{k}" for x in "qp" for k in range(1, d + 1)]


def _check_columns(path: Path, names: list[str], made: Problem) -> None:
    """Raise InvalidInput if a column is missing, unknown, named twice or has times, which are not compared."""
    state = _state_columns(made.system.d)
    errors = ["energy_error", *(f"{name}_error" for name in made.invariants)]
    known = ["method", "h", "tol", *COUNTS, *state, *errors]
    for name in names:
        if names.count(name) > 1:
            raise InvalidInput(f"{path} has the column {name!r} twice")
        if name not in known and TIMES.fullmatch(name.lower()):
            raise InvalidInput(f"{path}: times of another machine are not compared: leave out the column {name!r}")
        if name not in known:
            raise unknown_name(f"column of {path}", name, known)
    missing = [name for name in ("method", "evaluations") if name not in names]
    if "h" not in names and "tol" not in names:
        missing.append("h (or tol)")
    if any(x in names for x in state):
        missing += [x for x in state if x not in names]
    elif "energy_error" not in names:
        missing += [f"{state[0]} ... {state[-1]} (or energy_error)"]
    if missing:
        raise InvalidInput(f"{path} lacks the column {', '.join(missing)}; it has {', '.join(names)}")


def _row(where: str, names: list[str], cells: list[str], made: Problem) -> dict[str, Any]:
    if len(cells) != len(names):
        raise InvalidInput(f"{where} has {len(cells)} values for {len(names)} columns")
    text = {name: cell.strip() for name, cell in zip(names, cells, strict=True)}
    values = {n: _number(where, n, t) for n, t in text.items() if n != "method" and t}
    if not text["method"]:
        raise InvalidInput(f"{where} names no method")
    if ("h" in values) == ("tol" in values):
        raise InvalidInput(f"{where}: give h or tol, one of them")
    for name in ("h", "tol"):
        if name in values and not values[name] > 0:
            raise InvalidInput(f"{where}: {name} is {text[name]}; it must be positive")
    for name in COUNTS:
        if name == "evaluations" and name not in values:
            raise InvalidInput(f"{where} has no number of evaluations")
        if name in values and (values[name] < 1 or values[name] != int(values[name])):
            raise InvalidInput(f"{where}: {name} is {text[name]}; it must be a whole number from 1 on")
    d, state = made.system.d, _state_columns(made.system.d)
    y = np.array([values[x] for x in state]) if all(x in values for x in state) else None
    if y is None and "energy_error" not in values:
        raise InvalidInput(f"{where} has neither an end state nor an energy_error")
    if y is not None and max(_digits(text[x]) for x in state) < DIGITS:
        raise InvalidInput(f"{where}: its end state has {max(_digits(text[x]) for x in state)} digits; write all 17")
    stated = {name: values[f"{name}_error"] for name in made.invariants if f"{name}_error" in values}
    return {
        "method": text["method"],
        "h": values.get("h"),
        "tol": values.get("tol"),
        **{name: int(values[name]) if name in values else None for name in COUNTS},
        "q": None if y is None else y[:d],
        "p": None if y is None else y[d:],
        "energy_error": _energy(where, made, y, values.get("energy_error")),
        "stated": stated,
    }


def _digits(text: str) -> int:
    return len(re.sub(r"[eEdD].*|[^0-9]", "", text).lstrip("0"))


def _energy(where: str, made: Problem, y: np.ndarray | None, stated: float | None) -> float:
    """The energy error H - H0 of an end state y = (q, p), with which a stated one agrees; else the ``stated`` one."""
    if y is None:
        return stated
    Q, P = (np.vstack([start, end]) for start, end in ((made.q0, y[: made.system.d]), (made.p0, y[made.system.d :])))
    start, end = made.system.observe(made.system.H, Q, P)
    if stated is not None and abs(stated - (end - start)) > SAME * max(1.0, abs(start)) + 1e-3 * abs(stated):
        raise InvalidInput(f"{where}: energy_error is {stated!r}, and that of its state is {float(end - start)!r}")
    return float(end - start)


def errors(file: Elsewhere) -> list[dict[str, Any]]:
    """The rows of a file with their errors against the reference at t_end, and entries of the header."""
    return [_identify(file, row) | _error(file, row) for row in file.rows]


def _identify(file: Elsewhere, row: dict[str, Any]) -> dict[str, Any]:
    head = file.header
    about = {
        "file": file.path.name,
        "problem": file.problem.label,
        "set": head.get("set", ""),
        "t_end": file.t_end,
        "package": head["package"],
        "version": head["version"],
        "language": head["language"],
        "made_on": head["machine"],
        "source": head.get("source", ""),
    }
    return about | {k: row[k] for k in ("method", "h", "tol", "steps", "evaluations", "energy_error")}


def _error(file: Elsewhere, row: dict[str, Any]) -> dict[str, Any]:
    if row["q"] is None:
        return {"error": None, "uncertainty": None, "reason": "no end state is given: its energy error is as stated"}
    made = file.problem
    return state_error(made, file.t_end, row["q"], row["p"])


def state_error(made: Problem, t_end: float, q: np.ndarray, p: np.ndarray) -> dict[str, Any]:
    """Compare a state at ``t_end`` with the reference: ``error`` and ``uncertainty``, or the ``reason`` of none."""
    ends = SimpleNamespace(t=np.array([0.0, t_end]), q=np.vstack([made.q0, q]), p=np.vstack([made.p0, p]))
    found = end_error(made, ends, t_end)
    reference = found["reference"]
    return {
        "error": found["global_error"],
        "uncertainty": reference["uncertainty"],
        "reason": reference.get("reason", ""),
    }
