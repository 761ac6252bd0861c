"""Fused multiply-add of numbers and of lanes: a x + y rounded once.

It shortens the chain of operations that a step waits for.  By itself the compiler fuses only products that nothing else
uses; `fma` asks for it explicitly, and is one instruction where the processor has it.  On processors without the
instruction `fma` is a product and a sum, each rounded, and `exact_fma` a function call that rounds once.  In uncompiled
code both are a product and a sum.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from numba import types
from numba.extending import intrinsic, overload

from .lanes import OPTIONS, Lanes, broadcast, call

if TYPE_CHECKING:
    from phasebench.integrators.values.kinds import Number


def fma(a: Number, x: Number, y: Number) -> Number:
    """The number a x + y; compiled, it is rounded once if the processor has an instruction for that, else twice."""
    return a * x + y


def exact_fma(a: Number, x: Number, y: Number) -> Number:
    """The number a x + y, in compiled code always rounded once."""
    return a * x + y


def _emit(name: str, signature: Any, context: Any, builder: Any, arguments: Any) -> Any:
    """Emit a call of the LLVM intrinsic ``name``, "fma" or "fmuladd", which multiplies and adds numbers or lanes."""
    lanes = signature.return_type
    if not isinstance(lanes, Lanes):
        return call(builder, name, 0, *arguments)
    given = zip(arguments, signature.args, strict=True)
    return call(builder, name, lanes.n, *(broadcast(context, builder, v, t, lanes.n) for v, t in given))


def _signature(a: types.Type, x: types.Type, y: types.Type) -> Any:
    """Return the Numba signature of a x + y, for numbers (as doubles) or for lanes with lanes or numbers."""
    lanes = next((t for t in (a, x, y) if isinstance(t, Lanes)), None)
    return types.float64(types.float64, types.float64, types.float64) if lanes is None else lanes(a, x, y)


@intrinsic
def _fmuladd(typing_context: Any, a: types.Type, x: types.Type, y: types.Type) -> tuple:
    """The Numba intrinsic to which `fma` compiles."""
    return _signature(a, x, y), lambda context, builder, s, given: _emit("fmuladd", s, context, builder, given)


@intrinsic
def _fma(typing_context: Any, a: types.Type, x: types.Type, y: types.Type) -> tuple:
    """The Numba intrinsic to which `exact_fma` compiles."""
    return _signature(a, x, y), lambda context, builder, s, given: _emit("fma", s, context, builder, given)


def _known(*arguments: types.Type) -> bool:
    return all(isinstance(t, (Lanes, types.Float, types.Integer)) for t in arguments)


@overload(fma, jit_options=OPTIONS)
def _choose_fma(a, x, y):
    return (lambda a, x, y: _fmuladd(a, x, y)) if _known(a, x, y) else None


@overload(exact_fma, jit_options=OPTIONS)
def _choose_exact_fma(a, x, y):
    return (lambda a, x, y: _fma(a, x, y)) if _known(a, x, y) else None
