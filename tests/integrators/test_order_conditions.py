"""Order conditions: series known in closed form, the relation of a quadratic kinetic energy, generalized orders."""

from __future__ import annotations

import itertools

import mpmath
import numpy as np
import pytest

from phasebench.integrators import coefficients
from phasebench.integrators.coefficients import TABLES
from phasebench.integrators.coefficients.fractions import suzuki, triple_jump
from phasebench.integrators.coefficients.order_conditions import (
    KINDS,
    TOLERANCE,
    classical_order,
    excess,
    normal_form,
    residuals,
    words,
)
from support.coefficient_tables import full_precision as full_precision

HALF = mpmath.mpf(1) / 2
LEAPFROG = [("B", HALF), ("A", mpmath.mpf(1)), ("B", HALF)]


def test_orders_for_general_systems():
    """A quadratic kinetic energy gives a relation between commutators of degree 4, on which some orders rest."""
    for table in TABLES:
        order = classical_order("splitting", coefficients.steps(table.name)) if table.kind != "composition" else 0
        if table.kind == "nystrom":
            assert (order < table.classical_order) == (table.classical_order > 4 or not table.symmetric), table.name
        elif table.kind == "near-integrable":
            assert order == table.classical_order, table.name


@pytest.mark.parametrize("name", ["forest-ruth", "kahan-li-6"])
def test_a_composition_and_its_splitting_have_the_same_order(name):
    steps = [(letter, g * w) for g in coefficients.steps(name) for letter, w in LEAPFROG]
    merged = [(letter, sum(w for _, w in group)) for letter, group in itertools.groupby(steps, key=lambda s: s[0])]
    assert classical_order("splitting", merged) == coefficients.table(name).classical_order


def test_fractal_compositions_have_their_order():
    for fractal, order in ((triple_jump, 2), (triple_jump, 4), (triple_jump, 6), (suzuki, 4)):
        assert classical_order("composition", fractal(order)) == order
    for order in (0, 3):
        with pytest.raises(ValueError, match="even order"):
            suzuki(order)


def test_residual_of_leapfrog():
    """The residual of degree 3 is [A, [A, B]] / 12 - [B, [B, A]] / 24 (Hairer, Lubich & Wanner 2006, III.4.2)."""
    residual = words(LEAPFROG, 3)
    assert all(abs(x) < TOLERANCE for r in residual[:3] for x in r)
    by_hand = as_array({("A", ("A", "B")): mpmath.mpf(1) / 12, ("B", ("B", "A")): -mpmath.mpf(1) / 24}, 3)
    assert max(abs(x - y) for x, y in zip(residual[3], by_hand, strict=True)) < TOLERANCE


def as_array(brackets, degree, left="", right=""):
    """A sum of nested commutators between two words, as an array over all words of that degree."""
    out = [mpmath.mpf(0)] * 2**degree
    for bracket, factor in brackets.items():
        for word, c in expand(bracket).items():
            out[int((left + word + right).replace("A", "0").replace("B", "1"), 2)] += factor * c
    return np.array(out, dtype=object)


def expand(bracket):
    """A nested commutator as {word: coefficient}."""
    if isinstance(bracket, str):
        return {bracket: 1}
    left, right = map(expand, bracket)
    out: dict = {}
    for (u, a), (v, b) in itertools.product(left.items(), right.items()):
        out[u + v] = out.get(u + v, 0) + a * b
        out[v + u] = out.get(v + u, 0) - a * b
    return out


RELATION, OTHER = ("B", ("B", ("B", "A"))), ("A", ("A", ("A", "B")))


@pytest.mark.parametrize(("left", "right"), [("", ""), ("B", ""), ("", "A"), ("BB", "BA"), ("A", "BB"), ("BBB", "A")])
def test_normal_forms_annihilate_the_relation_only(left, right):
    degree = len(left) + len(right) + 4
    assert not any(normal_form(as_array({RELATION: 1}, degree, left, right)))
    assert any(normal_form(as_array({OTHER: 1}, degree, left, right)))


@pytest.mark.parametrize("kind", KINDS)
def test_inconsistent_methods_have_order_0(kind):
    """Kicks or fractions that add up to 1/2 leave a residual of 1/2 at degree 1."""
    steps = [HALF] if kind == "composition" else [("A", mpmath.mpf(1)), ("B", HALF)]
    assert excess(residuals(kind, steps, 1), (1,)) == HALF
    assert classical_order(kind, steps) == 0
