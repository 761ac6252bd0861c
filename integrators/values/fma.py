"""Fused multiply-add: a x + y rounded once, as one instruction where the processor has it.

It shortens the chain of operations that a step waits for.  By itself the compiler fuses only products that nothing else
uses; `fma` asks for it explicitly.  On processors without the instruction, and in uncompiled code, it is a product and
a sum, each rounded.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.extending import intrinsic, overload

_DOUBLE = ir.DoubleType()


def fma(a, x, y):
    """a x + y."""
    return a * x + y


@intrinsic
def _fma_of_doubles(typing_context, a, x, y):
    """LLVM's fused multiply-add of doubles."""

    def codegen(context, builder, signature, arguments):
        kind = ir.FunctionType(_DOUBLE, [_DOUBLE] * 3)
        name = "llvm.fmuladd.f64"
        function = builder.module.globals.get(name) or ir.Function(builder.module, kind, name)
        return builder.call(function, arguments)

    return types.float64(types.float64, types.float64, types.float64), codegen


@overload(fma, jit_options={"forceinline": True, "_nrt": False})
def _choose_fma(a, x, y):
    """Choose `_fma_of_doubles` for scalars."""
    if all(isinstance(t, (types.Float, types.Integer)) for t in (a, x, y)):
        return lambda a, x, y: _fma_of_doubles(a, x, y)
    return None
