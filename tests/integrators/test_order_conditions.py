"""Order computed from coefficients: for every table, with controls, and for series known in closed form."""

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
    VISIBLE,
    classical_order,
    conditions,
    excess,
    leading_norms,
    next_degrees,
    normal_form,
    odd_words,
    residuals,
    words,
)
from support.coefficient_tables import full_precision as full_precision

ERROR = mpmath.mpf("1e-12")
HALF = mpmath.mpf(1) / 2
LEAPFROG = [("B", HALF), ("A", mpmath.mpf(1)), ("B", HALF)]
NYSTROM = [t for t in TABLES if t.kind == "nystrom"]


def parametrize_tables(tables):
    """Decorator that runs a test for each coefficient table, with the tables' names as ids."""
    return pytest.mark.parametrize("table", tables, ids=lambda t: t.name)


@parametrize_tables(TABLES)
def test_the_order_is_the_declared_one(table):
    """All residuals up to the order vanish; for each power of epsilon one of the next degree does not."""
    steps = coefficients.steps(table.name)
    found = residuals(table.kind, steps, next_degrees(table.order))
    assert excess(found, table.order) < TOLERANCE
    assert min(leading_norms(found, table.order)) > VISIBLE


@parametrize_tables(TABLES)
def test_control_a_coefficient_off_by_1e_12_is_seen(table):
    """It leaves a residual, also where another coefficient of the same kind makes up for it in the sum."""
    steps = coefficients.steps(table.name)
    degree = min(3, min(table.order))
    for k in range(len(steps)):
        moved = shift(steps, k, ERROR)
        assert excess(residuals(table.kind, moved, degree), (degree,)) > TOLERANCE
        if degree >= 3 and (other := neighbour(steps, k)) is not None:
            moved = shift(moved, other, -ERROR)
            assert excess(residuals(table.kind, moved, degree), (degree,)) > TOLERANCE


def shift(steps, k, by):
    """The coefficients of a splitting with number k changed by ``by``."""
    out = list(steps)
    out[k] = out[k] + by if not isinstance(out[k], tuple) else (out[k][0], out[k][1] + by)
    return out


def neighbour(steps, k):
    """Index of a coefficient of the same kind with another value (an equal one would only mirror words), or None."""
    if isinstance(steps[k], tuple):
        same = [j for j, (letter, w) in enumerate(steps) if letter == steps[k][0] and w != steps[k][1]]
    else:
        same = [j for j, g in enumerate(steps) if g != steps[k]]
    return same[0] if same else None


@parametrize_tables(NYSTROM)
def test_nystrom_splittings_need_quadratic_kinetic_energy(table):
    """For general vector fields their order is lower, except for symmetric methods of order 4.

    The relation between commutators that a quadratic kinetic energy implies has degree 4.
    """
    lower = classical_order("splitting", coefficients.steps(table.name)) < table.classical_order
    assert lower == (table.classical_order > 4 or not table.symmetric)


@parametrize_tables([t for t in TABLES if t.kind == "near-integrable"])
def test_the_classical_order_of_a_near_integrable_splitting(table):
    assert classical_order("splitting", coefficients.steps(table.name)) == table.classical_order


@pytest.mark.parametrize("name", ["forest-ruth", "kahan-li-6", "yoshida-8d"])
def test_a_composition_and_its_splitting_have_the_same_order(name):
    steps = [(letter, g * w) for g in coefficients.steps(name) for letter, w in LEAPFROG]
    merged = [(letter, sum(w for _, w in group)) for letter, group in itertools.groupby(steps, key=lambda s: s[0])]
    assert classical_order("splitting", merged) == coefficients.table(name).classical_order


@pytest.mark.parametrize(("fractal", "order"), [(triple_jump, 2), (triple_jump, 4), (triple_jump, 6), (suzuki, 4)])
def test_fractal_compositions_have_their_order(fractal, order):
    assert classical_order("composition", fractal(order)) == order


@pytest.mark.parametrize("order", [-2, 0, 1, 3])
def test_a_fractal_needs_an_even_order(order):
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


def test_the_number_of_normal_forms():
    """One relation of degree 4 without overlaps: the dimensions have the generating function 1 / (1 - 2t + t^4)."""
    dimensions = [1]
    for n in range(1, 9):
        dimensions.append(2 * dimensions[n - 1] - (dimensions[n - 4] if n >= 4 else 0))
    assert [len(normal_form(np.zeros(2**n))) for n in range(1, 9)] == dimensions[1:]


def test_words_with_odd_letters():
    assert odd_words(4) == ((1, 1, 1, 1), (1, 3), (3, 1))
    assert [len(odd_words(n)) for n in range(1, 12)] == [1, 1, 2, 3, 5, 8, 13, 21, 34, 55, 89]


def test_a_generalized_order_has_fewer_conditions():
    found = residuals("near-integrable", LEAPFROG, 4)
    few, all_of_them = conditions(found, (4, 2)), conditions(found, (4,))
    assert set(few) < set(all_of_them)
    assert (4, 1) in few
    assert (3, 2) not in few


@pytest.mark.parametrize("kind", KINDS)
def test_inconsistent_methods_have_order_0(kind):
    """Kicks or fractions that add up to 1/2 leave a residual of 1/2 at degree 1."""
    steps = [HALF] if kind == "composition" else [("A", mpmath.mpf(1)), ("B", HALF)]
    assert excess(residuals(kind, steps, 1), (1,)) == HALF
    assert classical_order(kind, steps) == 0


def test_an_unknown_kind_is_refused():
    with pytest.raises(ValueError, match="no kind"):
        residuals("rkn", LEAPFROG, 2)
