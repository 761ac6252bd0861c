"""Masks: conditions on SIMD lanes, and choices by them, so that one kernel can integrate several orbits at once.

Given tuples of lanes, a kernel's source integrates as many orbits as there are lanes.  Each lane gets the scalar
kernel's result, because +, -, *, / and the square root round the same way.  A scalar beside lanes stands for that
scalar in each.  A condition on lanes is a `Mask`: its truth value is whether it holds in any lane, and `select` chooses
lane by lane.  Functions in formulae are those of `elementary`; those missing there are called once for each lane.

There are twice as many lanes as a register of the processor holds doubles: two independent chains of operations hide
the latency of one.
"""

from __future__ import annotations

import inspect
import math
import operator
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from llvmlite import binding, ir
from numba.core import config, types
from numba.core.datamodel import models
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, lower_cast, overload, register_model

from phasebench.integrators.compile.options import UNCALLED

from . import elementary
from .lanes import OPTIONS, Lanes, broadcast
from .vector import PLACES, scale

if TYPE_CHECKING:
    from phasebench.integrators.values.kinds import Function


class Mask(types.Type):
    """The Numba type of a truth value for each of n lanes."""

    def __init__(self, n: int) -> None:
        self.n = n
        super().__init__(f"mask({n})")


@register_model(Mask)
class _MaskModel(models.PrimitiveModel):
    """The data model of the Numba type `Mask`: an LLVM vector of n bits."""

    def __init__(self, manager: Any, mask: Any) -> None:
        super().__init__(manager, mask, ir.VectorType(ir.IntType(1), mask.n))


def _native() -> int:
    """Return how many doubles a register of the target processor holds."""
    named = config.CPU_FEATURES
    features = binding.get_host_cpu_features() if named is None else {f[1:]: f[0] == "+" for f in named.split(",") if f}
    return 8 if features.get("avx512f") else 4 if features.get("avx") else 2


#: The type of lanes in which orbits are integrated on this processor.
LANES = Lanes(2 * _native())


@lower_cast(types.Integer, Lanes)
@lower_cast(types.Float, Lanes)
def _broadcast(context: Any, builder: Any, kind: Any, lanes: Any, value: Any) -> Any:
    """Emit LLVM code that converts a scalar to lanes, each of which gets the scalar."""
    if isinstance(kind, types.IntegerLiteral):
        kind, value = types.float64, context.get_constant(types.float64, float(kind.literal_value))
    return broadcast(context, builder, value, kind, lanes.n)


# -- conditions -------------------------------------------------------------------------------------------------------


def _comparison(function: Function, sign: str) -> None:
    """Define in Numba a comparison of SIMD lanes, which gives a `Mask`; NaN compares as in IEEE arithmetic."""

    @infer_global(function)
    class _Template(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            known = all(isinstance(a, (Lanes, types.Integer, types.Float)) for a in args)
            lanes = next((a for a in args if isinstance(a, Lanes)), None)
            return signature(Mask(lanes.n), lanes, lanes) if known and lanes is not None else None

    @lower_builtin(function, Lanes, Lanes)
    def _lowered(context: Any, builder: Any, sig: Any, args: Any) -> Any:
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


def _logical(function: Function, name: str) -> None:
    """Define in Numba a logical operator between masks; ``name`` is that of LLVM's instruction."""

    @infer_global(function)
    class _Template(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            if all(isinstance(a, Mask) for a in args):
                return signature(args[0], *args)
            return None

    @lower_builtin(function, *[Mask] * (1 if name == "not_" else 2))
    def _lowered(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return getattr(builder, name)(*args)


_logical(operator.and_, "and_")
_logical(operator.or_, "or_")
_logical(operator.invert, "not_")


@intrinsic
def count(typingctx: Any, mask: types.Type) -> tuple:
    """The number of lanes in which a condition holds."""

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        bits = ir.IntType(mask.n)
        packed = builder.bitcast(args[0], bits)
        return builder.zext(builder.ctpop(packed), ir.IntType(64))

    return types.int64(mask), codegen


@intrinsic
def broadcast_like(typingctx: Any, number: types.Type, lanes: types.Type) -> tuple:
    """Return lanes of the type of ``lanes``, each of which has the scalar ``number``."""

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return context.cast(builder, args[0], number, lanes)

    return lanes(number, lanes), codegen


@infer_global(bool)
class _Any(AbstractTemplate):
    """Tell Numba that bool(mask) is a truth value."""

    def generic(self, args: Any, kws: Any) -> Any:
        if len(args) == 1 and isinstance(args[0], Mask):
            return signature(types.boolean, args[0])
        return None


@lower_builtin(bool, Mask)
def _any(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    """Emit the LLVM code of bool(mask): True if the condition holds in any lane."""
    return _truth(context, builder, sig.args[0], types.boolean, args[0])


@lower_cast(Mask, types.Boolean)
def _truth(context: Any, builder: Any, fromty: Any, toty: Any, value: Any) -> Any:
    """Emit the LLVM code that converts a mask to a truth value: True if the condition holds in any lane."""
    packed = builder.bitcast(value, ir.IntType(fromty.n))
    return builder.icmp_unsigned("!=", packed, ir.Constant(packed.type, 0))


@intrinsic
def select(typingctx: Any, mask: types.Type, a: types.Type, b: types.Type) -> tuple:
    """Choose a in the lanes where the mask holds, b in the others; a and b are lanes or tuples of lanes."""
    kind = a if isinstance(a, (Lanes, types.BaseTuple)) else b

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        chosen, a, b = args
        if isinstance(kind, Lanes):
            return builder.select(chosen, a, b)
        out = a
        for i in range(kind.count):
            x, y = (builder.extract_value(v, i) for v in (a, b))
            out = builder.insert_value(out, builder.select(chosen, x, y), i)
        return out

    return kind(mask, kind, kind), codegen


def where(condition, a, b):
    """Choose a where the condition holds, else b; for SIMD lanes lane by lane (`select`).

    a and b are numbers, lanes, or tuples of these.
    """
    return a if condition else b


def number(condition):
    """The number of lanes in which a condition holds; 0 or 1 for a scalar condition."""
    return 1 if condition else 0


def fails(condition):
    """True where the condition does not hold: its negation, for scalars and masks."""
    return not condition


def retire_lanes(going, kept, x):
    """Give up the lanes that failed, so that the other lanes go on; return (x, whether the caller goes on).

    ``going`` is the condition that a lane is still being computed, ``kept`` that it has not failed.  With masks, x
    becomes NaN in the lanes where ``going`` holds and ``kept`` does not, and the second result is True.  With scalar
    conditions x stays as it is, and the second result is ``kept``.
    """
    return x, kept


def _overload_for_masks(function: Function, in_lanes: Function, options: dict = OPTIONS) -> None:
    """Make Numba compile a function to ``in_lanes`` where its first argument, a condition, is a `Mask`.

    ``options`` are options of Numba's ``njit`` for both versions.
    """
    names = ", ".join(function.__code__.co_varnames[: function.__code__.co_argcount])
    namespace = {"in_lanes": in_lanes, "alone": function, "Mask": Mask}
    exec(f"def typed({names}): return in_lanes if isinstance({names.split(',')[0]}, Mask) else alone", namespace)
    overload(function, jit_options=options | UNCALLED)(namespace["typed"])


_overload_for_masks(where, lambda condition, a, b: select(condition, a, b))
_overload_for_masks(number, lambda condition: count(condition))
_overload_for_masks(fails, lambda condition: ~condition)
# x may be an array of a caller that counts references.
_overload_for_masks(retire_lanes, lambda going, kept, x: (select(going & ~kept, scale(np.nan, x), x), True), PLACES)


# -- functions of formulae ---------------------------------------------------------------------------------------------


def _use_elementary(name: str) -> None:
    """Make Numba compile the function ``name`` of the module math to its namesake in `elementary` for SIMD lanes."""
    of_lanes = getattr(elementary, name)

    @overload(getattr(math, name), jit_options=OPTIONS)
    def typed(x):
        return (lambda x: of_lanes(x)) if isinstance(x, Lanes) else None


for _name in ("sin", "cos", "exp", "sqrt", "sinh", "cosh", "tanh"):
    _use_elementary(_name)


@intrinsic
def _lane(typingctx: Any, x: types.Type, i: types.Type) -> tuple:
    """The number in lane i of the lanes x."""

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.extract_element(args[0], builder.trunc(args[1], ir.IntType(32)))

    return types.float64(x, types.intp), codegen


@intrinsic
def _with_lane(typingctx: Any, x: types.Type, i: types.Type, value: types.Type) -> tuple:
    """A copy of the lanes x with the number ``value`` in lane i."""

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.insert_element(args[0], args[2], builder.trunc(args[1], ir.IntType(32)))

    return x(x, types.intp, types.float64), codegen


def overload_lane_by_lane(function: Function) -> None:
    """Overload a function of one number for SIMD lanes, by calling it for each lane."""

    @overload(function, jit_options=OPTIONS)
    def of_lanes(x):
        if not isinstance(x, Lanes):
            return None
        width = x.n

        def impl(x):
            out = x
            for i in range(width):
                out = _with_lane(out, i, function(_lane(x, i)))
            return out

        return impl


for _function in (
    math.tan,
    math.log,
    math.asin,
    math.acos,
    math.atan,
):
    overload_lane_by_lane(_function)


@overload(operator.pow, jit_options=OPTIONS)
def _power(x, n):
    """x**n of lanes x and a number n, computed for each lane."""
    if not isinstance(x, Lanes) or isinstance(n, Lanes):
        return None
    width = x.n

    def impl(x, n):
        out = x
        for i in range(width):
            out = _with_lane(out, i, _lane(x, i) ** n)
        return out

    return impl


def holds_lanes(arguments: Iterable[types.Type]) -> bool:
    """True if lanes, or tuples of them, are among the types of the arguments."""
    return any(isinstance(getattr(a, "dtype", a), Lanes) for a in arguments)


def overload_in_lanes(scalar: Function, in_lanes: Function) -> Function:
    """Return a function that is ``in_lanes`` if an argument has SIMD lanes, else ``scalar``, chosen at compile time."""
    names = ", ".join(inspect.signature(scalar).parameters)
    namespace = {"__name__": __name__, "scalar": scalar, "in_lanes": in_lanes, "holds_lanes": holds_lanes}
    exec(f"def pick({names}):\n  return scalar({names})", namespace)
    exec(f"def typed({names}):\n  return in_lanes if holds_lanes(({names},)) else scalar", namespace)
    overload(namespace["pick"], jit_options=PLACES | UNCALLED)(namespace["typed"])
    return namespace["pick"]
