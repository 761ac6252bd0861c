"""The handful of vector operations in which every kernel is written.

A kernel speaks of ``q`` and ``p`` as *values*.  Each operation below is one plain NumPy expression; it works as it
stands on arrays of doubles and on object arrays of MPFR numbers.  Compiled, the same expression is unrolled for
tuples of doubles (small ``d``: the state lives in registers) and left to Numba for arrays (large ``d``).

``add`` is the compensated sum x + (dx + c): it returns the new value and the part of the increment that rounding
lost (Kahan 1965; Moller 1965, "Quasi double-precision in floating point addition", BIT 5, 37-50).
"""

from __future__ import annotations

import inspect
from typing import Any, NamedTuple

import numpy as np
from numba import config, njit, types
from numba.core import cgutils
from numba.extending import intrinsic, overload
from numba.np import arrayobj

from . import machine
from .fused import fused

#: Options of every compiled function.  "contract" lets a product and a sum become one fused operation, as a C compiler
#: does by default; it reorders nothing, so compensated sums stay exact.
COMMON = {"error_model": "numpy", "fastmath": {"contract"}}
#: Of kernels whose values are tuples: nothing may allocate (the compiler refuses what would), and arrays are not
#: reference-counted, which costs more than a gradient.
TUPLES = COMMON | {"_nrt": False}
#: Of kernels whose values are arrays (large d): operations return new ones.  (An option not set is the caller's.)
ARRAYS = COMMON | {"_nrt": True}


def _holds_vectors(t) -> bool:
    """Whether a Numba type is, or holds, a vector (d,): a value of large d.

    Memory is two-dimensional, and coefficients are read-only.
    """
    if isinstance(t, types.Array):
        return t.ndim == 1 and t.mutable and isinstance(t.dtype, types.Float)
    return isinstance(t, types.BaseTuple) and any(map(_holds_vectors, t))


def _jitted(f, inline):
    """Compile ``f`` on demand, without allocation where its values are tuples, with it where they are arrays."""
    on_tuples, on_arrays = njit(**TUPLES, forceinline=inline)(f), njit(**ARRAYS, forceinline=False)(f)
    if on_tuples is f:  # compilation is off
        return f
    call_template, overload_of = on_tuples.get_call_template, on_tuples.get_overload

    def fitting(arguments):
        return any(map(_holds_vectors, arguments))

    def template_of(args, kws):
        # A literal is a number like others: a compilation for each would cost more than it gains.
        args, kws = tuple(map(types.unliteral, args)), {name: types.unliteral(t) for name, t in kws.items()}
        return (on_arrays.get_call_template if fitting((*args, *kws.values())) else call_template)(args, kws)

    on_tuples.get_call_template = template_of
    on_tuples.get_overload = lambda sig: (on_arrays.get_overload if fitting(sig) else overload_of)(sig)
    on_tuples.on_arrays = on_arrays
    machine.callable_from_python(on_tuples)
    return on_tuples


def jit(f):
    """Compile ``f`` as a function of its own.  (Without being told Numba would inline it where its caller is.)"""
    return _jitted(f, inline=False)


def inlined(f):
    """Compile ``f`` into its caller: for what a step of tuples consists of."""
    return _jitted(f, inline=True)


@intrinsic
def _not_inlined(typing_context):
    def codegen(context, builder, signature, arguments):
        builder.function.attributes.add("noinline")
        return context.get_dummy_value()

    return types.none(), codegen


#: Called first thing, it keeps a function from being inlined: what is rare and long is compiled once, not at each call.
apart = (lambda: None) if config.DISABLE_JIT else _not_inlined


def _unrolled(fn, template, loop=None, loop_options=ARRAYS):
    """Overload ``fn`` by the source that ``template(names, arguments)`` writes for tuples, and ``loop`` for arrays.

    Without ``loop`` arrays keep ``fn``.
    """
    names = list(inspect.signature(fn).parameters)

    def made(kind, arguments):
        if kind is None:
            return fn
        namespace = {"__name__": __name__, "scalar": inlined(fn), "np": np}
        exec(f"def impl({', '.join(names)}):\n{kind(names, arguments)}", namespace)
        return namespace["impl"]

    def on_tuples(*arguments):
        return made(template, arguments) if any(isinstance(a, types.BaseTuple) for a in arguments) else None

    def on_arrays(*arguments):
        return None if any(isinstance(a, types.BaseTuple) for a in arguments) else made(loop, arguments)

    for build, options in ((on_tuples, {"forceinline": True, **TUPLES}), (on_arrays, loop_options)):
        namespace = {"__name__": __name__, "build": build}
        exec(f"def typed({', '.join(names)}): return build({', '.join(names)})", namespace)
        overload(fn, jit_options=options)(namespace["typed"])
    return fn


def _length(arguments) -> int:
    return next(a.count for a in arguments if isinstance(a, types.BaseTuple))


def elementwise(outputs: int = 1):
    """Make a NumPy expression an operation that is unrolled, component by component, for tuples."""

    def template(names, arguments):
        def call(i):
            parts = (
                f"{n}[{i}]" if isinstance(a, types.BaseTuple) else n for n, a in zip(names, arguments, strict=True)
            )
            return f"scalar({', '.join(parts)})"

        d = _length(arguments)
        if outputs == 1:
            return f"  return {_packed(call(i) for i in range(d))}"
        lines = [f"  r{i} = {call(i)}" for i in range(d)]
        packed = (_packed(f"r{i}[{k}]" for i in range(d)) for k in range(outputs))
        return "\n".join([*lines, f"  return {', '.join(packed)}"])

    def loop(names, arguments):
        """One pass; Numba's own loop for an array expression has one output."""
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

    return lambda fn: _unrolled(fn, template, loop if outputs > 1 else None)


def written(template, loop: str = ""):
    """Make a function an operation whose tuple form is the source that ``template(d)`` writes.

    That of arrays is the source ``loop``, where it is given.
    """
    on_arrays = (lambda names, arguments: loop) if loop else None
    return lambda fn: _unrolled(fn, lambda names, arguments: template(_length(arguments)), on_arrays)


def summed(term: str):
    """Make a function of vectors an operation that sums ``term``, which speaks of their components ``[i]``.

    The sum of an array may be taken in any order, so that the compiler keeps several partial sums.
    """

    def template(names, arguments):
        return "  return " + " + ".join(term.replace("[i]", f"[{i}]") for i in range(_length(arguments)))

    def loop(names, arguments):
        return f"  s = 0.0\n  for i in range(len({names[0]})):\n    s += {term}\n  return s"

    return lambda fn: _unrolled(fn, template, loop, ARRAYS | {"fastmath": {"contract", "reassoc", "nsz"}})


def _packed(items) -> str:
    """A tuple's text.  Python builds one of more than 30 items by way of a list, which Numba does not compile."""
    items = list(items)
    return " + ".join(f"({', '.join(items[i : i + 30])},)" for i in range(0, len(items), 30))


def _tuple(d, item):
    return "  return " + _packed(item.format(i=i) for i in range(d))


@elementwise()
def axpy(a, x, y):
    """y + a x."""
    return y + a * x


@elementwise()
def scale(a, x):
    """a x."""
    return a * x


@elementwise()
def plus(x, y):
    """x + y."""
    return x + y


@elementwise()
def minus(x, y):
    """x - y."""
    return x - y


@elementwise(outputs=2)
def add(x, c, dx):
    """Compensated sum: (x + c + dx, the part of it that rounding lost).

    Only one addition waits for dx, which comes last in a step's chain of operations.  What (x + c) does not show of c
    stays in the part returned, so nothing is lost.
    """
    t = (x + c) + dx
    return t, (dx + c) - (t - x)


@elementwise(outputs=2)
def add_product(x, c, a, v):
    """Compensated sum of x + c and a v: (the sum, the part of it that rounding lost).

    The product is not rounded, neither in the sum nor in what it lost: what both together are off is the rounding of
    (a v + c), of the difference that the sum shows, and of the part returned.
    """
    t = fused(a, v, x + c)
    return t, fused(a, v, c) - (t - x)


@summed("abs(x[i])")
def size(x):
    """The 1-norm of x; NaN where a component is."""
    return np.sum(np.abs(x))


@summed("abs(x[i] - y[i])")
def distance(x, y):
    """The 1-norm of x - y; NaN where a component is."""
    return np.sum(np.abs(x - y))


@written(lambda d: _tuple(d, "x[{i}] + (a if i == {i} else 0.0)"))
def bump(x, i, a):
    """x with a added to its component i."""
    y = x.copy()
    y[i] = y[i] + a
    return y


@written(lambda d: "  return x + y")
def join(x, y):
    """The components of x, then those of y."""
    return np.concatenate((x, y))


@written(lambda d: _tuple(d // 2, "x[{i}]"))
def head(x):
    """The first half of x."""
    return x[: len(x) // 2]


@written(lambda d: f"  return ({', '.join(f'x[{i}]' for i in range(d // 2, d))},)")
def tail(x):
    """The second half of x."""
    return x[len(x) // 2 :]


@written(lambda d: _tuple(d, "A[i, {i}]"))
def load(A, i, like):
    """Row i of A as a value of the kind of ``like``."""
    return A[i, : len(like)].copy()


# A loop: to assign to a slice is to compile what is said where the lengths differ, at every call.
@written(lambda d: "\n".join(f"  A[i, {j}] = x[{j}]" for j in range(d)), "  for j in range(len(x)): A[i, j] = x[j]")
def store(A, i, x):
    """Write x into row i of A."""
    A[i, : len(x)] = x


class State(NamedTuple):
    """The values q and p, and what rounding lost of them."""

    q: Any
    p: Any
    lost_q: Any
    lost_p: Any


@inlined
def advanced(y, dq, dp):
    """The state y moved by the increments dq and dp, with compensation."""
    q, lost_q = add(y.q, y.lost_q, dq)
    p, lost_p = add(y.p, y.lost_p, dp)
    return State(q, p, lost_q, lost_p)


@inlined
def opened(orbit):
    """The state in the first four rows of an orbit's."""
    rows, zero = orbit.state, orbit.zero
    return State(load(rows, 0, zero), load(rows, 1, zero), load(rows, 2, zero), load(rows, 3, zero))


@inlined
def close(orbit, y):
    """Write it back, for the run to go on."""
    store(orbit.state, 0, y.q)
    store(orbit.state, 1, y.p)
    store(orbit.state, 2, y.lost_q)
    store(orbit.state, 3, y.lost_p)


@inlined
def keep(samples, row, y):
    """Fill a row of the samples."""
    store(samples.q, row, y.q)
    store(samples.p, row, y.p)


def chosen(when_none, otherwise):
    """The function that is ``when_none`` where its first argument is None, else ``otherwise``, chosen when compiled."""
    names = ", ".join(inspect.signature(otherwise).parameters)
    first = names.split(",")[0]
    namespace = {"__name__": __name__, "a": when_none, "b": otherwise, "none": types.NoneType, "omitted": types.Omitted}
    exec(f"def pick({names}):\n  return a({names}) if {first} is None else b({names})", namespace)
    exec(f"def kind({names}):\n  return a if isinstance({first}, (none, omitted)) else b", namespace)
    namespace["holds"] = lambda *arguments: any(map(_holds_vectors, arguments))
    for vectors, options in ((False, {"forceinline": True, **TUPLES}), (True, ARRAYS)):
        exec(f"def typed({names}):\n  return kind({names}) if holds({names}) == {vectors} else None", namespace)
        overload(namespace["pick"], jit_options=options)(namespace["typed"])
    return namespace["pick"]


#: The velocity grad T(p); ``dT`` is None where that is p itself.
velocity = chosen(lambda dT, p: p, lambda dT, p: dT(p))


# -- in place ---------------------------------------------------------------------------------------------------------
#
# At a hundred degrees of freedom a step of arrays spends most of its time on the memory of new ones.  The operations
# below may write into arguments that the caller needs no more; on tuples and on numbers of many digits they are
# operations like the others.  A kernel of these alone allocates nothing (`filling`).


#: Of operations in place: whether references are counted is the caller's option; to hand arrays over costs more than
#: what a hundred numbers take.
PLACES = COMMON | {"forceinline": True}


def by_kind(function, on_values, on_arrays):
    """Overload a function by what these, handed the types of the arguments, return for values and for arrays."""
    names = ", ".join(inspect.signature(function).parameters)
    for vectors, chosen_for, options in (
        (False, on_values, {"forceinline": True, **TUPLES}),
        (True, on_arrays, PLACES),
    ):
        namespace = {"__name__": __name__, "chosen_for": chosen_for}
        namespace["fit"] = lambda *arguments, wanted=vectors: any(map(_holds_vectors, arguments)) == wanted
        exec(f"def typed({names}):\n  return chosen_for({names}) if fit({names}) else None", namespace)
        overload(function, jit_options=options)(namespace["typed"])


def in_place(on_arrays):
    """Make a function of values one that is ``on_arrays``, of the same arguments, where one of them is an array."""

    def decorate(on_values):
        by_kind(on_values, lambda *arguments: on_values, lambda *arguments: on_arrays or on_values)
        return on_values

    return decorate


def writes(f) -> bool:
    """Whether a function's type is that of one that writes its results into its last arguments."""
    return isinstance(f, types.FunctionType) and f.signature.return_type == types.none


@intrinsic
def _part_of_row(typing_context, A, i, first, n):
    """The n numbers of row i from ``first`` on: a view that counts no references; the table outlives the kernel."""
    kind = types.Array(types.float64, 1, "C")

    def codegen(context, builder, signature, arguments):
        table, row, first, n = arguments
        source = arrayobj.make_array(signature.args[0])(context, builder, table)
        size, width = context.get_constant(types.intp, 8), cgutils.unpack_tuple(builder, source.strides)[0]
        offset = builder.add(builder.mul(row, width), builder.mul(first, size))
        out = arrayobj.make_array(kind)(context, builder)
        place = cgutils.pointer_add(builder, source.data, offset)
        arrayobj.populate_array(out, data=place, shape=[n], strides=[size], itemsize=size, meminfo=None)
        return out._getvalue()

    return kind(A, types.intp, types.intp, types.intp), codegen


def _rows(A, i, j, like):
    return _part_of_row(A, i, 0, len(like)), _part_of_row(A, j, 0, len(like))


@in_place(_rows)
def rows(A, i, j, like):
    """Rows i and j of A; arrays are the rows themselves, to be written over."""
    return load(A, i, like), load(A, j, like)


def _halves(A, i, like):
    return _part_of_row(A, i, 0, len(like)), _part_of_row(A, i, len(like), len(like))


@in_place(_halves)
def halves(A, i, like):
    """The halves of row i of A, each of the kind of ``like``; arrays are the row itself, to be written over."""
    x = load(A, i, join(like, like))
    return head(x), tail(x)


@inlined
def held(orbit):
    """The state in the first four rows of an orbit's; arrays are the rows themselves."""
    q, p = rows(orbit.state, 0, 1, orbit.zero)
    lost_q, lost_p = rows(orbit.state, 2, 3, orbit.zero)
    return State(q, p, lost_q, lost_p)


def _moved(x, c, a, v):
    for i in range(len(x)):
        t = fused(a, v[i], x[i] + c[i])
        c[i] = fused(a, v[i], c[i]) - (t - x[i])
        x[i] = t
    return x, c


@in_place(_moved)
def moved(x, c, a, v):
    """The compensated sum of x + c and a v (`add_product`), in the place of x and c."""
    return add_product(x, c, a, v)


@written(lambda d: _tuple(d, "f[{i}] * x[{i}]"))
def times(f, x):
    """The components of x, each times a number of f, an array that is no value."""
    return f * x


@intrinsic
def _called(typing_context, f, x):
    """f(x) by f's entry for C.  Numba's own calls hand results over in memory, and the next kick waits for them."""

    def codegen(context, builder, signature, arguments):
        address = cgutils.create_struct_proxy(f)(context, builder, value=arguments[0]).c_addr
        return builder.call(builder.bitcast(address, context.get_value_type(f.ftype)), arguments[1:])

    return f.signature.return_type(f, x), codegen


def of(f, x, old):
    """f(x), in the place of ``old``; x itself where f is None, f x, component by component, where it is numbers."""
    if f is None:
        return x
    return times(f, x) if isinstance(f, np.ndarray) else f(x)


def _of_values(f, x, old):
    if isinstance(f, (types.NoneType, types.Omitted)):
        return lambda f, x, old: x
    if isinstance(f, types.Array):
        return lambda f, x, old: times(f, x)
    if isinstance(f, types.FunctionType) and machine.in_registers(f.signature.return_type, f.signature.args):
        return lambda f, x, old: _called(f, x)
    return lambda f, x, old: f(x)


def _of_arrays(f, x, old):
    def filled(f, x, old):
        f(x, old)
        return old

    def multiplied(f, x, old):
        for i in range(len(x)):
            old[i] = f[i] * x[i]
        return old

    if isinstance(f, types.Array):
        return multiplied
    return filled if writes(f) else _of_values(f, x, old)


by_kind(of, _of_values, _of_arrays)
