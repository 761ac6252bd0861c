r"""The contract of a family, a module that implements the step of one kind of method; compile the loop over its steps.

A family is a module of `integrators.families`; the ``family`` of a method's record is its name.  Its *kernel* is the
compiled loop that makes many steps in one call.  As a family, the implicit midpoint rule would be::

    class Midpoint(NamedTuple):                    # what a step needs; h and eps are set by the run
        field: Callable
        h: float = 0.0
        eps: float = 0.0

    class Increment(NamedTuple):                   # the arguments of the stage equation
        method: Midpoint
        q: Any
        p: Any

    @inline
    def increment(x, e):                           # x = h f(y + x / 2)
        q, p = axpy(0.5, head(x), e.q), axpy(0.5, tail(x), e.p)
        dq, dp = e.method.field(q, p, e.method.h, 0.0)
        return scale(e.method.h, join(dq, dp))

    solve = solver(increment)

    def step(method, y, carry, counts):
        x = predict(carry.memory, 0, 1, counts.steps, join(carry.zero, carry.zero))
        e = Increment(method, y.q, y.p)
        x, evaluations, newton, status = solve(e, x, size(y.q) + size(y.p), method.eps, carry.work)
        counts.gradient += evaluations
        counts.newton += newton
        if status != SOLVED:
            return y, status
        remember(carry.memory, 0, 1, counts.steps, x)
        return update(y, head(x), tail(x)), SOLVED

    run = loop(step)
    IN_LANES = True                                # orbits may be integrated side by side

    def prepare(method, system, arithmetic):
        return Prepared(run, Midpoint(system.field(arithmetic)), width=2 * system.d, stages=1)

1. ``step(method, y, carry, counts)`` returns (y, status).  y is a `vector.State`, status `solve.SOLVED` or why the step
   was not taken.  `loop.loop` makes the kernel ``run`` from it, and documents further functions that a family may have:
   ``begin`` (for a state with more fields), ``start`` and ``finish`` (for steps that share a substep).
2. ``prepare(method, system, arithmetic)`` returns a `Prepared`: the kernel, the family's NamedTuple, and how much
   memory a step needs.  The tuple holds functions of the system (None for one that the system lacks;
   `vector.dispatch_on_none` chooses by that when it compiles) and coefficients in the given arithmetic (`array`,
   `numbers`).  It depends on the method's record and the system alone, since it is stored on disk (`preparation`).
   What depends on h or on the initial state (such as H0) is set by ``Prepared.begin``: begin(method, q, p) -> method,
   which must not change the types of fields.
3. q, p, increments and unknowns are *values*: tuples for small d, arrays for large d, tuples of SIMD lanes for several
   orbits at once, or object arrays of MPFR numbers.  Only the operations of `vector` act on them, so that one source
   serves all.  Increments are added by compensated summation (`vector.update`, `add_product_in_place`).
4. A run is made by several calls of the kernel.  What a step leaves for the next is in ``carry`` (`Carry`): solutions
   of earlier steps in its memory (`solve.predict`, `remember`), other numbers of the family in spare rows of its state.
5. ``counts`` (`COUNTS`): a step adds its evaluations of the gradient or field, the equations that needed Newton's
   method, and fallbacks: steps that lack what the method promises.
6. Implicit equations are solved by `solve.solver` or `solve.row_solver`, quadratures are confirmed by
   `solve.refinement`, and a parameter that preserves the energy is found by `root.finder` (``Prepared.searches``).
7. A family whose step can run on several orbits at once, in SIMD lanes, sets ``IN_LANES = True``: the step has no
   branch on numbers of the state (`masks.select`, `where` choose lane by lane).
8. A step of tuples allocates nothing.  Arrays in the NamedTuple are two-dimensional or read-only: a writable array of
   one dimension is a value of large d.  An explicit step may work in place (`vector.in_place`); then a step of arrays
   allocates nothing either, and arrays may be used from a smaller d on (`inplace.in_place_version`,
   ``Prepared.arrays``).
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from types import ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple
from weakref import WeakKeyDictionary

import numba
import numpy as np
from numba import types
from numba.extending import is_jitted

from phasebench.integrators.compile import codegen, machine, preparation, progress
from phasebench.integrators.compile.codegen import DOUBLE, MULTIPRECISION
from phasebench.integrators.values import vector

from . import newton, root
from .newton import Work

if TYPE_CHECKING:
    from phasebench.integrators.record import Method
    from phasebench.integrators.systems.hamiltonian import Hamiltonian

#: Names of the counts that a solution reports.
TALLY = ("steps", "gradient", "hessian", "iterations", "fallbacks", "newton")
#: Names of the counts that a step of a method adds to.
COUNTED = ("steps", "gradient", "newton", "fallbacks")
#: A kernel's counts; ``rule`` is the first row of the quadrature rule in use, ``parameter`` the last one chosen.
COUNTS = np.dtype([*((name, np.int64) for name in (*COUNTED, "rule")), ("parameter", np.float64)])
#: Bytes of a cache line, and the most that a SIMD vector has.
LINE = 64

#: Rows of ``Carry.state``: q, p, what rounding lost of q and of p, and from ``OWN`` on the rows that a family may use.
Q, P, LOST_Q, LOST_P, OWN = range(5)


class Carry(NamedTuple):
    """What one call of a kernel, a compiled loop over steps, passes to the next call, and memory for its work.

    Attributes
    ----------
    state : array with the rows q, p, what rounding lost of q and of p, then from `OWN` on ``Prepared.stages`` rows that
        a family may use
    memory : array (rows, width), for solutions of stage equations in earlier steps
    work : memory for linear systems, and Newton's method
    zero : a vector of d zeros, of the kind that q and p have in the kernel (tuple or array)
    """

    state: np.ndarray
    memory: np.ndarray
    work: Work
    zero: Any


class Samples(NamedTuple):
    """Arrays that a kernel fills with the states to store, one row after every ``every`` steps.

    Attributes
    ----------
    q, p : arrays (rows, d)
    parameter : array (rows, 1), the parameter that the last step before the row chose; unused by most methods
    every : number of steps from row to row
    """

    q: np.ndarray
    p: np.ndarray
    parameter: np.ndarray
    every: int


@dataclass(frozen=True, eq=False)
class Prepared:
    """A method prepared for a system: its kernel, a loop over steps, with all that it needs besides the state.

    Attributes
    ----------
    run, step : the kernel as a Python function, and its first argument, the family's NamedTuple
    width, stages : components of a stage's unknown, and the number of such unknowns in a step
    implicit, hessian : True if each evaluation of the gradient also counts as an iteration of the stage equations
        (implicit), as an evaluation of higher derivatives (hessian)
    linear : number of unknowns of the largest linear system that the kernel solves; ``width`` by default
    work : shape of the memory for that system if it is not a full square matrix
    arrays : True if states are arrays whatever d is: for a step that works in place, on a system's
        `inplace.in_place_version`
    begin : function (step, q, p) -> step that completes ``step`` for a run from the state (q, p)
    missed : what is wrong with fallbacks, steps that lack what the method promises, as the end of a message "n of m
        steps ..."; if it is empty, fallbacks do not change the status of a solution
    searches : True if a step chooses a parameter by a `root.finder`, which keeps attempts in further rows of the state
    apart : True if the kernel in SIMD lanes sums the evaluations over the orbits, as it always does if ``implicit``;
        else it counts those of one orbit, which are the same for all
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
    searches: bool = False

    def tally(self, steps: int, gradient: int, fallbacks: int = 0, newton: int = 0) -> dict[str, int]:
        """Return the counts that a solution reports, name in `TALLY` -> number, from those that the kernel counted."""
        numbers = steps, gradient, gradient if self.hessian else 0, gradient if self.implicit else 0, fallbacks, newton
        return dict(zip(TALLY, numbers, strict=True))


def array(rows: Iterable[Iterable[Any]], arithmetic: str) -> np.ndarray:
    """Convert rows of exact numbers to a two-dimensional array of doubles or, if ``arithmetic`` says so, MPFR numbers.

    Short rows are padded with zeros.
    """
    rows = [list(r) for r in rows]
    out = zeros((len(rows), max(map(len, rows), default=1)), arithmetic)
    for i, r in enumerate(rows):
        for j, x in enumerate(r):
            out[i, j] = codegen.to_number(x, arithmetic)
    return out


def numbers(row: Iterable[Any], arithmetic: str) -> np.ndarray:
    """Convert n exact numbers to a read-only array (n,) of doubles or, if ``arithmetic`` says so, MPFR numbers."""
    return freeze(array([row], arithmetic)[0])


def freeze(x: Any) -> np.ndarray:
    """Copy x, an array or nested lists of numbers, to a read-only NumPy array of the same kind of numbers."""
    given = np.array(x)
    out = aligned_zeros(given.shape) if given.dtype == float else given
    out[...] = given
    out.flags.writeable = False
    return out


def zeros(shape: int | tuple[int, ...], arithmetic: str) -> np.ndarray:
    """Return an array of zeros: doubles, or MPFR numbers if ``arithmetic`` is "multiprecision"."""
    if arithmetic == MULTIPRECISION:
        out = np.empty(shape, dtype=object)
        out.fill(codegen.to_number(0, arithmetic))
        return out
    return aligned_zeros(shape)


def aligned_zeros(shape: int | tuple[int, ...]) -> np.ndarray:
    """Return an array of zeros (doubles) that begins at a multiple of `LINE` bytes.

    NumPy's arrays begin anywhere, and loading a SIMD vector that lies across two cache lines takes longer: without this
    the times of Gauss's methods differ by a fourth, some by three fifths, between processes.
    """
    size = int(np.prod(shape))
    room = np.zeros(size + LINE // 8)
    first = -room.__array_interface__["data"][0] // 8 % (LINE // 8)
    return room[first : first + size].reshape(shape)


def value(x: Iterable[Any], d: int, arithmetic: str = DOUBLE, arrays: bool = False) -> tuple[float, ...] | np.ndarray:
    """Convert the numbers x to the form in which kernels for d degrees of freedom take them.

    That is a tuple of doubles, or an array if d is large, ``arrays`` is true, nothing is compiled, or the arithmetic is
    multiprecision.
    """
    if arithmetic == DOUBLE and codegen.compiled() and codegen.value_kind(d, arrays) == "tuple":
        return tuple(map(float, x))
    return np.array(x, dtype=object if arithmetic == MULTIPRECISION else float)


def family_of(method: Method) -> ModuleType:
    """Return the module that implements methods of this method's kind (its family)."""
    return importlib.import_module(f"phasebench.integrators.families.{method.family}")


def prepare(method: Method, system: Hamiltonian, arithmetic: str = DOUBLE) -> Prepared:
    """Prepare ``method`` for ``system``: return its kernel, not yet compiled, with functions and coefficients.

    The result is read from the cache if it was stored there.
    """
    entry = preparation.entry(method, system) if arithmetic == DOUBLE else None
    found = preparation.read(entry)
    if found is None:
        found = _prepare(method, system, arithmetic)
        preparation.write(entry, found)
    return found


def _prepare(method: Method, system: Hamiltonian, arithmetic: str) -> Prepared:
    family = family_of(method)
    with progress.compiling(f"the functions of {method.id}", system.d):
        return family.prepare(method, system, arithmetic)


def keep_energy(energy: Callable) -> Callable:
    """Make a function (step, q, p) -> step that sets the field H0 of the step to the energy of the state (q, p)."""
    return partial(_set_energy, energy)


def _set_energy(energy: Callable, step: NamedTuple, q: Any, p: Any) -> NamedTuple:
    return step._replace(H0=energy(q, p)[0])


def _functions_of(prepared: Prepared, arithmetic: str) -> tuple[Callable | None, Callable | None]:
    solves = (prepared.implicit or prepared.linear) and prepared.work is None
    return (
        codegen.once(newton.newton, newton.SIGNATURE, arithmetic) if solves else None,
        codegen.once(root.search_anew, root.SIGNATURE, arithmetic) if prepared.searches else None,
    )


def work_of(prepared: Prepared, arithmetic: str = DOUBLE) -> Work:
    """Allocate the memory for the linear systems of a kernel, with the functions that it calls where it needs them."""
    solve, search = _functions_of(prepared, arithmetic)
    shape = newton.shape(prepared.linear or prepared.width) if solve else prepared.work or (1, 1)
    return Work(zeros(shape, arithmetic), solve, search)


_kernels: dict = {}
_of_prepared: WeakKeyDictionary = WeakKeyDictionary()  # by the degrees of freedom
_pointers: WeakKeyDictionary = WeakKeyDictionary()  # to make a type takes longer than many a run


def kernel(prepared: Prepared, d: int, arithmetic: str = DOUBLE) -> Callable:
    """Return the loop ``prepared.run`` compiled for d degrees of freedom, or from the cache if it is there.

    In multiprecision, or if nothing is compiled in this process, the Python function is returned.
    """
    if arithmetic == MULTIPRECISION or not codegen.compiled():
        return prepared.run
    known = _of_prepared.setdefault(prepared, {})
    if d not in known:
        known[d] = _compile(prepared, d)
    return known[d]


def _compile(prepared: Prepared, d: int) -> Callable:
    step, T = _type(prepared.step), codegen.value_type(d, prepared.arrays)
    options = vector.TUPLES if any(map(vector.writes, step.types)) else codegen.options(d)  # nothing allocates
    key = (prepared.run, step, T, options is vector.TUPLES)
    if key not in _kernels:
        work = _tuple_type((newton.TABLE, *map(_type, _functions_of(prepared, DOUBLE))), Work)
        carry = _tuple_type((newton.TABLE, newton.TABLE, work, T), Carry)
        samples = _tuple_type((newton.TABLE, newton.TABLE, newton.TABLE, types.int64), Samples)
        signature = types.UniTuple(types.int64, 2)(step, carry, samples, numba.from_dtype(COUNTS))
        family = prepared.run.__module__.rpartition(".")[2].replace("_", "-")
        with progress.compiling(f"the kernel of {family}", d):
            _kernels[key] = machine.load_or_compile(prepared.run, signature, options | {"nogil": True}, family)
    return _kernels[key]


def entry(kernel: Callable) -> Callable:
    """Return the Python function that calls a compiled kernel directly, for the one set of types it was compiled for.

    It avoids Numba's dispatcher, which cannot determine the types of a kernel's arguments: these are tuples that
    contain functions.  A kernel that is not compiled is returned unchanged.
    """
    return next(iter(kernel.overloads.values())).entry_point if hasattr(kernel, "overloads") else kernel


def _tuple_type(fields: Iterable[types.Type], kind: type | None = None) -> types.Type:
    fields = tuple(fields)
    if kind is None and len(set(fields)) == 1:  # as Numba says, without its warning about functions
        return types.UniTuple(fields[0], len(fields))
    return types.BaseTuple.from_types(fields, kind)


def _type(x: Any) -> types.Type:
    """Return the Numba type of an argument of a kernel: a number, array, function or (nested) tuple of these.

    A function has the type of a pointer to a function of its signature, so that one compiled kernel serves every
    system.
    """
    if isinstance(x, tuple):
        return _tuple_type(map(_type, x), type(x) if hasattr(x, "_fields") else None)
    if isinstance(x, machine.Function) or is_jitted(x):
        if x not in _pointers:
            signature = x.signature() if isinstance(x, machine.Function) else x.nopython_signatures[0]
            _pointers[x] = types.FunctionType(signature.return_type(*signature.args))
        return _pointers[x]
    if type(x) is np.ndarray and x.flags.c_contiguous:  # as Numba says, without its import of masked arrays
        return types.Array(numba.from_dtype(x.dtype), x.ndim, "C", readonly=not x.flags.writeable)
    return numba.typeof(x)
