"""Kernels: what a family's ``run`` is handed, and its compilation, once per family and kind of state.

For somebody who adds a family.  Its module holds a NamedTuple of what a step needs, ``run`` and ``prepare``:

1. ``prepare(method, system, arithmetic)`` returns a `Prepared`.  Its ``step`` is an instance of the family's
   NamedTuple: the functions asked of the system (None for one that is not there, which `vector.chosen` can tell when it
   compiles), the coefficients in the arithmetic at hand (`array`, `numbers`), and ``h`` and ``eps``, which a run sets.
   It depends on the method's record and the system alone: it is kept (`preparation`).
2. What depends on h or on the initial state (H0) is set by ``Prepared.begin``: begin(step, q, p) -> step.  Fields keep
   their types.
3. ``run(step, orbit, samples, counts)`` takes ``samples.every`` steps before each row of ``samples`` and fills it.  It
   returns (rows filled, status): `solve.SOLVED`, or why it stopped in the middle of the row that follows.
4. ``run`` is called again and again, in pieces.  All that goes from one piece to the next stands in ``orbit`` and
   ``counts``: it reads the state at its begin (`vector.opened`) and writes it at its end (`vector.close`).
5. The state, stage unknowns and increments are values: tuples of small d, arrays of large d, object arrays of MPFR
   numbers.  Only the operations of `vector` touch them, so that the same source runs on all three.  Increments are
   added with compensation.
   An explicit step works in place (`vector.in_place`): of arrays it then allocates nothing either, and its family may
   choose them for a smaller d (`filling.twin`, ``Prepared.arrays``).
6. A step of tuples allocates nothing.  Arrays in ``step`` and ``orbit`` are two-dimensional or read-only: a writable
   one-dimensional array of numbers is a value of large d.
7. Implicit equations go to `solve.solver` or `solve.row_solver`, quadratures to be confirmed to `solve.confirmer`
   or `solve.unchanged`, parameters that keep the energy to `root.finder`.
8. ``counts`` has the number of steps, of evaluations of the gradient or field, of equations that needed Newton's
   method, and of fallbacks: steps that lack what the method promises.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numba
import numpy as np
from numba import types

from . import codegen, machine, preparation, progress, vector
from .codegen import DOUBLE, MULTIPRECISION

#: What a solution counts.
TALLY = ("steps", "gradient", "hessian", "iterations", "fallbacks", "newton")
#: What is counted; ``rule`` is the quadrature rule that the next step begins with, as the first of its rows.
COUNTS = np.dtype([(name, np.int64) for name in ("steps", "gradient", "newton", "fallbacks", "rule")])


class Orbit(NamedTuple):
    """What goes on from step to step.

    Attributes
    ----------
    state : array, rows q, p, what rounding lost of q, and of p, then ``stages`` rows that are the family's own
    memory : array (rows, width), for solutions of earlier steps
    work : array, for a linear system with its right-hand side
    zero : the zero of a value
    """

    state: np.ndarray
    memory: np.ndarray
    work: np.ndarray
    zero: Any


class Samples(NamedTuple):
    """The rows to fill, each after ``every`` steps: q, p, and in one column a parameter that the method chose."""

    q: np.ndarray
    p: np.ndarray
    parameter: np.ndarray
    every: int


@dataclass(frozen=True, eq=False)
class Prepared:
    """A kernel's ``run`` with what it needs besides the state (guidelines 1 and 2).

    Attributes
    ----------
    run, step : the kernel and its first argument
    width, stages : components of a stage's unknown, and the number of such unknowns in a step
    implicit, hessian : whether evaluations count as iterations, and as evaluations of higher derivatives
    linear : the number of unknowns of the largest linear system that the kernel solves, at first ``width``
    work : the shape of the memory for it, where that is not the square one of a full matrix
    arrays : whether its values are arrays, be d large or not: of a step that works in place, on a `filling.twin`
    begin : completes ``step`` for a run
    missed : what a fallback is, in words after "n of m steps"; without it fallbacks do not change the status
    apart : whether evaluations of orbits in lanes are counted for each, as iterations are
    """

    run: Callable
    step: NamedTuple
    width: int
    stages: int
    implicit: bool = True
    hessian: bool = False
    linear: int = 0
    begin: Callable | None = None
    missed: str = ""
    work: tuple[int, int] | None = None
    arrays: bool = False
    apart: bool = False

    def tally(self, steps: int, gradient: int, fallbacks: int = 0, newton: int = 0) -> dict[str, int]:
        """What a solution says of its counts."""
        numbers = steps, gradient, gradient if self.hessian else 0, gradient if self.implicit else 0, fallbacks, newton
        return dict(zip(TALLY, numbers, strict=True))


def array(rows, arithmetic: str) -> np.ndarray:
    """A two-dimensional array of exact numbers in the arithmetic at hand."""
    rows = [list(r) for r in rows]
    out = zeros((len(rows), max(map(len, rows), default=1)), arithmetic)
    for i, r in enumerate(rows):
        for j, x in enumerate(r):
            out[i, j] = codegen.exactly(x, arithmetic)
    return out


def numbers(row, arithmetic: str) -> np.ndarray:
    """A read-only array of exact numbers in the arithmetic at hand."""
    return fixed(array([row], arithmetic)[0])


def fixed(x) -> np.ndarray:
    """x as a read-only array; integers stay integers."""
    x = np.array(x)
    x.flags.writeable = False
    return x


def zeros(shape, arithmetic: str) -> np.ndarray:
    """Zeros of the arithmetic at hand."""
    if arithmetic == MULTIPRECISION:
        out = np.empty(shape, dtype=object)
        out.fill(codegen.exactly(0, arithmetic))
        return out
    return np.zeros(shape)


def value(x, d: int, arithmetic: str = DOUBLE, arrays: bool = False):
    """The numbers x as a value of systems of d degrees of freedom; an array in any case where it is told so."""
    if arithmetic == DOUBLE and codegen.compiled() and codegen.value_kind(d, arrays) == "tuple":
        return tuple(map(float, x))
    return np.array(x, dtype=object if arithmetic == MULTIPRECISION else float)


def prepare(method, system, arithmetic: str = DOUBLE) -> Prepared:
    """The kernel of ``method`` for ``system``, from the cache where that has it."""
    entry = preparation.entry(method, system) if arithmetic == DOUBLE else None
    found = preparation.read(entry)
    if found is None:
        found = _made(method, system, arithmetic)
        preparation.write(entry, found)
    return found


def _made(method, system, arithmetic: str) -> Prepared:
    family = importlib.import_module(f"phasebench.integrators.families.{method.family}")
    with progress.compiling(f"the functions of {method.id}", system.d):
        return family.prepare(method, system, arithmetic)


def keep_energy(energy: Callable) -> Callable:
    """A ``begin`` that sets the step's H0."""
    return lambda step, q, p: step._replace(H0=energy(q, p)[0])


_kernels: dict = {}
_of_prepared: WeakKeyDictionary = WeakKeyDictionary()  # by the degrees of freedom
_pointers: WeakKeyDictionary = WeakKeyDictionary()  # to make a type takes longer than many a run
_TABLE = types.Array(types.float64, 2, "C")


def kernel(prepared: Prepared, d: int, arithmetic: str = DOUBLE) -> Callable:
    """``prepared.run``, compiled with an explicit signature (and kept on disk) unless compilation is off."""
    if arithmetic == MULTIPRECISION or not codegen.compiled():
        return prepared.run
    known = _of_prepared.setdefault(prepared, {})
    if d not in known:
        known[d] = _compiled(prepared, d)
    return known[d]


def _compiled(prepared: Prepared, d: int) -> Callable:
    step, T = _type(prepared.step), codegen.value_type(d, prepared.arrays)
    options = vector.TUPLES if any(map(vector.writes, step.types)) else codegen.options(d)  # nothing allocates
    key = (prepared.run, step, T, options is vector.TUPLES)
    if key not in _kernels:
        orbit = _tuple_type((_TABLE, _TABLE, _TABLE, T), Orbit)
        samples = _tuple_type((_TABLE, _TABLE, _TABLE, types.int64), Samples)
        signature = types.UniTuple(types.int64, 2)(step, orbit, samples, numba.from_dtype(COUNTS))
        family = prepared.run.__module__.rpartition(".")[2].replace("_", "-")
        with progress.compiling(f"the kernel of {family}", d):
            _kernels[key] = machine.compiled(prepared.run, signature, options | {"nogil": True}, family)
    return _kernels[key]


def entry(kernel: Callable) -> Callable:
    """What a compiled kernel is called by: Numba's dispatcher does not know a function inside of a tuple."""
    return next(iter(kernel.overloads.values())).entry_point if hasattr(kernel, "overloads") else kernel


def _tuple_type(fields, kind=None):
    return types.BaseTuple.from_types(tuple(fields), kind)


def _type(x):
    """The Numba type of a step's field: a function is a pointer, so that a kernel serves every system."""
    if isinstance(x, tuple):
        return _tuple_type(map(_type, x), type(x) if hasattr(x, "_fields") else None)
    if isinstance(x, numba.core.dispatcher.Dispatcher):
        if x not in _pointers:
            signature = x.nopython_signatures[0]
            _pointers[x] = types.FunctionType(signature.return_type(*signature.args))
        return _pointers[x]
    if type(x) is np.ndarray and x.flags.c_contiguous:  # as Numba says, without its import of masked arrays
        return types.Array(numba.from_dtype(x.dtype), x.ndim, "C", readonly=not x.flags.writeable)
    return numba.typeof(x)
