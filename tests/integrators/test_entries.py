"""Kernels call generated functions through an entry with C's calling convention that holds the function's code."""

from __future__ import annotations

import numba
import numpy as np
import pytest
from numba import types

from phasebench.integrators.compile import machine
from phasebench.integrators.values import vector
from phasebench.integrators.values.lanes import Lanes


def compile_sum(d, folder, monkeypatch):
    """(function of d numbers compiled here, its Numba type)."""
    monkeypatch.setenv("PHASEBENCH_CACHE", str(folder))
    T, namespace = types.UniTuple(types.float64, d), {"__name__": __name__}
    exec(f"def f(x): return ({', '.join(f'x[{i}] * x[{i - 1}] + {i}.5' for i in range(d))},)", namespace)
    return machine.Function(namespace["f"], T(T), vector.TUPLES, f"f|{d}"), T


@pytest.mark.parametrize("again", ["compiled", "loaded"])
@pytest.mark.parametrize("d", [1, 2, 3, 7])
def test_python_and_kernels_call_the_same_function(d, again, tmp_path, monkeypatch):
    if again == "loaded":
        compile_sum(d, tmp_path, monkeypatch)
    f, T = compile_sum(d, tmp_path, monkeypatch)
    call = numba.njit(T(types.FunctionType(T(T)), T), **vector.TUPLES)(lambda f, x: vector.apply(f, x, x))
    x = tuple(0.3 + np.arange(d))
    assert call(f, x) == f(x)
    np.testing.assert_allclose(f(x), [x[i] * x[i - 1] + i + 0.5 for i in range(d)], rtol=1e-15)


def test_a_function_is_a_pointer_of_its_signature(tmp_path, monkeypatch):
    f, T = compile_sum(2, tmp_path, monkeypatch)
    assert numba.typeof(f) == types.FunctionType(T(T))
    assert f.__wrapper_address__() > 0


def test_which_signatures_return_in_registers():
    pair, three, lanes = (types.UniTuple(t, n) for t, n in ((types.float64, 2), (types.float64, 3), (Lanes(8), 2)))
    assert vector.in_registers(pair, (pair,))
    assert not vector.in_registers(three, (three,))
    assert not vector.in_registers(lanes, (lanes,))
    assert not vector.in_registers(pair, (pair, pair)), "an energy, and how well it is known"
    assert not vector.in_registers(types.none, (pair,))
