"""SIMD lanes: n doubles on which the processor works at once, as a Numba type that kernels compute with.

Compiled, lanes are one LLVM vector of n doubles, whatever the width of the processor's registers: wide registers hold
it in one, narrow ones in several, with the same results except for fused operations.  Lanes take part in sums, products
and quotients with lanes and scalars, in `abs` and `sqrt`, and in `sin`, `cos`, `exp` of `elementary`.  Uncompiled,
lanes are arrays (n,) of doubles or MPFR numbers, so that the same source runs.

Lanes are stored in the rows of a table: `take` reads a row and `put` writes one; ``like``, a tuple of n zeros, sets the
number of lanes.  `combine` is a linear combination of rows with the lanes as coefficients; `total` is the sum of the
lanes.
"""

from __future__ import annotations

import operator
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core.typeconv import Conversion
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, overload, register_model

from phasebench.integrators.compile.options import TUPLES, UNCALLED

if TYPE_CHECKING:
    from phasebench.integrators.values.kinds import Function, Number, Value

OPTIONS = {"forceinline": True, **TUPLES, **UNCALLED}
NUMBER = ir.DoubleType()
#: LLVM flags: products and sums may be fused, as everywhere; a sum over the lanes may be taken in any order.
FUSED, ANY_ORDER = ("contract",), ("contract", "reassoc", "nsz")


class Lanes(types.Type):
    """The Numba type of n doubles side by side in a vector register, one in each lane."""

    def __init__(self, n: int) -> None:
        self.n = n
        super().__init__(f"lanes({n})")

    def can_convert_from(self, typing_context: Any, other: types.Type) -> Conversion | None:
        """Accept scalars: a scalar converts to the same number in every lane."""
        return Conversion.safe if isinstance(other, (types.Integer, types.Float)) else None


@register_model(Lanes)
class _Model(models.PrimitiveModel):
    """The data model of the Numba type `Lanes`: an LLVM vector of doubles."""

    def __init__(self, manager: Any, lanes: Any) -> None:
        super().__init__(manager, lanes, ir.VectorType(NUMBER, lanes.n))


def broadcast(context: Any, builder: Any, value: Any, kind: Any, n: int) -> Any:
    """Emit LLVM code that converts a scalar, or lanes, to a vector of n doubles; ``kind`` is the value's Numba type."""
    if isinstance(kind, Lanes):
        return value
    number = context.cast(builder, value, kind, types.float64)
    vector = builder.insert_element(ir.VectorType(NUMBER, n)(ir.Undefined), number, _index(0))
    return builder.shuffle_vector(vector, vector, ir.VectorType(ir.IntType(32), n)([0] * n))


def _index(i: int) -> Any:
    return ir.IntType(32)(i)


def call(builder: Any, name: str, n: int, *vectors: Any, flags: Sequence[str] = ()) -> Any:
    """Emit a call of the LLVM intrinsic ``name`` on vectors of n doubles; on doubles if n is 0."""
    kind, name = (ir.VectorType(NUMBER, n), f"llvm.{name}.v{n}f64") if n else (NUMBER, f"llvm.{name}.f64")
    function = builder.module.globals.get(name)
    if function is None:
        function = ir.Function(builder.module, ir.FunctionType(kind, [kind] * len(vectors)), name)
    return builder.call(function, vectors, fastmath=flags)


# -- operators --------------------------------------------------------------------------------------------------------


def _operator(function: Function, instruction: str) -> None:
    """Define a Python operator between lanes and lanes or scalars by an LLVM instruction."""

    @infer_global(function)
    class _(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            lanes = [t for t in args if isinstance(t, Lanes)]
            known = all(isinstance(t, (Lanes, types.Float, types.Integer)) for t in args)
            return signature(lanes[0], *args) if len(args) == 2 and lanes and known else None

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        n = sig.return_type.n
        return getattr(builder, instruction)(
            *(broadcast(context, builder, x, t, n) for x, t in zip(args, sig.args, strict=True))
        )

    kinds = (types.Float, types.Integer)
    for pair in ((Lanes, Lanes), *((Lanes, k) for k in kinds), *((k, Lanes) for k in kinds)):
        lower_builtin(function, *pair)(lower)


for _function, _instruction in (
    (operator.add, "fadd"),
    (operator.sub, "fsub"),
    (operator.mul, "fmul"),
    (operator.truediv, "fdiv"),
    (operator.iadd, "fadd"),
):
    _operator(_function, _instruction)


def _unary(function: type | Function, emit: Function) -> None:
    """Define a Python function of one argument on lanes; ``emit`` writes its LLVM code."""

    @infer_global(function)
    class _(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            return signature(args[0], *args) if len(args) == 1 and isinstance(args[0], Lanes) else None

    lower_builtin(function, Lanes)(lambda context, builder, sig, args: emit(builder, sig.return_type.n, args[0]))


_unary(operator.neg, lambda builder, n, x: builder.fneg(x))
_unary(abs, lambda builder, n, x: call(builder, "fabs", n, x))
_unary(float, lambda builder, n, x: x)


def operation(compiled: Any) -> Function:
    """Return a decorator that replaces a plain NumPy function in compiled code by the Numba intrinsic ``compiled``.

    A call is replaced if one of its arguments is of the type `Lanes` or a tuple, such as ``like``, whose number of
    items is the number of lanes.
    """

    def decorate(function: Function) -> Function:
        names = ", ".join(function.__code__.co_varnames[: function.__code__.co_argcount])
        namespace = {"compiled": compiled, "__name__": __name__}
        exec(f"def typed({names}): return chosen({names})", namespace)
        exec(f"def impl({names}): return compiled({names})", namespace)
        impl = namespace["impl"]
        namespace["chosen"] = lambda *arguments: (
            impl if any(isinstance(a, (Lanes, types.BaseTuple)) for a in arguments) else None
        )
        overload(function, jit_options=OPTIONS)(namespace["typed"])
        return function

    return decorate


# -- rows of a table --------------------------------------------------------------------------------------------------


def offset_address(builder: Any, pointer: Any, offset: Any, kind: Any = None) -> Any:
    """Emit the address ``offset`` bytes after a pointer, as a pointer of the LLVM type ``kind`` (by default the same).

    It is computed from the pointer, so that LLVM knows that it lies in the pointer's array.  Where it was computed from
    integers, LLVM once did not know that, and Newton's method read a row of a table before the row was written.
    """
    address = builder.gep(builder.bitcast(pointer, ir.IntType(8).as_pointer()), [offset])
    return builder.bitcast(address, kind or pointer.type)


def _row_address(context: Any, builder: Any, table_type: Any, table: Any, row: Any, n: int) -> Any:
    """Emit the address of the first n numbers of a row of a table, as that of an LLVM vector."""
    array = context.make_array(table_type)(context, builder, table)
    strides = array.strides
    offset = builder.mul(row, builder.extract_value(strides, 0))
    return offset_address(builder, array.data, offset, ir.PointerType(ir.VectorType(NUMBER, n)))


@intrinsic
def _take(typing_context: Any, table: types.Type, row: types.Type, like: types.Type) -> tuple:
    """Read a row of a table as lanes, as many as ``like`` has: the Numba intrinsic to which `take` compiles."""

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        n = like.count
        return builder.load(_row_address(context, builder, table, args[0], args[1], n), align=8)

    return Lanes(like.count)(table, types.intp, like), codegen


@intrinsic
def _put(typing_context: Any, table: types.Type, row: types.Type, x: types.Type, like: types.Type) -> tuple:
    """Write lanes x into a row of a table: the Numba intrinsic to which `put` compiles."""

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        n = like.count
        vector = broadcast(context, builder, args[2], x, n)
        builder.store(vector, _row_address(context, builder, table, args[0], args[1], n), align=8)
        return context.get_dummy_value()

    return types.none(table, types.intp, x, like), codegen


@intrinsic
def _combine(
    typing_context: Any,
    x: types.Type,
    y: types.Type,
    factor: types.Type,
    table: types.Type,
    row: types.Type,
    like: types.Type,
) -> tuple:
    """Add to x a linear combination of rows of a table: the Numba intrinsic to which `combine` compiles."""

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        n = y.n
        sums = [None, None]
        for j in range(like.count):  # two sums, so that fewer operations wait for each other
            weight = builder.load(
                _row_address(context, builder, table, args[3], _next(builder, args[4], j), n), align=8
            )
            mask = ir.VectorType(ir.IntType(32), n)([j] * n)
            term = builder.fmul(weight, builder.shuffle_vector(args[1], args[1], mask), flags=FUSED)
            old = sums[j % 2]
            sums[j % 2] = term if old is None else builder.fadd(old, term, flags=FUSED)
        whole = sums[0] if sums[1] is None else builder.fadd(*sums, flags=FUSED)
        factors = broadcast(context, builder, args[2], factor, n)
        start = broadcast(context, builder, args[0], x, n)
        return builder.fadd(start, builder.fmul(factors, whole, flags=FUSED), flags=FUSED)

    return Lanes(y.n)(x, y, factor, table, types.intp, like), codegen


def _next(builder: Any, row: Any, j: int) -> Any:
    """Emit the sum of the indices row and j."""
    return builder.add(row, row.type(j))


@intrinsic
def _polynomial(typing_context: Any, coefficients: types.Type, z: types.Type, like: types.Type) -> tuple:
    """Evaluate a polynomial at each lane of z: the Numba intrinsic to which `polynomial` compiles."""

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        n = z.n

        def coefficient(k: int) -> Any:
            if isinstance(coefficients, types.UniTuple):
                return broadcast(context, builder, builder.extract_value(args[0], k), types.float64, n)
            return builder.shuffle_vector(args[0], args[0], ir.VectorType(ir.IntType(32), n)([k] * n))

        terms, power = [coefficient(k) for k in range(like.count)], args[1]
        while True:
            for k in range(len(terms) // 2):
                product = builder.fmul(terms[k + 1], power, flags=FUSED)
                terms[k : k + 2] = [builder.fadd(terms[k], product, flags=FUSED)]
            if len(terms) == 1:
                return terms[0]
            power = builder.fmul(power, power)

    return z(coefficients, z, like), codegen


@intrinsic
def _total(typing_context: Any, x: types.Type) -> tuple:
    """Sum the lanes of x: the Numba intrinsic to which `total` compiles."""

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        kind, name = ir.VectorType(NUMBER, x.n), f"llvm.vector.reduce.fadd.v{x.n}f64"
        function = builder.module.globals.get(name)
        if function is None:
            function = ir.Function(builder.module, ir.FunctionType(NUMBER, [NUMBER, kind]), name)
        return builder.call(function, [NUMBER(-0.0), args[0]], fastmath=ANY_ORDER)

    return types.float64(x), codegen


@operation(_take)
def take(table: np.ndarray, row: int, like: tuple) -> Number:
    """Read the row with index ``row`` of a table as lanes, as many as ``like`` has items."""
    return table[row, : len(like)].copy()


@operation(_put)
def put(table: np.ndarray, row: int, x: Number, like: tuple) -> None:
    """Write the lanes x, or one scalar for all of them, into a row of a table; ``like`` has as many items as lanes."""
    table[row, : len(like)] = x


@operation(_combine)
def combine(x: Number, y: Number, factor: Number, table: np.ndarray, row: int, like: tuple) -> Number:
    """x + factor * sum_j y[j] table[row + j], where j runs over the indices of ``like``; y and the result are lanes."""
    terms = [y[j] * table[row + j, : len(y)] for j in range(len(like))]
    return x + factor * sum(terms[1:], terms[0])


@operation(_polynomial)
def polynomial(coefficients: Value, z: Number, like: tuple) -> Number:
    """The polynomial with these coefficients, lowest power first, as many as ``like`` has items, at each lane of z.

    The coefficients are lanes or a tuple.  Compiled, neighbouring terms are added in pairs, then those sums in pairs,
    which shortens the chain of dependent operations (Estrin 1960).
    """
    y = coefficients[len(like) - 1] + 0 * z
    for k in range(len(like) - 2, -1, -1):
        y = y * z + coefficients[k]
    return y


@operation(_total)
def total(x: Number) -> Number:
    """The sum of the lanes of x, a number."""
    return np.sum(x)
