"""Call a kernel, a compiled loop over steps, with three numbers: the address of its arguments, h, the number of steps.

To pass NamedTuples to a kernel from Python costs tens of microseconds, since each field is converted to the compiler's
form.  Here they are converted once, and stored in memory in that form (``pack``), from where each call reads them.  The
memory holds references to the arrays among them until they are released.  The kernel is called through a pointer:
inlined into its caller it would have to be compiled again, and might round differently.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numba
import numpy as np
from numba import types
from numba.extending import intrinsic

from phasebench.integrators.compile import machine, progress
from phasebench.integrators.values.pointers import in_memory

from .codes import NOT_FINITE, SOLVED
from .kernel import P, Prepared, Q, Samples, _tuple_type, entry, kernel
from .newton import TABLE

if TYPE_CHECKING:
    from phasebench.integrators.stepping.kernel import Carry
    from phasebench.integrators.values.kinds import Function


class PackedCall(NamedTuple):
    """The compiled functions that store a kernel's arguments in memory, and call the kernel with them.

    Attributes
    ----------
    size : bytes of that memory
    pack : function (address, run, step, carry, samples, counts, start) that writes the arguments to memory
    release : function (address) that drops the references that the memory holds
    run : the kernel, a compiled loop over steps (`kernel`)
    call : function (address, h, steps) -> status that integrates from ``start``, an array with the rows q and p, and
        writes the final state to the only row of ``samples``
    """

    size: int
    pack: Callable
    release: Callable
    run: Callable
    call: Callable


_known: dict = {}


def packed_call(prepared: Prepared, d: int) -> PackedCall:
    """Return the `PackedCall` of a prepared kernel for d degrees of freedom, which is compiled once in a process."""
    run = kernel(prepared, d)
    step, carry, samples, counts = run.nopython_signatures[0].args
    key = (run, step)  # kernels of arrays serve every d, and so do their entries
    if key not in _known:
        with progress.compiling("the kernel's entry", d), warnings.catch_warnings():
            warnings.simplefilter("ignore", numba.NumbaExperimentalFeatureWarning)
            pointer = types.FunctionType(run.nopython_signatures[0].return_type(step, carry, samples, counts))
            block = _tuple_type((pointer, step, carry, samples, counts, TABLE))
            _known[key] = _compile(run, block)
    return _known[key]


def _pack(
    address: int, run: Function, step: Any, carry: Carry, samples: Samples, counts: np.record, start: int
) -> None:
    write(address, (run, step, carry, samples, counts, start))  # noqa: F821 (`_compile` sets the functions)


def _release(address: int) -> None:
    take(address)  # noqa: F821


def _size() -> int:
    return bytes_of()  # noqa: F821


def _call(address: int, h: float, steps: int) -> int:
    run, step, carry, samples, counts, start = read(address)  # noqa: F821
    d = start.shape[1]
    for rows in (carry.state, carry.memory):
        for i in range(rows.shape[0]):
            for j in range(rows.shape[1]):
                rows[i, j] = 0.0
    for j in range(d):
        carry.state[Q, j], carry.state[P, j] = start[0, j], start[1, j]
        samples.q[0, j] = samples.p[0, j] = np.nan
    counts.steps = counts.gradient = counts.newton = counts.fallbacks = counts.rule = 0
    counts.parameter = np.nan
    rows = Samples(samples.q, samples.p, samples.parameter, steps)
    status = run(with_h(step, h), carry, rows, counts)[1]  # noqa: F821
    if status == SOLVED:
        for j in range(d):
            if not (np.isfinite(samples.q[0, j]) and np.isfinite(samples.p[0, j])):
                return NOT_FINITE
    return status


def _compile(run: Function, block: types.Type) -> PackedCall:
    operations = in_memory(block) | {"with_h": _with_h(block[1])}

    def compile_and_keep(f: Callable, signature: Any) -> Callable:
        options = {"error_model": "numpy", "nogil": True}
        f = machine.with_functions(f, operations)
        return entry(machine.load_or_compile(f, signature, options, f"entry-{f.__name__}|{block}"))

    number = types.int64
    return PackedCall(
        size=compile_and_keep(_size, number())(),
        pack=compile_and_keep(_pack, types.void(number, *block)),
        release=compile_and_keep(_release, types.void(number)),
        run=run,
        call=compile_and_keep(_call, number(number, types.float64, number)),
    )


def _with_h(t: types.Type) -> Function:
    """Make the Numba intrinsic (step, h) -> a copy of the NamedTuple ``step``, of Numba type t, with this h."""
    index = t.fields.index("h")

    @intrinsic
    def with_h(typing_context: Any, step: types.Type, h: types.Type) -> tuple:
        def codegen(context: Any, builder: Any, signature: Any, arguments: Sequence) -> Any:
            value = builder.insert_value(arguments[0], arguments[1], index)
            context.nrt.incref(builder, t, value)
            return value

        return t(t, types.float64), codegen

    return with_h
