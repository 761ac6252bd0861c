"""In-place versions of functions, which write into given arrays, and the cache of what families prepare."""

from __future__ import annotations

import copy
import importlib.util
from types import SimpleNamespace

import numpy as np
import pytest
from numba import types

from phasebench.integrators.compile import cache, codegen, preparation
from phasebench.integrators.compile.codegen import DOUBLE, MULTIPRECISION
from phasebench.integrators.values import inplace

ARRAY = types.Array(types.float64, 1, "C")


class System:
    """Stand-in for a system with d degrees of freedom."""

    def __init__(self, d, key="a toy", variant=""):
        self.d, self.key, self.variant, self._functions, self.fills = d, key, variant, {"g": print}, False


# -- in-place versions ------------------------------------------------------------------------------------------------

ONE = "def f(q, p):\n    a = 0.5 * q[0]\n    c = 2 * a * p[0]\n    return value((c, q[1] - c,))\n"
TWO = (
    "def f(q, p):\n    a = 0.5 * q[0]\n    c = 2 * a * p[0]\n    return value((c, q[1] - c,)), value((p[0], c, 3.0,))\n"
)


@pytest.mark.parametrize(("text", "sizes"), [(ONE, (2,)), (TWO, (2, 3))], ids=["one", "two"])
def test_the_in_place_version_writes_what_the_function_returns(text, sizes):
    found = []
    for build in (lambda arithmetic: text, inplace.write_in_place(lambda arithmetic: text)):
        namespace = {"value": np.array}
        exec(build(DOUBLE), namespace)
        found.append(namespace["f"])
    returning, writing = found
    q, p, outs = np.array([2.0, 5.0]), np.array([0.5]), [np.full(n, 9.0) for n in sizes]
    wanted = returning(q, p)
    assert writing(q, p, *outs) is None
    for out, expected in zip(outs, wanted if len(sizes) > 1 else (wanted,), strict=True):
        assert np.array_equal(out, expected)


def test_its_signature_ends_with_the_arrays_written():
    assert inplace.signature(ARRAY(ARRAY, ARRAY)) == types.none(ARRAY, ARRAY, ARRAY)
    two = types.Tuple((ARRAY, ARRAY))
    assert inplace.signature(two(ARRAY)) == types.none(ARRAY, ARRAY, ARRAY)


def test_large_compiled_systems_get_in_place_functions(monkeypatch):
    """`in_place_version` returns a system with in-place functions where arrays are compiled, else the system itself."""
    large, small = System(codegen.TUPLE_LIMIT + 1), System(codegen.TUPLE_LIMIT)
    for runs in (True, False):
        monkeypatch.setattr(inplace, "compiled", lambda runs=runs: runs)
        most = codegen.TUPLE_LIMIT
        twin = inplace.in_place_version(large, DOUBLE, most)
        assert (twin is large) != runs
        assert inplace.in_place_version(large, DOUBLE, most + 5) is twin
        assert inplace.in_place_version(small, DOUBLE, most) is small
        assert (inplace.in_place_version(small, DOUBLE, most - 1) is small) != runs
        assert inplace.in_place_version(large, MULTIPRECISION, most) is large
        if runs:
            assert (twin.d, twin.fills, twin._functions) == (large.d, True, {})
            assert inplace.in_place_version(copy.copy(large), DOUBLE, most) is not twin
    assert not large.fills
    assert large._functions


# -- what families prepare --------------------------------------------------------------------------------------------


class Method(SimpleNamespace):
    """Stand-in for a method, with a function that cannot be pickled."""


def method(order=2):
    return Method(order=order, family="splitting", data=(), with_parameters=lambda: None)


@pytest.fixture
def keeping(tmp_path, monkeypatch):
    """Switch the cache on disk on, in an empty folder, as if kernels were compiled."""
    monkeypatch.setenv("PHASEBENCH_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(preparation, "ENABLED", True)
    monkeypatch.setattr(codegen, "compiled", lambda: True)
    preparation._read.cache_clear()
    yield monkeypatch
    preparation._read.cache_clear()


def test_an_entry_depends_on_method_values_and_system(keeping):
    name = preparation.entry(method(), System(2))
    assert name.startswith("prepared-")
    assert preparation.entry(method(), System(2)) == name
    others = [
        preparation.entry(method(3), System(2)),
        preparation.entry(method(), System(2, key="another")),
        preparation.entry(method(), System(2, variant="4 lanes")),
        preparation.entry(method(), System(codegen.TUPLE_LIMIT + 1)),
    ]
    assert len({name, *others}) == 5
    assert preparation.entry(method(), System(2, key="")) is None
    assert preparation.entry(method(), SimpleNamespace(d=2)) is None
    assert preparation.entry(Method(order=lambda: 2, family="splitting", data=()), System(2)) is None, (
        "it cannot be written"
    )
    keeping.setattr(preparation, "ENABLED", False)
    assert preparation.entry(method(), System(2)) is None
    keeping.setattr(preparation, "ENABLED", True)
    keeping.setattr(codegen, "compiled", lambda: False)
    assert preparation.entry(method(), System(2)) is None


def test_an_entry_is_read_once_and_removed_if_unreadable(keeping):
    assert preparation.read(None) is None
    assert preparation.read("prepared-0.pickle") is None
    preparation.write(None, [1.0])
    assert not cache.folder().exists()
    preparation.write("prepared-1.pickle", [1.0, "a"])
    found = preparation.read("prepared-1.pickle")
    assert found == [1.0, "a"]
    assert preparation.read("prepared-1.pickle") is found
    preparation.write("prepared-2.pickle", (x for x in "ab"))
    assert cache.read("prepared-2.pickle") is None, "it cannot be written"
    cache.write("prepared-3.pickle", b"no pickle")
    assert preparation.read("prepared-3.pickle") is None
    assert cache.read("prepared-3.pickle") is None


def test_caching_is_on_by_default():
    spec = importlib.util.spec_from_file_location(f"{preparation.__name__}_anew", preparation.__file__)
    anew = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(anew)
    assert anew.ENABLED
    assert not preparation.ENABLED, "the suite's own choice"


def test_functions_are_stored_by_their_origins(keeping):
    class Generated:
        def __init__(self, origin=None):
            self.origin = origin

    made = Generated(("f" * 24, None))
    keeping.setattr(preparation, "is_jitted", lambda thing: isinstance(thing, Generated))
    keeping.setitem(codegen._ready, "f" * 24, made)
    preparation.write("prepared-4.pickle", {"g": made, "h": 0.5})
    found = preparation.read("prepared-4.pickle")
    assert found["g"] is made
    assert found["h"] == 0.5
    preparation.write("prepared-5.pickle", {"g": Generated()})
    assert preparation.read("prepared-5.pickle") is None, "it is of no text that is kept"
