"""Compiled functions with one or two results return them in registers: their C entry point is the function itself."""

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
    return machine.compiled(namespace["f"], T(T), vector.TUPLES, f"f|{d}"), T


def entry(f):
    """LLVM text of a function's C entry point."""
    text = next(iter(f.inspect_llvm().values()))
    begin = text.index("@cfunc.")
    return text[begin : text.index("\n}", begin)]


@pytest.mark.parametrize(("d", "inside"), [(1, True), (2, True), (3, False)])
def test_the_entry_is_the_function_if_registers_hold_the_result(d, inside, tmp_path, monkeypatch):
    f, T = compile_sum(d, tmp_path, monkeypatch)
    assert ("call i32" in entry(f)) is not inside
    assert ("fmul" in entry(f)) is inside
    call = numba.njit(T(types.FunctionType(T(T)), T), **vector.TUPLES)(lambda f, x: vector.of(f, x, x))
    x = tuple(0.3 + np.arange(d))
    np.testing.assert_allclose(call(f, x), [x[i] * x[i - 1] + i + 0.5 for i in range(d)], rtol=1e-15)


def test_which_signatures_return_in_registers():
    pair, three, lanes = (types.UniTuple(t, n) for t, n in ((types.float64, 2), (types.float64, 3), (Lanes(8), 2)))
    assert machine.in_registers(pair, (pair,))
    assert not machine.in_registers(three, (three,))
    assert not machine.in_registers(lanes, (lanes,))
    assert not machine.in_registers(pair, (pair, pair)), "an energy, and how well it is known"
    assert not machine.in_registers(types.none, (pair,))
