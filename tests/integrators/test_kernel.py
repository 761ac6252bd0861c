"""What a family passes to its kernel and how the kernel is compiled: numbers, vectors, types."""

from __future__ import annotations

from fractions import Fraction
from typing import Any, NamedTuple

import mpmath
import numba
import numpy as np
import pytest
from numba import types

from phasebench.integrators.compile import codegen, preparation
from phasebench.integrators.compile.codegen import DOUBLE, MULTIPRECISION, TUPLE_LIMIT
from phasebench.integrators.stepping import kernel
from phasebench.integrators.stepping.kernel import Carry, Prepared, Samples
from phasebench.integrators.values import vector
from support.marks import compiled

# -- numbers ----------------------------------------------------------------------------------------------------------


def test_ragged_rows_are_padded_with_zeros():
    made = kernel.array([[Fraction(1, 3)], [2, mpmath.mpf(3)], []], DOUBLE)
    assert made.tolist() == [[1 / 3, 0], [2, 3], [0, 0]]
    assert made.flags.writeable
    assert kernel.array([], DOUBLE).shape == (0, 1)
    with codegen.precision(40):
        many = kernel.array([[Fraction(1, 3), 0]], MULTIPRECISION)
        assert many.dtype == object
        assert abs(3 * many[0, 0] - 1) < 1e-39
        assert abs(3 * float(many[0, 0]) - 1) < 1e-15


def test_coefficients_are_read_only_and_integers_stay_integers():
    assert kernel.numbers([Fraction(1, 4), 2], DOUBLE).tolist() == [0.25, 2]
    given = [1, 2]
    for made in (kernel.numbers(given, DOUBLE), kernel.freeze(given), kernel.freeze(np.array(given))):
        with pytest.raises(ValueError, match="read-only"):
            made[0] = 5
    assert kernel.freeze(given).dtype.kind == "i"
    other = np.array(given)
    kernel.freeze(other)
    other[0] = 7  # the array passed in is unchanged


def test_zeros_have_the_type_of_the_arithmetic():
    assert kernel.zeros((2, 3), DOUBLE).dtype == float
    assert kernel.zeros((2, 3), DOUBLE).tolist() == [[0.0] * 3] * 2
    with codegen.precision(30):
        made = kernel.zeros((1, 2), MULTIPRECISION)
    assert made.dtype == object
    assert [type(x) for x in made[0]] == [type(codegen.to_number(0, MULTIPRECISION))] * 2
    assert made.tolist() == [[0, 0]]


def test_small_compiled_vectors_are_tuples():
    small, large = [1, 2], list(range(TUPLE_LIMIT + 1))
    for made, is_tuple in (
        (kernel.value(small, 2), codegen.compiled()),
        (kernel.value(small, 2, DOUBLE), codegen.compiled()),
        (kernel.value(small, 2, DOUBLE, arrays=True), False),
        (kernel.value(large, len(large)), False),
    ):
        assert isinstance(made, tuple) == is_tuple
        assert {float, np.float64} >= {type(x) for x in made}
    with codegen.precision(30):
        many = kernel.value([codegen.to_number(1, MULTIPRECISION)] * 2, 2, MULTIPRECISION)
    assert many.dtype == object


# -- what a family prepares -------------------------------------------------------------------------------------------


class Step(NamedTuple):
    """The step of a toy method, with a function, coefficients, a tuple and the step size."""

    f: Any
    c: np.ndarray
    rest: tuple
    h: float = 0.0


def run(step, carry, samples, counts):
    """Toy kernel: each step adds h f(q) to q."""
    y = vector.read_state(carry)
    for row in range(len(samples.q)):
        for _ in range(samples.every):
            y = vector.State(vector.axpy(step.h, vector.apply(step.f, y.q, y.q), y.q), y.p, y.lost_q, y.lost_p)
            counts.steps += 1
        vector.write_sample(samples, row, y)
    vector.write_state(carry, y)
    return len(samples.q), 0


def prepare(f=None, rest=(1.0, 3), **more):
    """A `Prepared` of the toy kernel with the function f, the tuple ``rest`` and other fields."""
    return Prepared(run, Step(f, kernel.numbers([1, 2], DOUBLE), rest), width=2, stages=1, **more)


def test_counts_have_names():
    names = {"steps": 5, "gradient": 7, "hessian": 0, "iterations": 7, "fallbacks": 0, "newton": 0}
    assert prepare().tally(5, 7) == names
    assert prepare(implicit=False).tally(5, 7) == names | {"iterations": 0}
    assert prepare(hessian=True).tally(5, 7, 2, 3) == names | {"hessian": 7, "fallbacks": 2, "newton": 3}


def test_defaults_of_prepared():
    made = prepare()
    assert (made.implicit, made.hessian, made.linear, made.begin, made.missed) == (True, False, 0, None, "")
    assert (made.work, made.arrays, made.apart) == (None, False, False)


def test_keep_energy_stores_the_initial_energy():
    class Kept(NamedTuple):
        H0: float = 0.0

    begin = kernel.keep_energy(lambda q, p: (q + 10 * p, "how well it is known"))
    assert begin(Kept(), 1.0, 2.0) == Kept(21.0)


def test_cached_entries_are_not_prepared_again(monkeypatch):
    kept, made = {}, []
    monkeypatch.setattr(preparation, "entry", lambda method, system: f"{method} of {system}")
    monkeypatch.setattr(preparation, "read", kept.get)
    monkeypatch.setattr(preparation, "write", kept.__setitem__)
    monkeypatch.setattr(
        kernel, "_prepare", lambda method, system, arithmetic: made.append(arithmetic) or f"{arithmetic}"
    )
    assert kernel.prepare("a", "b") == kernel.prepare("a", "b", DOUBLE) == DOUBLE
    assert made == [DOUBLE]
    assert kept == {"a of b": DOUBLE}
    assert kernel.prepare("a", "b", MULTIPRECISION) == MULTIPRECISION
    assert kept.pop(None) == MULTIPRECISION, "`preparation` keeps nothing that has no name"
    assert kept == {"a of b": DOUBLE}


# -- compilation ------------------------------------------------------------------------------------------------------


def test_multiprecision_kernels_are_python():
    assert kernel.kernel(prepare(), 2, MULTIPRECISION) is run
    assert (kernel.kernel(prepare(), 2) is run) == (not codegen.compiled())


def integrate(made, d, q, h=0.5, rows=2, every=3):
    """(samples of q, state at the end, steps counted) of a run of the kernel."""
    width = max(2, d)
    state, table = np.zeros((5, width)), np.zeros((1, 1))
    state[0, :d] = q
    orbit = Carry(state, table, table, kernel.value(np.zeros(d), d, DOUBLE, made.arrays))
    samples = Samples(np.zeros((rows, d)), np.zeros((rows, d)), np.zeros((rows, 1)), every)
    counts = np.rec.array(np.zeros(1, kernel.COUNTS))[0]
    step = made.step._replace(h=h)
    assert kernel.entry(kernel.kernel(made, d))(step, orbit, samples, counts) == (rows, 0)
    return samples.q, state, counts.steps


@compiled
@pytest.mark.parametrize(("d", "arrays"), [(2, False), (2, True), (TUPLE_LIMIT + 1, False)])
def test_a_kernel_is_compiled_for_tuples_or_for_arrays(d, arrays):
    made = prepare(rest=(0.0,) * d, arrays=arrays)
    q, state, steps = integrate(made, d, np.arange(1.0, d + 1))
    np.testing.assert_allclose(q, np.outer([1.5**3, 1.5**6], np.arange(1.0, d + 1)), rtol=1e-14)
    np.testing.assert_array_equal(state[0, :d], q[-1])
    assert steps == 6
    options = kernel.kernel(made, d).targetoptions
    assert options["nogil"] is True
    assert options["_nrt"] is (d > TUPLE_LIMIT)


@compiled
def test_a_kernel_is_compiled_once_per_type():
    made, again = prepare(), prepare()
    first = kernel.kernel(made, 2)
    assert kernel.kernel(made, 2) is first
    assert kernel.kernel(again, 2) is first, "for the same types"
    assert kernel.kernel(made, 3) is not first
    assert kernel.kernel(made, 2) is first
    assert kernel.kernel(prepare(arrays=True), 2) is not first
    assert next(iter(first.overloads)) == first.nopython_signatures[0].args


@compiled
def test_the_types_of_a_step():
    """Functions are passed as pointers, so that one kernel serves all of a signature; read-only arrays are marked."""
    pair = types.UniTuple(types.float64, 2)
    f, g = numba.njit(pair(pair))(lambda x: (x[1], x[0])), numba.njit(pair(pair))(lambda x: (x[0], x[0]))
    for x, expected in (
        (1.0, types.float64),
        (f, types.FunctionType(pair(pair))),
        (np.zeros((1, 2)), types.Array(types.float64, 2, "C")),
        (kernel.numbers([1], DOUBLE), types.Array(types.float64, 1, "C", readonly=True)),
        (np.zeros((4, 2))[::2], types.Array(types.float64, 2, "A")),
        ((1.0, 2.0), pair),
    ):
        assert kernel._type(x) == expected
        assert kernel._type(x) == expected, "asked again"
    assert kernel._type(g) == kernel._type(f)
    step = kernel._type(prepare(f).step)
    assert step.instance_class is Step
    assert step.types == tuple(kernel._type(x) for x in prepare(f).step)
    assert not hasattr(kernel._type((1.0, f)), "fields")


@compiled
def test_steps_that_write_into_arrays_do_not_allocate():
    """A step whose function returns nothing is taken to write into its arguments, and compiled without allocation."""
    made = types.Array(types.float64, 1, "C")

    @numba.njit(types.none(made, made), **vector.ARRAYS)
    def doubled(x, out):
        for i in range(len(x)):
            out[i] = 2 * x[i]

    class Writing(NamedTuple):
        f: Any
        h: float

    def run(step, carry, samples, counts):
        q, _ = vector.rows(carry.state, 0, 1, carry.zero)
        step.f(q, q)
        return len(samples.q), 0

    writing = Prepared(run, Writing(doubled, 0.5), width=2, stages=0, arrays=True)
    assert kernel.kernel(writing, TUPLE_LIMIT + 1).targetoptions["_nrt"] is False


def test_uncompiled_functions_are_called_directly():
    assert kernel.entry(run) is run
