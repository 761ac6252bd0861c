"""Values in memory at an address, and functions that compiled code calls by one: what NamedTuples cross without Python.

A `probe` gives compiled code that knows nothing of a method a way to try the method's step: the address of a function,
and that of its arguments on the caller's stack.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, overload

from phasebench.integrators.compile import machine
from phasebench.integrators.compile.options import UNCALLED

from .vector import PART, PLACES, inline, njit

if TYPE_CHECKING:
    from phasebench.integrators.values.kinds import Dispatcher, Function


def in_memory(t: types.Type) -> dict[str, Function]:
    """Make Numba intrinsics for values of the Numba type t that are stored at an address: name -> function.

    ``read(address)`` returns the value; ``take(address)`` returns it with the reference that the memory held;
    ``write(address, value)`` stores a value; ``bytes_of()`` is its size in bytes.
    """

    def place(context: Any, builder: Any, address: Any) -> Any:
        return builder.inttoptr(address, context.get_value_type(t).as_pointer())

    @intrinsic
    def read(typing_context: Any, address: types.Type) -> tuple:
        def codegen(context: Any, builder: Any, signature: Any, arguments: Sequence) -> Any:
            value = builder.load(place(context, builder, arguments[0]))
            if context.enable_nrt:
                context.nrt.incref(builder, t, value)
            return value

        return t(address), codegen

    @intrinsic
    def take(typing_context: Any, address: types.Type) -> tuple:
        def codegen(context: Any, builder: Any, signature: Any, arguments: Sequence) -> Any:
            return builder.load(place(context, builder, arguments[0]))

        return t(address), codegen

    @intrinsic
    def write(typing_context: Any, address: types.Type, value: types.Type) -> tuple:
        def codegen(context: Any, builder: Any, signature: Any, arguments: Sequence) -> Any:
            context.nrt.incref(builder, t, arguments[1])
            builder.store(arguments[1], place(context, builder, arguments[0]))
            return context.get_dummy_value()

        return types.none(address, t), codegen

    @intrinsic
    def bytes_of(typing_context: Any) -> tuple:
        def codegen(context: Any, builder: Any, signature: Any, arguments: Sequence) -> Any:
            size = context.get_abi_sizeof(context.get_value_type(t))
            return context.get_constant(types.int64, size)

        return types.int64(), codegen

    return {"read": read, "take": take, "write": write, "bytes_of": bytes_of}


#: What a probe returns, and its arguments but for the last.
RESULT = types.Tuple((types.float64, types.float64, types.int64))
GIVEN = types.float64, types.int64, types.float64, types.int64


def probe(f: Callable) -> Callable:
    """Make the function e -> (f, e), by which other code may call f(x, start, ease, slot, e).

    The result of f is (number, number, integer).  Compiled, the two are addresses, which hold as long as the caller
    runs; `call` calls f by them.
    """

    def pointers(e):
        return f, e

    @overload(pointers, inline="always")  # the arguments' place is on the stack of the caller
    def compiled(e):
        addresses = _addresses(f, e)
        return lambda e: addresses(e)

    return pointers


def _at_address(x, start, ease, slot, address):
    return f(x, start, ease, slot, read(address))  # noqa: F821 (`_addresses` sets the functions)


def _addresses(f: Callable, t: types.Type) -> Function:
    """Make the intrinsic e -> (address of f as a C function, address of e), for e of the Numba type t."""

    @cache
    def compiled(counted: bool) -> Dispatcher:
        made = machine.with_functions(_at_address, {"f": inline(f), "read": in_memory(t)["read"]})
        content = f"{f.__module__} {f.__qualname__} {t}"
        made.__qualname__ = f"at_address_{hashlib.sha256(content.encode()).hexdigest()[:12]}"
        whole = njit(**PART, **UNCALLED, _nrt=counted)(made)
        whole.compile(RESULT(*GIVEN, types.intp))
        return whole

    @intrinsic
    def addresses(typing_context: Any, e: types.Type) -> tuple:
        def codegen(context: Any, builder: Any, signature: Any, arguments: Sequence) -> Any:
            entry = machine.entry_of(compiled(context.enable_nrt), context, builder)
            place = cgutils.alloca_once_value(builder, arguments[0])
            both = [builder.ptrtoint(a, context.get_value_type(types.intp)) for a in (entry, place)]
            return context.make_tuple(builder, signature.return_type, both)

        return types.UniTuple(types.intp, 2)(e), codegen

    return addresses


def call(f, x, start, ease, slot, e):
    """Call f(x, start, ease, slot, e), for f and e as a `probe` returns them."""
    return f(x, start, ease, slot, e)


@intrinsic
def _call(typing_context: Any, f: types.Type, x: types.Type, start: types.Type, ease: types.Type, slot: types.Type,
          e: types.Type) -> tuple:  # fmt: skip
    def codegen(context: Any, builder: Any, signature: Any, arguments: Sequence) -> Any:
        kinds = [context.get_value_type(t) for t in (*GIVEN, types.intp)]
        kind = ir.FunctionType(context.get_value_type(RESULT), kinds)
        return builder.call(builder.inttoptr(arguments[0], kind.as_pointer()), arguments[1:])

    return RESULT(types.intp, *GIVEN, types.intp), codegen


@overload(call, jit_options=PLACES | UNCALLED)
def _call_by_address(f, x, start, ease, slot, e):
    return (lambda f, x, start, ease, slot, e: _call(f, x, start, ease, slot, e)) if f == types.intp else None
