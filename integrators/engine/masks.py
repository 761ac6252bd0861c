"""Conditions on lanes, and what else a kernel needs to integrate several orbits in the lanes of its numbers.

Handed tuples of lanes, a kernel's source integrates as many orbits, operation by operation as for one: +, -, *, / and
the square root round alike, so that a lane's result is the scalar kernel's.  A number beside lanes is that number in
each.  A condition on lanes is a `Mask`: as a truth value it says whether it holds in any lane, and `select` chooses
lane by lane.  The functions of formulae are those of `elementary`; those that it lacks are called lane by lane.

There are as many lanes as the processor's registers hold, twice: two independent chains hide the latency of one.
"""

from __future__ import annotations

import math
import operator

import numpy as np
from llvmlite import binding, ir
from numba.core import config, types
from numba.core.datamodel import models
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, lower_cast, overload, register_model

from . import elementary
from .lanes import OPTIONS, Lanes, spread
from .vector import scale


class Mask(types.Type):
    """A truth value for each of n lanes."""

    def __init__(self, n: int):
        self.n = n
        super().__init__(f"mask({n})")


@register_model(Mask)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager, mask):
        super().__init__(manager, mask, ir.VectorType(ir.IntType(1), mask.n))


def _native() -> int:
    """Doubles in a register of the processor that is compiled for."""
    named = config.CPU_FEATURES
    features = binding.get_host_cpu_features() if named is None else {f[1:]: f[0] == "+" for f in named.split(",") if f}
    return 8 if features.get("avx512f") else 4 if features.get("avx") else 2


#: The lanes of orbits on this processor.
LANES = Lanes(2 * _native())


@lower_cast(types.Integer, Lanes)
@lower_cast(types.Float, Lanes)
def _same_number(context, builder, kind, lanes, value):
    if isinstance(kind, types.IntegerLiteral):
        kind, value = types.float64, context.get_constant(types.float64, float(kind.literal_value))
    return spread(context, builder, value, kind, lanes.n)


# -- conditions -------------------------------------------------------------------------------------------------------


def _comparison(function, sign: str):
    @infer_global(function)
    class _Template(AbstractTemplate):
        def generic(self, args, kws):
            known = all(isinstance(a, (Lanes, types.Integer, types.Float)) for a in args)
            lanes = next((a for a in args if isinstance(a, Lanes)), None)
            return signature(Mask(lanes.n), lanes, lanes) if known and lanes is not None else None

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
        bits = ir.IntType(mask.n)
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
    packed = builder.bitcast(value, ir.IntType(fromty.n))
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


def either(condition, a, b):
    """a where the condition holds, else b: numbers or tuples of them."""
    return a if condition else b


def number(condition) -> int:
    """In how many orbits a condition holds: of one alone it is 0 or 1."""
    return 1 if condition else 0


def outlived(going, kept, x):
    """(x, whether there is more to do): lanes that are ``going`` and not ``kept`` become NaN, the others go on."""
    return x, kept


def _of_lanes(function, in_lanes) -> None:
    """Let a function of conditions, the first of its arguments, be ``in_lanes`` where that is a mask."""
    names = ", ".join(function.__code__.co_varnames[: function.__code__.co_argcount])
    namespace = {"in_lanes": in_lanes, "alone": function, "Mask": Mask}
    exec(f"def typed({names}): return in_lanes if isinstance({names.split(',')[0]}, Mask) else alone", namespace)
    overload(function, jit_options=OPTIONS)(namespace["typed"])


_of_lanes(either, lambda condition, a, b: select(condition, a, b))
_of_lanes(number, lambda condition: count(condition))
_of_lanes(outlived, lambda going, kept, x: (select(going & ~kept, scale(np.nan, x), x), True))


# -- functions of formulae ---------------------------------------------------------------------------------------------


def _as_in(name: str) -> None:
    """Let a function of the module math take lanes: it is that of `elementary`."""
    of_lanes = getattr(elementary, name)

    @overload(getattr(math, name), jit_options=OPTIONS)
    def typed(x):
        return (lambda x: of_lanes(x)) if isinstance(x, Lanes) else None


for _name in ("sin", "cos", "exp", "sqrt"):
    _as_in(_name)


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

    @overload(function, jit_options=OPTIONS)
    def of_lanes(x):
        if not isinstance(x, Lanes):
            return None
        width = x.n

        def impl(x):
            out = x
            for i in range(width):
                out = _put(out, i, function(_taken(x, i)))
            return out

        return impl


for _function in (
    math.tan,
    math.log,
    math.sinh,
    math.cosh,
    math.tanh,
    math.asin,
    math.acos,
    math.atan,
):
    lane_by_lane(_function)


@overload(operator.pow, jit_options=OPTIONS)
def _power(x, n):
    if not isinstance(x, Lanes) or isinstance(n, Lanes):
        return None
    width = x.n

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
