"""Lanes: a Numba type for doubles side by side in SIMD registers, one for each of several orbits.

A kernel's source is written for values (`vector`): tuples of doubles.  Handed tuples of `Lanes`, the same source
integrates as many orbits as there are lanes, operation by operation as for one: +, -, *, / and the square root round
alike, so that a lane's result is that of the scalar kernel.  A condition on lanes is a `Mask`: as a truth value it says
whether it holds in any lane, and `select` chooses lane by lane.  What has no vector instruction is called lane by lane,
or is a polynomial (`elementary`).

The width is that of the processor's registers, twice: two independent chains hide the latency of one.
"""

from __future__ import annotations

import math
import operator

import numpy as np
from llvmlite import binding, ir
from numba.core import cgutils, config, types
from numba.core.datamodel import models
from numba.core.typeconv import Conversion
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, lower_cast, overload, register_model

#: Options of what is compiled into its caller.
INLINED = {"forceinline": True}


class Lanes(types.Type):
    """So many doubles side by side."""

    def __init__(self, width: int):
        self.width = width
        super().__init__(f"Lanes({width})")

    def can_convert_from(self, typingctx, other):
        """A number is the same number in every lane."""
        return Conversion.safe if isinstance(other, (types.Integer, types.Float)) else None


class Mask(types.Type):
    """A truth value for each lane."""

    def __init__(self, width: int):
        self.width = width
        super().__init__(f"Mask({width})")


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, dmm, fe_type):
        super().__init__(dmm, fe_type, ir.VectorType(ir.DoubleType(), fe_type.width))


@register_model(Mask)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, dmm, fe_type):
        super().__init__(dmm, fe_type, ir.VectorType(ir.IntType(1), fe_type.width))


def _native() -> int:
    """Doubles in a register of the processor that is compiled for."""
    named = config.CPU_FEATURES
    features = binding.get_host_cpu_features() if named is None else {f[1:]: f[0] == "+" for f in named.split(",") if f}
    return 8 if features.get("avx512f") else 4 if features.get("avx") else 2


#: The lanes of this processor.
LANES = Lanes(2 * _native())


# -- arithmetic -------------------------------------------------------------------------------------------------------


def _lanes(*arguments) -> Lanes | None:
    """The type that lanes and numbers combine to; None where there is no lane among them, or something else."""
    if not all(isinstance(a, (Lanes, types.Integer, types.Float)) for a in arguments):
        return None
    return next((a for a in arguments if isinstance(a, Lanes)), None)


def _typed(function, result=lambda lanes: lanes):
    """Type a function of lanes and numbers."""

    @infer_global(function)
    class _Template(AbstractTemplate):
        def generic(self, args, kws):
            lanes = _lanes(*args)
            return None if lanes is None else signature(result(lanes), *[lanes] * len(args))

    return _Template


@lower_cast(types.Integer, Lanes)
@lower_cast(types.Float, Lanes)
def _spread(context, builder, fromty, toty, value):
    """The same number in every lane."""
    if isinstance(fromty, types.IntegerLiteral):
        value = context.get_constant(types.float64, float(fromty.literal_value))
    else:
        value = context.cast(builder, value, fromty, types.float64)
    vector = ir.VectorType(ir.DoubleType(), toty.width)
    one = builder.insert_element(ir.Constant(vector, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), toty.width), [0] * toty.width)
    return builder.shuffle_vector(one, ir.Constant(vector, ir.Undefined), zeros)


def _binary(name: str, *functions):
    for function in functions:
        _typed(function)

        @lower_builtin(function, Lanes, Lanes)
        def _lowered(context, builder, sig, args):
            return getattr(builder, name)(*args, flags=("contract",))


_binary("fadd", operator.add, operator.iadd)
_binary("fsub", operator.sub, operator.isub)
_binary("fmul", operator.mul, operator.imul)
_binary("fdiv", operator.truediv, operator.itruediv)


def _unary(name: str, *functions):
    for function in functions:
        _typed(function)

        @lower_builtin(function, Lanes)
        def _lowered(context, builder, sig, args):
            kind = args[0].type
            full, called = f"llvm.{name}.v{kind.count}f64", ir.FunctionType(kind, [kind])
            return builder.call(cgutils.get_or_insert_function(builder.module, called, full), args)


_unary("fabs", abs, math.fabs)
_unary("sqrt", math.sqrt)


def floor(x):
    """The largest whole number that is not above x, in each lane."""
    return np.floor(x)


_unary("floor", floor)
_typed(operator.neg)
_typed(operator.pos)


@lower_builtin(operator.neg, Lanes)
def _negative(context, builder, sig, args):
    return builder.fneg(args[0])


@lower_builtin(operator.pos, Lanes)
def _same(context, builder, sig, args):
    return args[0]


# -- conditions -------------------------------------------------------------------------------------------------------


def _comparison(function, sign: str):
    _typed(function, lambda lanes: Mask(lanes.width))

    @lower_builtin(function, Lanes, Lanes)
    def _lowered(context, builder, sig, args):
        compare = builder.fcmp_unordered if sign == "!=" else builder.fcmp_ordered
        return compare(sign, *args)


for _function, _sign in (
    (operator.lt, "<"),
    (operator.le, "<="),
    (operator.gt, ">"),
    (operator.ge, ">="),
    (operator.eq, "=="),
    (operator.ne, "!="),
):
    _comparison(_function, _sign)


def _logical(function, name: str):
    @infer_global(function)
    class _Template(AbstractTemplate):
        def generic(self, args, kws):
            if all(isinstance(a, Mask) for a in args):
                return signature(args[0], *args)
            return None

    @lower_builtin(function, *[Mask] * (1 if name == "not_" else 2))
    def _lowered(context, builder, sig, args):
        return getattr(builder, name)(*args)


_logical(operator.and_, "and_")
_logical(operator.or_, "or_")
_logical(operator.invert, "not_")


@intrinsic
def count(typingctx, mask):
    """In how many lanes a condition holds."""

    def codegen(context, builder, sig, args):
        bits = ir.IntType(mask.width)
        packed = builder.bitcast(args[0], bits)
        return builder.zext(builder.ctpop(packed), ir.IntType(64))

    return types.int64(mask), codegen


@intrinsic
def alike(typingctx, number, lanes):
    """The number in every lane, as many as ``lanes`` has."""

    def codegen(context, builder, sig, args):
        return context.cast(builder, args[0], number, lanes)

    return lanes(number, lanes), codegen


@infer_global(bool)
class _Any(AbstractTemplate):
    def generic(self, args, kws):
        if len(args) == 1 and isinstance(args[0], Mask):
            return signature(types.boolean, args[0])
        return None


@lower_builtin(bool, Mask)
def _any(context, builder, sig, args):
    return _truth(context, builder, sig.args[0], types.boolean, args[0])


@lower_cast(Mask, types.Boolean)
def _truth(context, builder, fromty, toty, value):
    packed = builder.bitcast(value, ir.IntType(fromty.width))
    return builder.icmp_unsigned("!=", packed, ir.Constant(packed.type, 0))


@intrinsic
def select(typingctx, mask, a, b):
    """The lanes of a where the mask holds, else those of b; a, b are lanes or tuples of them."""
    kind = a if isinstance(a, (Lanes, types.BaseTuple)) else b

    def codegen(context, builder, sig, args):
        chosen, a, b = args
        if isinstance(kind, Lanes):
            return builder.select(chosen, a, b)
        out = a
        for i in range(kind.count):
            x, y = (builder.extract_value(v, i) for v in (a, b))
            out = builder.insert_value(out, builder.select(chosen, x, y), i)
        return out

    return kind(mask, kind, kind), codegen


# -- what has no vector instruction -----------------------------------------------------------------------------------


@intrinsic
def _taken(typingctx, x, i):
    def codegen(context, builder, sig, args):
        return builder.extract_element(args[0], builder.trunc(args[1], ir.IntType(32)))

    return types.float64(x, types.intp), codegen


@intrinsic
def _put(typingctx, x, i, value):
    def codegen(context, builder, sig, args):
        return builder.insert_element(args[0], args[2], builder.trunc(args[1], ir.IntType(32)))

    return x(x, types.intp, types.float64), codegen


def lane_by_lane(function) -> None:
    """Let a function of one number take lanes: it is called for each."""

    @overload(function, jit_options=INLINED)
    def of_lanes(x):
        if not isinstance(x, Lanes):
            return None
        width = x.width

        def impl(x):
            out = x
            for i in range(width):
                out = _put(out, i, function(_taken(x, i)))
            return out

        return impl


for _function in (
    math.sin,
    math.cos,
    math.tan,
    math.exp,
    math.log,
    math.sinh,
    math.cosh,
    math.tanh,
    math.asin,
    math.acos,
    math.atan,
):
    lane_by_lane(_function)


@overload(operator.pow, jit_options=INLINED)
def _power(x, n):
    if not isinstance(x, Lanes) or isinstance(n, Lanes):
        return None
    width = x.width

    def impl(x, n):
        out = x
        for i in range(width):
            out = _put(out, i, _taken(x, i) ** n)
        return out

    return impl


def holds_lanes(arguments) -> bool:
    """Whether lanes, or tuples of them, are among the types of arguments."""
    return any(isinstance(getattr(a, "dtype", a), Lanes) for a in arguments)


def also_in_lanes(scalar, in_lanes):
    """The compiled function ``scalar`` that is ``in_lanes`` where an argument is a value of lanes."""
    if not hasattr(scalar, "get_call_template"):  # compilation is off
        return scalar
    call_template, overload_of = scalar.get_call_template, scalar.get_overload
    scalar.get_call_template = lambda args, kws: (
        in_lanes.get_call_template if holds_lanes((*args, *kws.values())) else call_template
    )(args, kws)
    scalar.get_overload = lambda sig: (in_lanes.get_overload if holds_lanes(sig) else overload_of)(sig)
    return scalar
