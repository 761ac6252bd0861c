"""Compensated sums with fused multiply-add, for numbers, arrays and lanes, against exact fractions."""

import platform
from fractions import Fraction

import numba
import numpy as np
import pytest
from llvmlite import binding

from phasebench.integrators.values import vector
from phasebench.integrators.values.fma import exact_fma
from phasebench.integrators.values.fma import fma as fused
from phasebench.integrators.values.lanes import put, take
from support.marks import compiled

WIDTH, A = 8, 0.3
LIKE = (0.0,) * WIDTH
#: Whether code compiled here uses fused multiply-add.
NAMED = numba.config.CPU_FEATURES
FEATURES = binding.get_host_cpu_features() if NAMED is None else {f[1:]: f[0] == "+" for f in NAMED.split(",") if f}
FUSES = platform.machine() in ("arm64", "aarch64") or bool(FEATURES.get("fma"))


def numbers():
    """(x, its compensation, v), array (3, 80), with sizes as in a step."""
    return np.random.default_rng(3).normal(size=(3, 80)) * np.array([[1.0], [1e-17], [1e-3]])


def fma(a, v, y):
    """a v + y, rounded as on this processor: once if it has fused multiply-add."""
    return float(Fraction(a) * Fraction(v) + Fraction(y)) if FUSES else a * v + y


@numba.njit(**vector.ARRAYS)
def in_arrays(x, c, v):
    """Add A v to x with compensations c, in place, by `add_product_in_place` on arrays."""
    vector.add_product_in_place(x, c, A, v)


@numba.njit
def in_tuples(x, c, v):
    """Add A v to x with compensations c, in place, by `add_product_in_place` on tuples of two numbers."""
    for i in range(0, len(x), 2):
        s, r = vector.add_product_in_place((x[i], x[i + 1]), (c[i], c[i + 1]), A, (v[i], v[i + 1]))
        x[i], x[i + 1] = s
        c[i], c[i + 1] = r


@numba.njit
def _rows(x, c, v):
    for i in range(len(x)):
        s, r = vector.add_product_in_place((take(x, i, LIKE),), (take(c, i, LIKE),), A, (take(v, i, LIKE),))
        put(x, i, s[0], LIKE)
        put(c, i, r[0], LIKE)


def in_lanes(x, c, v):
    """Add A v to x with compensations c, in place, in SIMD lanes."""
    _rows(*(z.reshape(-1, WIDTH) for z in (x, c, v)))


def product_rounded(x, c, v):
    """Control: add A v to x with compensations c, in place, where the product is rounded before it is added."""
    x[:], c[:] = vector.add(x.copy(), c.copy(), A * v)


def sums(how):
    """(sums, their compensations) that ``how(x, c, v)``, one of the functions above, leaves in copies of numbers."""
    x, c, v = (z.copy() for z in numbers())
    how(x, c, v)
    return x, c


@pytest.mark.processor
@pytest.mark.parametrize("how", [in_arrays, in_tuples, in_lanes])
def test_every_type_rounds_the_exact_product_once(how):
    x, c, v = numbers()
    total = [fma(A, w, y) for w, y in zip(v, x + c, strict=True)]
    lost = np.array([fma(A, w, y) for w, y in zip(v, c, strict=True)]) - (np.array(total) - x)
    found, rest = sums(how)
    np.testing.assert_array_equal(found, total)
    np.testing.assert_array_equal(rest, lost)
    assert np.abs(lost).max() > 0


def over_the_bound(how):
    """Number of sums whose error exceeds the bound in the docstring of `add_product`."""
    u, over = Fraction(1, 2**53), 0
    for x, c, v, t, r in zip(*numbers(), *sums(how), strict=True):
        x, c, v, t, r = map(Fraction, (x, c, v, t, r))
        change = Fraction(A) * v + c
        over += abs(t + r - x - change) > u * (abs(change) + abs(t - x) * (Fraction(float(t - x)) != t - x) + abs(r))
    return over


@pytest.mark.skipif(not FUSES, reason="this processor does not fuse a product and a sum")
def test_the_error_stays_within_its_bound():
    assert [over_the_bound(how) for how in (in_arrays, in_tuples, in_lanes)] == [0, 0, 0]
    assert over_the_bound(product_rounded) > 5


@numba.njit
def _exact(a, x, y, out):
    for i in range(0, len(out), 2):
        out[i, 0] = exact_fma(a[i, 0], x[i, 0], y[i, 0])
        put(out, i + 1, exact_fma(-take(a, i + 1, LIKE), take(x, i + 1, LIKE), 1.0), LIKE)


@compiled
def test_exact_fma_rounds_once_on_every_processor():
    """Numbers, and lanes with a number; the control rounds the product before it is added."""
    a, x, y = np.random.default_rng(2).normal(size=(3, 20, WIDTH))
    y[::2] = -(a * x)[::2]  # both sums cancel
    x[1::2] = 1 / a[1::2]
    found = np.zeros_like(a)
    _exact(a, x, y, found)

    def once(a, x, y):
        return np.vectorize(lambda a, x, y: float(Fraction(a) * Fraction(x) + Fraction(y)))(a, x, y)

    assert np.array_equal(found[::2, 0], once(a, x, y)[::2, 0])
    assert np.array_equal(found[1::2], once(-a, x, 1.0)[1::2])
    assert not np.array_equal(found[1::2], (1.0 - a * x)[1::2])
    assert not np.array_equal(found[::2, 0], (a * x + y)[::2, 0])


def test_without_compilation_it_is_a_product_and_a_sum():
    a, x, y = np.random.default_rng(1).normal(size=(3, 50))
    np.testing.assert_array_equal(fused(a, x, y), a * x + y)
    for plain, added in zip(vector.add_product(x, y, 0.3, a), vector.add(x, y, 0.3 * a), strict=True):
        np.testing.assert_array_equal(plain, added)
