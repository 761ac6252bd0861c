"""Vector operations: the same source works on arrays, and compiled on tuples and on arrays."""

from __future__ import annotations

from types import SimpleNamespace

import numba
import numpy as np
import pytest
from numba import types

from phasebench.integrators.compile import codegen
from phasebench.integrators.values import vector
from phasebench.integrators.values.vector import ARRAYS, TUPLES, State
from support.marks import compiled
from support.values import value

DOUBLE = types.float64
VECTOR = types.Array(DOUBLE, 1, "C")
#: Even, and more components than fit into one piece of a generated tuple.
MANY = 62
X, Y, C = np.random.default_rng(4).normal(size=(3, MANY)) * np.array([[1.0], [1.0], [1e-17]])


def each(x, y, c, A):
    """Results of every operation on vectors x, y, compensations c and rows A: (vectors, numbers)."""
    t, lost = vector.add(x, c, y)
    s, rest = vector.add_product(x, c, 0.5, y)
    moved = vector.axpy(0.5, x, y), vector.scale(0.5, x), vector.plus(x, y), vector.minus(x, y)
    parts = vector.bump(x, 1, 0.25), vector.join(x, y), vector.head(x), vector.tail(x), vector.load(A, 1, x)
    return (*moved, *parts, t, lost, s, rest), (vector.size(x), vector.distance(x, y))


def numpy_results(x, y, c, A):
    """The results of `each`, computed by NumPy."""
    bumped, t = x.copy(), (x + c) + y
    bumped[1] += 0.25
    half = len(x) // 2
    s = (x + c) + 0.5 * y
    return (
        [x / 2 + y, x / 2, x + y, x - y, bumped, np.append(x, y), x[:half], x[half:], A[1, : len(x)]]
        + [t, (y + c) - (t - x), s, (0.5 * y + c) - (s - x)],
        [sum(abs(x)), sum(abs(x - y))],
    )


def check(found, d):
    """Assert that the results ``found`` of `each` on vectors of length d equal those of NumPy."""
    wanted = numpy_results(X[:d], Y[:d], C[:d], np.array([X, Y]))
    for a, b in zip(found[0], wanted[0], strict=True):
        # Exact even if product and sum are fused, as the factors are 1/2.
        np.testing.assert_array_equal(np.array(a), b)
    assert found[1] == pytest.approx(wanted[1], rel=1e-14)


@pytest.mark.parametrize("d", [2, 5, MANY])
def test_operations_on_arrays_without_compilation(d):
    check(each(X[:d], Y[:d], C[:d], np.array([X, Y])), d)


@compiled
@pytest.mark.parametrize("d", [2, 5])
def test_compiled_operations_on_tuples_and_arrays(d):
    A = np.array([X, Y])
    check(numba.njit(**ARRAYS)(each)(X[:d].copy(), Y[:d].copy(), C[:d].copy(), A), d)
    check(numba.njit(**TUPLES)(each)(*(tuple(z[:d]) for z in (X, Y, C)), A), d)


def test_the_norm_of_a_vector_with_nan_is_nan():
    for x in ([np.nan, 1.0], [1.0, np.nan]):
        assert np.isnan(vector.size(np.array(x)))
        assert np.isnan(vector.distance(np.array(x), np.zeros(2)))


@pytest.mark.parametrize("n", [1, 2, 29, 30, 31, 60, 61])
def test_generated_tuples_are_split_into_pieces(n):
    text = vector._tuple_text(str(i) for i in range(n))
    assert eval(text) == tuple(range(n))
    assert max(piece.count(",") for piece in text.split("+")) <= 30


# -- states -----------------------------------------------------------------------------------------------------------


def test_a_state_is_written_and_read_unchanged():
    y = State(value(1.0, 2.0), value(3.0, 4.0), value(5.0, 6.0), value(7.0, 8.0))
    carry = SimpleNamespace(state=np.zeros((5, 3)), zero=value(0.0, 0.0))
    if codegen.compiled():
        from phasebench.integrators.stepping.kernel import Carry

        carry = Carry(carry.state, np.zeros((1, 1)), np.zeros((1, 1)), carry.zero)
    vector.write_state(carry, y)
    assert carry.state.tolist() == [[1, 2, 0], [3, 4, 0], [5, 6, 0], [7, 8, 0], [0, 0, 0]]
    for read in (vector.read_state, vector.view_state):
        assert [tuple(x) for x in read(carry)] == [(1, 2), (3, 4), (5, 6), (7, 8)]


def test_a_state_is_advanced_with_compensation():
    one = value(1.0)
    y = State(one, value(2.0), value(0.0), value(0.0))
    tiny = value(2.0**-60)
    q, p, lost_q, lost_p = vector.update(y, tiny, value(-(2.0**-55)))
    assert (q[0], p[0], lost_q[0], lost_p[0]) == (1.0, 2.0, 2.0**-60, -(2.0**-55))


def test_a_row_stores_coordinates_and_momenta():
    from phasebench.integrators.stepping.kernel import Samples

    zero = value(0.0, 0.0)
    samples = Samples(np.zeros((2, 2)), np.zeros((2, 2)), np.zeros((2, 1)), 1)
    vector.write_sample(samples, 1, State(value(1.0, 2.0), value(3.0, 4.0), zero, zero))
    assert samples.q.tolist() == [[0, 0], [1, 2]]
    assert samples.p.tolist() == [[0, 0], [3, 4]]


# -- compilation ------------------------------------------------------------------------------------------------------


def test_types_that_hold_vectors():
    """Writable one-dimensional arrays of doubles, and types that contain one."""
    tuple_ = types.Tuple((DOUBLE, types.UniTuple(VECTOR, 2)))
    assert all(map(vector._holds_vectors, (VECTOR, types.UniTuple(VECTOR, 1), tuple_)))
    fixed = types.Array(DOUBLE, 1, "C", readonly=True)
    others = (DOUBLE, types.UniTuple(DOUBLE, 3), types.Array(DOUBLE, 2, "C"), fixed, types.Array(types.int64, 1, "C"))
    assert not any(map(vector._holds_vectors, (*others, types.Tuple(others), types.none)))


@compiled
def test_compilation_options():
    """`inline` functions are inlined into callers; whether memory is managed (``_nrt``) is the caller's option."""

    def f(x):
        return x

    for made, inline in ((vector.jit(f), "never"), (vector.inline(f), "always")):
        assert made.targetoptions.get("inline", "never") == inline
        assert "_nrt" not in made.targetoptions
        assert made.targetoptions["fastmath"] == {"contract"}
        assert made.targetoptions["error_model"] == "numpy"
        assert made(3.0) == 3.0
    assert vector.jit(f).targetoptions["forceinline"] is False


@vector.jit
def twice(x):
    return vector.scale(2.0, x)


@compiled
def test_functions_of_vectors_allocate_for_arrays_only():
    """A result is allocated for an array and not for a tuple, also if the argument is passed by keyword."""

    def both(x):
        return twice(x), twice(x=x)

    for options, x in ((TUPLES, (1.0, 2.0)), (ARRAYS, np.array([1.0, 2.0]))):
        for found in numba.njit(**options)(both)(x):
            assert tuple(found) == (2.0, 4.0)


def call(f, x, old):
    """What `velocity` and `apply` give for a function f at x; ``old`` is a vector that `apply` may overwrite."""
    return vector.velocity(f, x), vector.apply(f, x, old)


@compiled
def test_a_function_of_none_is_the_identity():
    for options, x in ((TUPLES, (1.0, 2.0)), (ARRAYS, np.array([1.0, 2.0]))):
        for f, factor in ((None, 1), (twice, 2)):
            old = tuple(x) if isinstance(x, tuple) else x.copy()
            found = numba.njit(**options)(lambda x, old, f=f: call_compiled(f, x, old))(x, old)
            assert [tuple(y) for y in found] == [(factor, 2 * factor)] * 2
    assert [tuple(y) for y in call(None, (1.0, 2.0), ())] == [(1.0, 2.0)] * 2


call_compiled = numba.njit(call)


def numbers_times(f, x, old):
    """Result of `apply` where f is an array of factors in place of a function."""
    return vector.apply(f, x, old)


@compiled
def test_an_array_in_place_of_a_function_means_factors():
    f = np.array([2.0, 3.0])
    f.flags.writeable = False
    assert numba.njit(**TUPLES)(numbers_times)(f, (1.0, 2.0), (0.0, 0.0)) == (2.0, 6.0)
    x, old = np.array([1.0, 2.0]), np.zeros(2)
    assert numba.njit(**ARRAYS)(numbers_times)(f, x, old) is not None
    assert (old.tolist(), x.tolist()) == ([2.0, 6.0], [1.0, 2.0]), "written over"
    assert vector.apply(f, x, old).tolist() == [2.0, 6.0]


def in_the_place(A, x, c, v):
    """Results of `rows`, `halves` and a compensated sum, where they may overwrite arrays."""
    first, second = vector.rows(A, 0, 1, v)
    left, right = vector.halves(A, 2, v)
    x, c = vector.add_product_in_place(x, c, 0.5, v)
    return (first, second, left, right), (x, c)


def test_rows_and_halves_of_a_table():
    A, d = np.arange(12.0).reshape(3, 4), 2
    x, c, v = X[:d].copy(), C[:d].copy(), Y[:d].copy()
    parts, moved = in_the_place(A, x, c, v)
    assert [p.tolist() for p in parts] == [[0, 1], [4, 5], [8, 9], [10, 11]]
    if codegen.compiled():
        wanted = [np.array(z) for z in moved]
        found, moved = numba.njit(**TUPLES)(in_the_place)(A, tuple(x), tuple(c), tuple(v))
        assert found == ((0, 1), (4, 5), (8, 9), (10, 11))
        np.testing.assert_array_equal(np.array(moved), wanted)
        _write(A, x, c, v)
        assert A.tolist() == [[-1, -1, 2, 3], [-2, -2, 6, 7], [-3, -3, -4, -4]]
        np.testing.assert_array_equal([x, c], wanted)


@numba.njit(**ARRAYS)
def _write(A, x, c, v):
    (first, second, left, right), _ = in_the_place_compiled(A, x, c, v)
    first[:], second[:], left[:], right[:] = -1.0, -2.0, -3.0, -4.0


in_the_place_compiled = numba.njit(**ARRAYS)(in_the_place)


def test_in_place_functions_are_recognized_by_type():
    assert vector.writes(types.FunctionType(types.none(VECTOR, VECTOR)))
    assert not vector.writes(types.FunctionType(VECTOR(VECTOR)))
    assert not vector.writes(VECTOR)
