"""a x + y, rounded once: one operation where the processor fuses product and sum, which the result waits for less long.

The compiler fuses of itself only a product that nothing else needs; here it is told to.  Where the processor cannot,
and uncompiled, it is a product and a sum.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.extending import intrinsic, overload

_DOUBLE = ir.DoubleType()


def fused(a, x, y):
    """a x + y."""
    return a * x + y


@intrinsic
def _of_numbers(typing_context, a, x, y):
    def codegen(context, builder, signature, arguments):
        kind = ir.FunctionType(_DOUBLE, [_DOUBLE] * 3)
        name = "llvm.fmuladd.f64"
        function = builder.module.globals.get(name) or ir.Function(builder.module, kind, name)
        return builder.call(function, arguments)

    return types.float64(types.float64, types.float64, types.float64), codegen


@overload(fused, jit_options={"forceinline": True, "_nrt": False})
def _numbers(a, x, y):
    if all(isinstance(t, (types.Float, types.Integer)) for t in (a, x, y)):
        return lambda a, x, y: _of_numbers(a, x, y)
    return None
