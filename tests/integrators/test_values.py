"""The kinds of number of a step: vector operations on arrays, tuples and lanes, sums with compensation, large d."""

from __future__ import annotations

import inspect
import platform
import sys
import textwrap
from dataclasses import replace
from fractions import Fraction
from types import ModuleType, SimpleNamespace

import numba
import numpy as np
import pytest
import sympy as sp
from llvmlite import binding
from numba import types

import phasebench as pb
from phasebench.benchmarks.problems import problem
from phasebench.integrators import integrate
from phasebench.integrators.compile import codegen
from phasebench.integrators.families import force_gradient, runge_kutta, splitting
from phasebench.integrators.prepared import prepare
from phasebench.integrators.registry import method
from phasebench.integrators.stepping import kernel, loop, newton, solve
from phasebench.integrators.values import vector
from phasebench.integrators.values.fma import exact_fma, fma
from phasebench.integrators.values.lanes import put, take
from phasebench.integrators.values.vector import ARRAYS, TUPLES
from support.solutions import last
from support.systems import chain

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


def check(found, d):
    """Assert that the results of `each` on vectors of length d equal those of NumPy, exactly as the factors are 1/2."""
    x, y, c, half = X[:d], Y[:d], C[:d], d // 2
    bumped, t, s = x + 0.25 * (np.arange(d) == 1), (x + c) + y, (x + c) + 0.5 * y
    wanted = [x / 2 + y, x / 2, x + y, x - y, bumped, np.append(x, y), x[:half], x[half:], Y[:d]]
    wanted += [t, (y + c) - (t - x), s, (0.5 * y + c) - (s - x)]
    for a, b in zip(found[0], wanted, strict=True):
        np.testing.assert_array_equal(np.array(a), b)
    assert found[1] == pytest.approx([sum(abs(x)), sum(abs(x - y))], rel=1e-14)


@pytest.mark.parametrize("d", [2, 5, 31, MANY])
def test_operations_equal_those_of_numpy(d):
    A = np.array([X, Y])
    check(each(X[:d], Y[:d], C[:d], A), d)
    if d in (5, 31):  # Python builds tuples of more than 30 items differently
        check(numba.njit(**ARRAYS)(each)(X[:d].copy(), Y[:d].copy(), C[:d].copy(), A), d)
        check(numba.njit(**TUPLES)(each)(*(tuple(z[:d]) for z in (X, Y, C)), A), d)


def test_the_norm_of_a_vector_with_nan_is_nan():
    for x in ([np.nan, 1.0], [1.0, np.nan]):
        assert np.isnan([vector.size(np.array(x)), vector.distance(np.array(x), np.zeros(2))]).all()


WIDTH, FACTOR = 8, 0.3
LIKE = (0.0,) * WIDTH
#: Whether code compiled here uses fused multiply-add.
NAMED = numba.config.CPU_FEATURES
FEATURES = binding.get_host_cpu_features() if NAMED is None else {f[1:]: f[0] == "+" for f in NAMED.split(",") if f}
FUSES = platform.machine() in ("arm64", "aarch64") or bool(FEATURES.get("fma"))


@numba.njit(**ARRAYS)
def in_arrays(x, c, v):
    """Add FACTOR v to x with compensations c, in place."""
    vector.add_product_in_place(x, c, FACTOR, v)


@numba.njit
def in_tuples(x, c, v):
    for i in range(0, len(x), 2):
        s, r = vector.add_product_in_place((x[i], x[i + 1]), (c[i], c[i + 1]), FACTOR, (v[i], v[i + 1]))
        x[i], x[i + 1] = s
        c[i], c[i + 1] = r


@numba.njit
def _rows(x, c, v):
    for i in range(len(x)):
        s, r = vector.add_product_in_place((take(x, i, LIKE),), (take(c, i, LIKE),), FACTOR, (take(v, i, LIKE),))
        put(x, i, s[0], LIKE)
        put(c, i, r[0], LIKE)


def in_lanes(x, c, v):
    _rows(*(z.reshape(-1, WIDTH) for z in (x, c, v)))


def once(a, x, y):
    """a x + y, rounded once."""
    return float(Fraction(a) * Fraction(x) + Fraction(y))


@pytest.mark.processor
@pytest.mark.parametrize("how", [in_arrays, in_tuples, in_lanes])
def test_every_type_rounds_the_exact_product_once(how):
    """If the processor does; the error then stays within the bound in the docstring of `add_product`."""
    x, c, v = np.random.default_rng(3).normal(size=(3, 80)) * np.array([[1.0], [1e-17], [1e-3]])
    rounded = once if FUSES else lambda a, x, y: a * x + y
    total = np.array([rounded(FACTOR, w, y) for w, y in zip(v, x + c, strict=True)])
    lost = np.array([rounded(FACTOR, w, y) for w, y in zip(v, c, strict=True)]) - (total - x)
    found, rest = x.copy(), c.copy()
    how(found, rest, v.copy())
    np.testing.assert_array_equal(found, total)
    np.testing.assert_array_equal(rest, lost)
    assert (rest != vector.add(x, c, FACTOR * v)[1]).any() == FUSES, "the control: a product rounded before"


@numba.njit
def _exact(a, x, y, out):
    for i in range(0, len(out), 2):
        out[i, 0] = exact_fma(a[i, 0], x[i, 0], y[i, 0])
        put(out, i + 1, exact_fma(-take(a, i + 1, LIKE), take(x, i + 1, LIKE), 1.0), LIKE)


def test_exact_fma_rounds_once_on_every_processor():
    """Numbers, and lanes with a number; the control rounds the product before it is added."""
    a, x, y = np.random.default_rng(2).normal(size=(3, 20, WIDTH))
    y[::2] = -(a * x)[::2]  # both sums cancel
    x[1::2] = 1 / a[1::2]
    found, exact = np.zeros_like(a), np.vectorize(once)
    _exact(a, x, y, found)
    assert np.array_equal(found[::2, 0], exact(a, x, y)[::2, 0])
    assert np.array_equal(found[1::2], exact(-a, x, 1.0)[1::2])
    assert not np.array_equal(found[1::2], (1.0 - a * x)[1::2])
    assert not np.array_equal(found[::2, 0], (a * x + y)[::2, 0])
    np.testing.assert_array_equal(fma(a, x, y), a * x + y)  # without compilation


FAMILY = {"mclachlan-atela-4": splitting, "rk4": runge_kutta, "chin-4a": force_gradient}
OTHERS = ["implicit-midpoint", "gauss-4", "rk4-projected-energy"]


def system(d):
    return chain(d, bond=lambda r: 1 / sp.sqrt(r**2 + 1))


def end(d, id, kind):
    """(end state, counts) of a prepared run, whose values must be of that kind ("array" or "tuple")."""
    start = {"q0": np.linspace(0.3, 1.7, d), "p0": np.linspace(-0.2, 0.4, d)}
    run = prepare(SimpleNamespace(system=system(d), **start), id)
    assert run.values == kind
    q, p, code = run(0.01, 200)
    assert code == run.SOLVED
    assert np.abs(np.concatenate([q - start["q0"], p - start["p0"]])).max() > 0.1, "the control: it moves"
    return [*q, *p], run.counts


@pytest.mark.processor
@pytest.mark.parametrize("id", FAMILY)
def test_arrays_in_place_and_tuples_agree_bit_by_bit(id, monkeypatch):
    d = FAMILY[id].MOST + 1
    arrays = end(d, id, "array")
    monkeypatch.setattr(FAMILY[id], "MOST", codegen.TUPLE_LIMIT)
    assert arrays == end(d, id, "tuple")


def test_explicit_families_go_in_place_beyond_their_size():
    for id, family in FAMILY.items():
        assert [kernel.prepare(method(id), system(d)).arrays for d in (family.MOST, family.MOST + 1)] == [False, True]
    made = system(splitting.MOST + 1)
    for id in OTHERS:
        assert not kernel.prepare(method(id), made).arrays
    assert made.grad_V().signature().args[0] == types.UniTuple(types.float64, made.d), "its own functions as they were"
    with codegen.precision(40):
        assert not kernel.prepare(method("rk4"), made, codegen.MULTIPRECISION).arrays


def test_a_lost_close_encounter_is_a_collision():
    """Eight bodies defined by loops, whose least distance is a function of the rows."""
    made = problem("n-body", N=8)
    q = 3 * np.array(made.q0).reshape(8, 3)
    q[0], q[1] = (10.0, 0.0, 0.0), (10.5, 0.0, 0.0)
    start = {"q0": q.ravel(), "p0": np.zeros(24)}
    assert integrate(made, "stormer-verlet", h=0.01, t_end=3.0, **start).status == "collision"
    assert integrate(made, "stormer-verlet", h=0.01, t_end=0.3, **start).status == "ok"


@pytest.mark.parametrize("id", ["gauss-8", "gauss-8-field", "dop853-relaxation", "scheme-v", "quinlan-tremaine-8"])
def test_memory_begins_at_a_cache_line(id):
    """Times of the same run differed by a fourth between processes where it did not."""
    run = prepare(problem("magnetic-mirror" if "relax" in id else "henon-heiles:box"), id)
    held = [*run._layout.carry, *run._layout.carry.work, *run._layout.step]
    arrays = [x for x in held if isinstance(x, np.ndarray) and x.dtype == float]
    assert len(arrays) > 2
    assert not any(x.ctypes.data % kernel.LINE for x in arrays)


def test_explicit_methods_allocate_no_matrix():
    made = problem("klein-gordon", N=64)
    held = {id: prepare(made, id)._layout.carry.work.rows.size for id in ("rk4", "stormer-verlet", "implicit-midpoint")}
    assert held["rk4"] == held["stormer-verlet"] == 1
    assert held["implicit-midpoint"] == np.prod(newton.shape(made.system.d))


# -- the family in the contract's docstring, beside the built-in method that it is -------------------------------------


def example() -> str:
    """The example code in the docstring of `kernel`, the contract of a family."""
    lines = inspect.getdoc(kernel).partition("would be::\n")[2].splitlines()
    end = next(i for i, line in enumerate(lines) if line.startswith("1. "))
    return textwrap.dedent("\n".join(lines[:end]))


@pytest.fixture
def pair(monkeypatch) -> tuple:
    """(a method of the family in the docstring, the built-in method that it must equal)."""
    twin, module = pb.method("implicit-midpoint"), ModuleType("phasebench.integrators.families.midpoint_example")
    for source in (vector, solve, kernel, loop):
        vars(module).update({k: v for k, v in vars(source).items() if not k.startswith("__")})
    monkeypatch.setitem(sys.modules, module.__name__, module)
    exec(compile(example(), "<example>", "exec"), vars(module))
    return replace(twin, id="midpoint-example", family="midpoint_example"), twin


SMALL = {"q": ["x", "y"], "p": ["u", "v"], "H": "(u**2 + v**2)/2*(1 + x**2/4) + x**4/4 + y**2/2 + x*v/5"}


def test_runs_on_tuples_as_the_registered_method(pair):
    twin = pair[1]
    system = pb.Hamiltonian(**SMALL)
    ends = [last(pb.integrate(system, m, h=0.05, steps=40, q0=[0.5, 0.2], p0=[0.1, 0.4])) for m in pair]
    assert np.abs(ends[0] - ends[1]).max() < 1e-14
    other = last(pb.integrate(system, twin, h=0.05, steps=41, q0=[0.5, 0.2], p0=[0.1, 0.4]))
    assert np.abs(ends[0] - other).max() > 1e-3  # the comparison can fail


def test_runs_on_arrays_as_the_registered_method(pair):
    system, n = chain(codegen.TUPLE_LIMIT + 2), codegen.TUPLE_LIMIT + 2
    q0, p0 = np.sin(np.arange(n)), np.zeros(n)
    ends = [last(pb.integrate(system, m, h=0.02, steps=20, q0=q0, p0=p0)) for m in pair]
    assert np.abs(ends[0] - ends[1]).max() < 1e-13
