"""The vector operations in which kernels are written, for tuples, arrays and SIMD lanes alike.

A kernel treats ``q`` and ``p`` as *values*.  Each operation below is one plain NumPy expression, which works as it
stands on arrays of doubles and on object arrays of MPFR numbers.  Compiled, the same expression is unrolled for tuples
of doubles (small ``d``: the state lives in registers), and left to Numba for arrays (large ``d``).

`add` is the compensated sum x + (dx + c): it returns the new value and the part of the increment that rounding
lost (Kahan 1965; Moller 1965, "Quasi double-precision in floating point addition", BIT 5, 37-50).
"""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numba import config, njit, types
from numba.core import cgutils
from numba.extending import intrinsic, overload
from numba.np import arrayobj

from phasebench.integrators.compile.options import ARRAYS, COMMON, TUPLES, UNCALLED

from .fma import fma
from .lanes import offset_address

if TYPE_CHECKING:
    from phasebench.integrators.stepping.kernel import Carry, Samples
    from phasebench.integrators.values.kinds import Function, Value


def _holds_vectors(t: types.Type) -> bool:
    """True if a Numba type is, or contains, a vector (d,) of doubles: a value of large d.

    Tables have two axes and arrays of coefficients are read-only, so that neither counts as a vector.
    """
    if isinstance(t, types.Array):
        return t.ndim == 1 and t.mutable and isinstance(t.dtype, types.Float)
    return isinstance(t, types.BaseTuple) and any(map(_holds_vectors, t))


#: Options of functions that only other compiled functions call.  An option that is not set is inherited from the
#: caller; `forceinline` must not be.
PART = COMMON | {"forceinline": False}


def jit(f: Function) -> Function:
    """Compile ``f`` by Numba as a function of its own, not inlined, with the options of its caller; a decorator."""
    return njit(**PART, no_cfunc_wrapper=True)(_rename_by_content(f))


def part(f: Function) -> Function:
    """Compile ``f`` like `jit`, without entries for Python and C: compiled code alone may call it; a decorator."""
    return njit(**PART, **UNCALLED)(_rename_by_content(f))


def inline(f: Function) -> Function:
    """Inline ``f`` by Numba into its caller, with the caller's options; a decorator for the operations of a step."""
    return njit(**COMMON, inline="always")(f)


def _rename_by_content(f: Function) -> Function:
    """Add to the name of a closure a hash of its code and of the objects that it encloses; return the function.

    A function that encloses nothing keeps its name.  Machine code is linked by name: closures of the same name that
    enclose different constants or functions could be mistaken for each other where both are loaded.
    """
    if f.__closure__:
        made_of = [getattr(c.cell_contents, "__qualname__", repr(c.cell_contents)) for c in f.__closure__]
        content = repr((f.__code__.co_code, made_of))
        f.__qualname__ = f"{f.__qualname__}_{hashlib.sha256(content.encode()).hexdigest()[:12]}"
    return f


@intrinsic
def _mark_noinline(typing_context: Any) -> tuple:
    """Mark the function that contains this call as never to be inlined."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        builder.function.attributes.add("noinline")
        return context.get_dummy_value()

    return types.none(), codegen


#: Call it first in a function to keep that from being inlined: code that is long and rarely runs is compiled once then.
forbid_inlining = (lambda: None) if config.DISABLE_JIT else _mark_noinline


def _overload_by_source(
    fn: Function, template: Function, loop: Function | None = None, loop_options: dict = ARRAYS
) -> Function:
    """Make Numba compile ``fn`` from generated source text where its arguments are tuples or arrays; returns ``fn``.

    ``template(names, arguments)`` returns the body of the function for tuples, ``loop(names, arguments)`` that for
    arrays, from the names and Numba types of the arguments.  Without ``loop`` arrays use ``fn`` as it stands.
    ``loop_options`` are the options of Numba's ``njit`` for arrays.
    """
    names = list(inspect.signature(fn).parameters)

    def build_function(kind: Function | None, arguments: Sequence[types.Type]) -> Function:
        if kind is None:
            return fn
        namespace, text = {"__name__": __name__, "scalar": inline(fn), "np": np}, kind(names, arguments)
        name = f"{fn.__name__}_{hashlib.sha256(text.encode()).hexdigest()[:12]}"  # see `_rename_by_content`
        exec(f"def {name}({', '.join(names)}):\n{text}", namespace)
        return namespace[name]

    def for_tuples(*arguments: types.Type) -> Function | None:
        return build_function(template, arguments) if any(isinstance(a, types.BaseTuple) for a in arguments) else None

    def for_arrays(*arguments: types.Type) -> Function | None:
        return None if any(isinstance(a, types.BaseTuple) for a in arguments) else build_function(loop, arguments)

    for build, options in ((for_tuples, {"forceinline": True, **TUPLES}), (for_arrays, loop_options)):
        namespace = {"__name__": __name__, "build": build}
        exec(f"def typed({', '.join(names)}): return build({', '.join(names)})", namespace)
        overload(fn, jit_options=options | UNCALLED)(namespace["typed"])
    return fn


def _length(arguments: Sequence[types.Type]) -> int:
    """Return the number of components of the first tuple among the Numba types of arguments."""
    return next(a.count for a in arguments if isinstance(a, types.BaseTuple))


def elementwise(outputs: int = 1) -> Function:
    """Return a decorator for functions that are one NumPy expression in vectors, with ``outputs`` results.

    Numba compiles the decorated function for tuples, component by component, and for arrays.
    """

    def template(names: Sequence[str], arguments: Sequence[types.Type]) -> str:
        def call(i: int) -> str:
            parts = (
                f"{n}[{i}]" if isinstance(a, types.BaseTuple) else n for n, a in zip(names, arguments, strict=True)
            )
            return f"scalar({', '.join(parts)})"

        d = _length(arguments)
        if outputs == 1:
            return f"  return {_tuple_text(call(i) for i in range(d))}"
        lines = [f"  r{i} = {call(i)}" for i in range(d)]
        packed = (_tuple_text(f"r{i}[{k}]" for i in range(d)) for k in range(outputs))
        return "\n".join([*lines, f"  return {', '.join(packed)}"])

    def loop(names: Sequence[str], arguments: Sequence[types.Type]) -> str:
        """Write the text of one pass over the components of arrays, which gives all results of the function.

        Numba's own loop for an array expression has a single output.
        """
        vectors = [n for n, a in zip(names, arguments, strict=True) if isinstance(a, types.Array)]
        parts = (f"{n}[i]" if n in vectors else n for n in names)
        results = [f"r{k}" for k in range(outputs)]
        return "\n".join(
            [
                f"  n = len({vectors[0]})",
                *(f"  {r} = np.empty(n)" for r in results),
                "  for i in range(n):",
                f"    {', '.join(f'{r}[i]' for r in results)} = scalar({', '.join(parts)})",
                f"  return {', '.join(results)}",
            ]
        )

    return lambda fn: _overload_by_source(fn, template, loop if outputs > 1 else None)


def unroll(template: Callable[[int], str], loop: str = "") -> Function:
    """Return a decorator for functions of vectors that Numba compiles for tuples from the source text ``template(d)``.

    d is the number of items of the tuples, the text the body of the function.  For arrays the body is the text
    ``loop``; without it, the function as it stands.
    """
    on_arrays = (lambda names, arguments: loop) if loop else None
    return lambda fn: _overload_by_source(fn, lambda names, arguments: template(_length(arguments)), on_arrays)


def sum_of(term: str) -> Function:
    """Return a decorator for functions of vectors that Numba compiles to the sum over i of the source text ``term``.

    The text refers to components by the index ``[i]``.

    The sum of an array may be taken in any order, so that the compiler keeps several partial sums.
    """

    def template(names: Sequence[str], arguments: Sequence[types.Type]) -> str:
        return "  return " + " + ".join(term.replace("[i]", f"[{i}]") for i in range(_length(arguments)))

    def loop(names: Sequence[str], arguments: Sequence[types.Type]) -> str:
        return f"  s = 0.0\n  for i in range(len({names[0]})):\n    s += {term}\n  return s"

    return lambda fn: _overload_by_source(fn, template, loop, ARRAYS | {"fastmath": {"contract", "reassoc", "nsz"}})


def _tuple_text(items: Iterable[str]) -> str:
    """Return the source text of a tuple of these items, which are source texts.

    Python builds a tuple of more than 30 items from a list, which Numba does not compile; so it is a sum of shorter
    ones.
    """
    items = list(items)
    return " + ".join(f"({', '.join(items[i : i + 30])},)" for i in range(0, len(items), 30))


def _tuple(d: int, item: str) -> str:
    """Return the source text of "return" with a tuple of d items: ``item`` with the index i filled in."""
    return "  return " + _tuple_text(item.format(i=i) for i in range(d))


@elementwise()
def axpy(a, x, y):
    """The vector a x + y."""
    return y + a * x


@elementwise()
def scale(a, x):
    """The vector a x."""
    return a * x


@elementwise()
def plus(x, y):
    """The vector x + y."""
    return x + y


@elementwise()
def minus(x, y):
    """The vector x - y."""
    return x - y


@elementwise(outputs=2)
def add(x, c, dx):
    """The compensated sum of x + c and dx: (the sum, the part of it that rounding lost).

    Only one addition waits for dx, which comes last in the chain of operations of a step.  The part of c that x + c
    does not show stays in the second result, so that nothing is lost.
    """
    t = (x + c) + dx
    return t, (dx + c) - (t - x)


@elementwise(outputs=2)
def add_product(x, c, a, v):
    """The compensated sum of x + c and a v: (the sum, the part of it that rounding lost).

    The product a v is not rounded, neither in the sum nor in the lost part.  The error left is the rounding of (a v +
    c), of the difference (sum - x), and of the lost part itself.
    """
    t = fma(a, v, x + c)
    return t, fma(a, v, c) - (t - x)


@sum_of("abs(x[i])")
def size(x):
    """The 1-norm of x; NaN if a component is NaN."""
    return np.sum(np.abs(x))


@sum_of("abs(x[i] - y[i])")
def distance(x, y):
    """The 1-norm of x - y; NaN if a component is NaN."""
    return np.sum(np.abs(x - y))


@unroll(lambda d: _tuple(d, "x[{i}] + (a if i == {i} else 0.0)"))
def bump(x, i, a):
    """A copy of the vector x with a added to component i."""
    y = x.copy()
    y[i] = y[i] + a
    return y


@unroll(lambda d: "  return x + y")
def join(x, y):
    """The components of x followed by those of y."""
    return np.concatenate((x, y))


@unroll(lambda d: _tuple(d // 2, "x[{i}]"))
def head(x):
    """The first half of x."""
    return x[: len(x) // 2]


@unroll(lambda d: f"  return ({', '.join(f'x[{i}]' for i in range(d // 2, d))},)")
def tail(x):
    """The second half of x."""
    return x[len(x) // 2 :]


@unroll(lambda d: _tuple(d, "A[i, {i}]"))
def load(A, i, like):
    """Row i of the table A as a value of the same kind and length as ``like``."""
    return A[i, : len(like)].copy()


# A loop, because assigning to a slice would compile the error message for unequal lengths into every caller.
@unroll(lambda d: "\n".join(f"  A[i, {j}] = x[{j}]" for j in range(d)), "  for j in range(len(x)): A[i, j] = x[j]")
def store(A, i, x):
    """Write x into row i of the table A."""
    A[i, : len(x)] = x


class State(NamedTuple):
    """The state of a step: the vectors q and p, and what rounding lost of each in compensated summation."""

    q: Value
    p: Value
    lost_q: Value
    lost_p: Value


@inline
def update(y: State, dq: Value, dp: Value) -> State:
    """The state y after the increments dq and dp, added with compensation."""
    q, lost_q = add(y.q, y.lost_q, dq)
    p, lost_p = add(y.p, y.lost_p, dp)
    return State(q, p, lost_q, lost_p)


@inline
def load_state(rows: np.ndarray, at: int, like: Value) -> State:
    """Read a state from four rows of a table: q, p and what rounding lost of each, values of the kind of ``like``."""
    return State(load(rows, at, like), load(rows, at + 1, like), load(rows, at + 2, like), load(rows, at + 3, like))


@inline
def store_state(rows: np.ndarray, at: int, y: State) -> None:
    """Write the state y to four rows of a table, from where `load_state` reads it."""
    store(rows, at, y.q)
    store(rows, at + 1, y.p)
    store(rows, at + 2, y.lost_q)
    store(rows, at + 3, y.lost_p)


@inline
def read_state(carry: Carry) -> State:
    """Read the state of a step from ``carry``, where the kernel's last call left it."""
    return load_state(carry.state, 0, carry.zero)


@inline
def write_state(carry: Carry, y: State) -> None:
    """Write the state y to ``carry``, from where the kernel's next call goes on."""
    store_state(carry.state, 0, y)


@inline
def write_sample(samples: Samples, row: int, y: State) -> None:
    """Write q and p of the state y into row ``row`` of the arrays ``samples.q`` and ``samples.p`` of stored states."""
    store(samples.q, row, y.q)
    store(samples.p, row, y.p)


def dispatch_on_none(when_none: Function, otherwise: Function) -> Function:
    """Return a function that calls ``when_none`` if its first argument is None, else ``otherwise``.

    Compiled code chooses by the type of the argument, when it is compiled.
    """
    names = ", ".join(inspect.signature(otherwise).parameters)
    first = names.split(",")[0]
    namespace = {"__name__": __name__, "a": when_none, "b": otherwise, "none": types.NoneType, "omitted": types.Omitted}
    exec(f"def pick({names}):\n  return a({names}) if {first} is None else b({names})", namespace)
    exec(f"def kind({names}):\n  return a if isinstance({first}, (none, omitted)) else b", namespace)
    namespace["holds"] = lambda *arguments: any(map(_holds_vectors, arguments))
    for vectors, options in ((False, {"forceinline": True, **TUPLES}), (True, ARRAYS)):
        exec(f"def typed({names}):\n  return kind({names}) if holds({names}) == {vectors} else None", namespace)
        overload(namespace["pick"], jit_options=options | UNCALLED)(namespace["typed"])
    return namespace["pick"]


#: The velocity grad T(p); ``dT`` is None where that is p itself.
velocity = dispatch_on_none(lambda dT, p: p, lambda dT, p: dT(p))


# -- in place ---------------------------------------------------------------------------------------------------------
#
# At a hundred degrees of freedom a step on arrays spends most of its time allocating new ones.  The operations below
# may overwrite arguments that the caller no longer needs; on tuples and on MPFR numbers they are operations like the
# others.  A kernel made of these alone allocates nothing (`inplace`).


#: Options of operations in place, which are always inlined: passing arrays to a function costs more than the work on a
#: hundred numbers.  Whether references are counted is left to the caller.
PLACES = COMMON | {"forceinline": True}


def force_inline(f: Function) -> Function:
    """Let LLVM inline ``f`` into every caller, with the caller's options; a decorator for what every step calls."""
    return njit(**PLACES)(f)


def overload_by_kind(function: Function, on_values: Function, on_arrays: Function) -> None:
    """Overload a function by kind of argument: Numba compiles another function if a vector is stored as an array.

    ``on_arrays`` is called if one of the arguments is such a vector, else ``on_values``; each is called with the Numba
    types of the arguments and returns the function to compile.
    """
    names = ", ".join(inspect.signature(function).parameters)
    for vectors, chosen_for, options in (
        (False, on_values, {"forceinline": True, **TUPLES}),
        (True, on_arrays, PLACES),
    ):
        namespace = {"__name__": __name__, "chosen_for": chosen_for}
        namespace["fit"] = lambda *arguments, wanted=vectors: any(map(_holds_vectors, arguments)) == wanted
        exec(f"def typed({names}):\n  return chosen_for({names}) if fit({names}) else None", namespace)
        overload(function, jit_options=options | UNCALLED)(namespace["typed"])


def in_place(on_arrays: Function | None) -> Function:
    """Return a decorator: Numba compiles ``on_arrays`` in place of the function where an argument is a vector (array).

    For tuples and SIMD lanes the decorated function itself is compiled, and for arrays too if ``on_arrays`` is None.
    """

    def decorate(on_values: Function) -> Function:
        overload_by_kind(on_values, lambda *arguments: on_values, lambda *arguments: on_arrays or on_values)
        return on_values

    return decorate


def writes(f: types.Type) -> bool:
    """True if the type is that of a function that writes its results into its last arguments (`inplace`)."""
    return isinstance(f, types.FunctionType) and f.signature.return_type == types.none


@intrinsic
def _part_of_row(typing_context: Any, A: types.Type, i: types.Type, first: types.Type, n: types.Type) -> tuple:
    """A view of n numbers of row i of A from column ``first`` on.

    The view holds no counted reference to A, which is safe because the table outlives the compiled loop.
    """
    kind = types.Array(types.float64, 1, "C")

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        table, row, first, n = arguments
        source = arrayobj.make_array(signature.args[0])(context, builder, table)
        size, width = context.get_constant(types.intp, 8), cgutils.unpack_tuple(builder, source.strides)[0]
        offset = builder.add(builder.mul(row, width), builder.mul(first, size))
        out = arrayobj.make_array(kind)(context, builder)
        place = offset_address(builder, source.data, offset)
        arrayobj.populate_array(out, data=place, shape=[n], strides=[size], itemsize=size, meminfo=None)
        return out._getvalue()

    return kind(A, types.intp, types.intp, types.intp), codegen


def _rows(A, i, j, like):
    """Views of the rows i and j of A, as long as ``like``: what `rows` compiles to for arrays."""
    return _part_of_row(A, i, 0, len(like)), _part_of_row(A, j, 0, len(like))


@in_place(_rows)
def rows(A, i, j, like):
    """Rows i and j of the table A, of the kind of ``like``; if that is an array, views: writing to them changes A."""
    return load(A, i, like), load(A, j, like)


def _halves(A, i, like):
    """Views of the two halves of row i of A, each as long as ``like``: what `halves` compiles to for arrays."""
    return _part_of_row(A, i, 0, len(like)), _part_of_row(A, i, len(like), len(like))


@in_place(_halves)
def halves(A, i, like):
    """The two halves of row i of A, of the kind of ``like``; if that is an array, views: writing to them changes A."""
    x = load(A, i, join(like, like))
    return head(x), tail(x)


@inline
def view_state(carry: Carry) -> State:
    """The `State` in rows 0 to 3 of ``carry.state``, as from `read_state`; for arrays, views of the rows, no copies."""
    q, p = rows(carry.state, 0, 1, carry.zero)
    lost_q, lost_p = rows(carry.state, 2, 3, carry.zero)
    return State(q, p, lost_q, lost_p)


def _add_product_in_place(x, c, a, v):
    """Implementation of `add_product_in_place` for arrays: overwrites x and c."""
    for i in range(len(x)):
        t = fma(a, v[i], x[i] + c[i])
        c[i] = fma(a, v[i], c[i]) - (t - x[i])
        x[i] = t
    return x, c


@in_place(_add_product_in_place)
def add_product_in_place(x, c, a, v):
    """The compensated sum of x + c and a v (`add_product`), written over x and c where these are arrays."""
    return add_product(x, c, a, v)


@unroll(lambda d: _tuple(d, "f[{i}] * x[{i}]"))
def times(f, x):
    """The componentwise product f * x; f is an array of coefficients."""
    return f * x


def in_registers(results: types.Type, arguments: Iterable[types.Type]) -> bool:
    """True if a function maps a tuple of one or two doubles to one of the same size, which C returns in registers.

    ``results`` and ``arguments`` are the Numba types of the function's result and of its arguments.
    """
    small = isinstance(results, types.UniTuple) and results.dtype == types.float64 and results.count <= 2
    return small and tuple(arguments) == (results,)


@intrinsic
def _call_entry(typing_context: Any, f: types.Type, x: types.Type) -> tuple:
    """Call f(x) through the C entry point of f, a compiled function passed as a pointer.

    Numba's own call returns the result in memory, for which the operations that use it would have to wait.
    """

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        address = cgutils.create_struct_proxy(f)(context, builder, value=arguments[0]).c_addr
        return builder.call(builder.bitcast(address, context.get_value_type(f.ftype)), arguments[1:])

    return f.signature.return_type(f, x), codegen


def apply(f, x, old):
    """Return f(x); x if f is None, and f * x, componentwise, if f is an array of coefficients.

    In compiled code the result is written over ``old``, a vector that is no longer needed, if that is an array.
    """
    if f is None:
        return x
    return times(f, x) if isinstance(f, np.ndarray) else f(x)


def _apply_values(f: types.Type, x: types.Type, old: types.Type) -> Callable:
    """Choose what `apply` compiles to if x is no array, from the Numba types of f, x and old."""
    if isinstance(f, (types.NoneType, types.Omitted)):
        return lambda f, x, old: x
    if isinstance(f, types.Array):
        return lambda f, x, old: times(f, x)
    if isinstance(f, types.FunctionType) and in_registers(f.signature.return_type, f.signature.args):
        return lambda f, x, old: _call_entry(f, x)
    return lambda f, x, old: f(x)


def _apply_arrays(f: types.Type, x: types.Type, old: types.Type) -> Callable:
    """Choose what `apply` compiles to if x is an array, from the Numba types of f, x and old."""

    def fill(f, x, old):
        f(x, old)
        return old

    def multiply(f, x, old):
        for i in range(len(x)):
            old[i] = f[i] * x[i]
        return old

    if isinstance(f, types.Array):
        return multiply
    return fill if writes(f) else _apply_values(f, x, old)


overload_by_kind(apply, _apply_values, _apply_arrays)
