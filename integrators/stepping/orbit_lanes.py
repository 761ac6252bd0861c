"""Integrate several orbits at once in SIMD lanes, several times as fast as one orbit after another.

Each lane of a vector register computes a different orbit.  The code of a method is not written twice: a copy of
the system (`twin`) has its functions compiled for lanes, the method's family prepares its step from these functions as
from those of any system, and its kernel ``run`` is compiled with lanes in place of doubles: in the state, in h and in
the weights that differ from orbit to orbit (`VARYING`).  A compiled loop calls the kernel for one *block* of orbits
after another, as many as there are lanes, without the interpreter's lock.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple
from weakref import WeakKeyDictionary

import numba
import numpy as np
from numba import types

from phasebench.integrators.compile import codegen, machine, progress
from phasebench.integrators.values.lane_memory import block_of, table_type, type_with_block, with_block, zeros_of
from phasebench.integrators.values.lanes import Lanes
from phasebench.integrators.values.masks import LANES

from .kernel import COUNTS, OWN, Carry, Prepared, Samples, _tuple_type, _type, aligned_zeros, entry, family_of
from .newton import Work
from .solve import LEVELS

if TYPE_CHECKING:
    from phasebench.integrators.record import Method
    from phasebench.integrators.systems.hamiltonian import Hamiltonian
    from phasebench.integrators.values.kinds import Dispatcher, Function, Signature, Value

#: Largest number of degrees of freedom: beyond, a state in lanes does not fit into registers and compiles slowly.
MOST = 8
#: Fields of a step that may differ from orbit to orbit: the weights of its substeps, and h.
WEIGHTS = ("mu", "lam")
VARYING = ("h", *WEIGHTS)


class OfSteps(NamedTuple):
    """Step sizes h of all orbits, for kernels in lanes: array (blocks of orbits, lanes)."""

    h: Any


class OfWeights(NamedTuple):
    """Step sizes and weights of substeps of all orbits, for kernels in lanes.

    Attributes
    ----------
    h : step sizes, array (blocks of orbits, lanes)
    mu, lam : weights of the substeps, arrays (blocks, substeps, lanes), which replace the fields mu and lam of a step
    """

    h: Any
    mu: Any
    lam: Any


class Tables(NamedTuple):
    """State, memory and work space of all orbits: arrays (blocks of orbits, rows, components, lanes).

    The block of each array is what one call of the kernel gets as the field of `kernel.Carry` with the same name.
    """

    state: Any
    memory: Any
    work: Any


def compiles_in_lanes(system: Hamiltonian) -> bool:
    """True if the system's functions can be compiled for SIMD lanes (`twin`); hand-written loops cannot."""
    return hasattr(system, "make_function") and not system.loops and codegen.compiled()


def runs_in_lanes(system: Hamiltonian, method: Method) -> bool:
    """True if the method can integrate several orbits of the system at once, each in a SIMD lane."""
    if method.family == "adaptive" and len(method.data) == 1:
        return False
    return getattr(family_of(method), "IN_LANES", False) and system.d <= MOST and compiles_in_lanes(system)


def _lanes_for_numbers(t: types.Type, lanes: Lanes) -> types.Type:
    """Return the Numba type t, a number or a tuple, with the type ``lanes`` in place of every double."""
    if t == types.float64:
        return lanes
    if isinstance(t, types.BaseTuple):
        return types.BaseTuple.from_types(tuple(_lanes_for_numbers(x, lanes) for x in t))
    return t


#: System -> number of lanes -> its copy with functions compiled for so many lanes (`twin`).
_twins: WeakKeyDictionary = WeakKeyDictionary()


def twin(system: Hamiltonian, lanes: Lanes = LANES) -> Hamiltonian:
    """Return a copy of the system with functions compiled for SIMD lanes; repeated calls return the same object."""
    known = _twins.setdefault(system, {})
    if lanes.n not in known:
        known[lanes.n] = _make_twin(system, lanes)
    return known[lanes.n]


def _make_twin(system: Hamiltonian, lanes: Lanes) -> Hamiltonian:
    other = copy.copy(system)
    other._functions, kind_of_system = {}, type(system)
    other.variant = f"{lanes.n} lanes"

    def make_function(kind: str, arguments: Sequence, results: Callable, signature: Any, arithmetic: str) -> Callable:
        result, *given = (_lanes_for_numbers(t, lanes) for t in (signature.return_type, *signature.args))
        kind = f"{kind}, {other.variant}"
        return kind_of_system.make_function(other, kind, arguments, results, result(*given), arithmetic)

    other.make_function = make_function
    return other


def _block_loop(
    run: Function, step: Any, varying: tuple, tables: Carry, zero: Value, samples: Samples, counts: np.record
) -> None:
    """Call the kernel ``run`` for every block of orbits; the other arguments are those that `loop` describes."""
    for b in range(len(counts)):
        work = Work(block_of(tables.work, b), None, None)
        orbit = Carry(block_of(tables.state, b), block_of(tables.memory, b), work, zeros_of(zero))
        rows = Samples(block_of(samples.q, b), block_of(samples.p, b), block_of(samples.parameter, b), samples.every)
        run(with_block(step, varying, b), orbit, rows, counts[b])


class _Pointer(types.WrapperAddressProtocol):
    """A compiled kernel as an argument of compiled code.

    Numba asks LLVM for a kernel's address in each call, under a lock that a thread interrupted by Ctrl-C may leave
    closed: every other thread would wait for it for ever.  Here it is asked for once.
    """

    def __init__(self, run: Dispatcher, signature: Signature) -> None:
        made = run.get_compile_result(signature)
        self._address = made.library.get_pointer_to_function(made.fndesc.llvm_cfunc_wrapper_name)
        self._signature = signature

    def signature(self) -> Signature:
        return self._signature

    def __wrapper_address__(self) -> int:
        return self._address


_loops: dict = {}
_BLOCKS = types.Array(types.float64, 4, "C")


def loop(prepared: Prepared, varying: tuple, d: int) -> Callable:
    """Compile the loop (step, varying, tables, zero, samples, counts) -> None over blocks of orbits in lanes.

    The loop calls the kernel of ``prepared``, which is made for the `twin` of a system of d degrees of freedom.  Its
    arguments are the kernel's: ``step`` is the family's NamedTuple, ``varying`` an `OfSteps` or `OfWeights` that
    replaces fields of it, ``tables`` a `Tables`, ``zero`` a tuple of d zeros, ``samples`` a `kernel.Samples` of arrays
    (blocks, rows, components, lanes) to fill, and ``counts`` an array of records `kernel.COUNTS`, one for each block.
    """
    scalar = _type(prepared.step)
    given = _type(varying)
    key = (prepared.run, scalar, given, d)
    if key not in _loops:
        T, table, record = types.UniTuple(LANES, d), table_type(), numba.from_dtype(COUNTS)
        orbit = _tuple_type((table, table, _tuple_type((table, types.none, types.none), Work), T), Carry)
        rows = _tuple_type((table, table, table, types.int64), Samples)
        inner = types.UniTuple(types.int64, 2)(type_with_block(scalar, given), orbit, rows, record)
        outer = types.none(
            types.FunctionType(inner),
            scalar,
            given,
            _tuple_type((_BLOCKS, _BLOCKS, _BLOCKS), Tables),
            types.UniTuple(types.float64, d),
            _tuple_type((_BLOCKS, _BLOCKS, _BLOCKS, types.int64), Samples),
            types.Array(record, 1, "C"),
        )
        options = codegen.options(d) | {"nogil": True}
        family = prepared.run.__module__.rpartition(".")[2].replace("_", "-")
        with progress.compiling(f"the kernel of {family} in lanes", d):
            run = _Pointer(machine.load_or_compile(prepared.run, inner, options, f"{family}-lanes"), inner)
            _loops[key] = run, entry(machine.load_or_compile(_block_loop, outer, options, "blocks"))
    run, called = _loops[key]
    return lambda *arguments: called(run, *arguments)


def to_blocks(rows: np.ndarray, fill: float = np.nan) -> np.ndarray:
    """Regroup an array (n, ...), a row for each orbit, as (blocks, ..., lanes); ``fill`` completes the last block."""
    width = LANES.n
    blocks = -(-len(rows) // width)
    full = np.full((blocks * width, *rows.shape[1:]), fill)
    full[: len(rows)] = rows
    return np.ascontiguousarray(np.moveaxis(full.reshape(blocks, width, *rows.shape[1:]), 1, -1))


def from_blocks(blocks: np.ndarray, n: int) -> np.ndarray:
    """Regroup an array (blocks, ..., lanes) as an array (n, ...) with a row for each of the first n orbits."""
    rows = np.moveaxis(blocks, -1, 1)
    return rows.reshape(-1, *rows.shape[2:])[:n]


def varying_of(h: np.ndarray, weights: dict[str, np.ndarray]) -> tuple:
    """Put step sizes h (n,) and weights (n, substeps), by name, of n orbits into blocks: `OfSteps` or `OfWeights`."""
    fields = {"h": to_blocks(h, 1.0)} | {name: to_blocks(w, 0.0) for name, w in weights.items()}
    return (OfWeights if weights else OfSteps)(**fields)


def tables_of(prepared: Prepared, Q: np.ndarray, P: np.ndarray) -> Tables:
    """Allocate the arrays `Tables` of orbits in lanes, with states that start at the rows of Q, P, arrays (n, d)."""
    q, p = to_blocks(Q), to_blocks(P)
    blocks, d, width = q.shape
    state = aligned_zeros((blocks, OWN + prepared.stages, max(2, d), width))
    state[:, 0, :d], state[:, 1, :d] = q, p
    memory = aligned_zeros((blocks, (3 * LEVELS + 1) * prepared.stages, prepared.width, width))
    return Tables(state, memory, np.zeros((blocks, 1, 1, width)))
