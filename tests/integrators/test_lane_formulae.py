"""Functions generated from formulas for SIMD lanes: which formulas are supported, and where results are written."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import sympy as sp

from phasebench.integrators.compile import codegen
from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.compile.printing import Program
from phasebench.integrators.values import lane_formulae, lanes

x, y, z, w = sp.symbols("x y z w", positive=True)
SYSTEM = SimpleNamespace(content="a toy", d=2)
ARGUMENTS = [("q", [x, y]), ("s", [z]), ("p", [w])]
RESULTS = [x * y + z, sp.sin(w) / sp.sqrt(x) - y**3, sp.exp(-z) * sp.cos(x) ** 2 + sp.Rational(1, 3)]


@pytest.mark.parametrize(
    "kept",
    [
        x + y * z,
        x**2 - 3 / y,
        (x + y) ** 12,
        x**-12,
        sp.sqrt(x + 1) * x ** sp.Rational(-5, 2),
        sp.sin(x) * sp.cos(y) + sp.exp(z),
        x,
    ],
    ids=str,
)
def test_supported_functions_and_powers(kept):
    assert lane_formulae.supported([kept])
    assert lane_formulae.supported([kept, x * y])


@pytest.mark.parametrize(
    "other",
    [
        sp.tan(x),
        sp.sin(x) + sp.log(y),
        abs(sp.sin(x) - y),
        x ** sp.Rational(1, 3),
        (x + y) ** sp.Rational(49, 2),
        x**49,
        x**-49,
        x**y,
        x**sp.pi,
    ],
    ids=str,
)
def test_unsupported_functions_and_powers(other):
    assert not lane_formulae.supported([other])
    assert not lane_formulae.supported([x * y, sp.sin(other * z)])


@pytest.mark.parametrize("n", [2, 4])
def test_results_follow_the_arguments_in_the_table(n):
    f = lane_formulae.function(f"toy {n}", ARGUMENTS, lambda: Program((), [RESULTS]), n, SYSTEM, DOUBLE)
    given = np.random.default_rng(n).uniform(0.5, 2.0, size=(4, n))
    table = np.vstack([given, np.full((4, n), 9.0)])
    f(table)
    X, Y, Z, W = given
    wanted = [X * Y + Z, np.sin(W) / np.sqrt(X) - Y**3, np.exp(-Z) * np.cos(X) ** 2 + 1 / 3]
    assert np.array_equal(table[:4], given)
    assert table[4:7] == pytest.approx(np.array(wanted), rel=1e-14)
    assert (table[7] == 9).all()


def test_functions_are_keyed_by_formula_and_lanes(monkeypatch):
    monkeypatch.setattr(codegen, "function", lambda key, text, signature, arithmetic: (key, signature))
    keys = set()
    for kind, n, system in (("a", 2, SYSTEM), ("b", 2, SYSTEM), ("a", 4, SYSTEM)):
        key, signature = lane_formulae.function(kind, ARGUMENTS, lambda: Program((), [RESULTS]), n, system, DOUBLE)
        assert [a.ndim for a in signature.args] == [2]
        keys.add(key)
    keys.add(lane_formulae.function("a", ARGUMENTS, lambda: [], 2, SimpleNamespace(content="another", d=2), DOUBLE)[0])
    assert len(keys) == 4


def test_edited_operations_give_other_functions(monkeypatch):
    before = lane_formulae._operations.__wrapped__()
    monkeypatch.setattr(lanes, "__file__", __file__)
    assert lane_formulae._operations.__wrapped__() != before
