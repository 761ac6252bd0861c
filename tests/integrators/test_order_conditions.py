"""Orders computed from coefficients alone: of every table, two-sided, with controls; and of series known by hand."""

from __future__ import annotations

import itertools

import mpmath
import numpy as np
import pytest

from phasebench.integrators import coefficients
from phasebench.integrators.coefficients import TABLES
from phasebench.integrators.coefficients.fractions import DIGITS, suzuki, triple_jump
from phasebench.integrators.coefficients.order_conditions import (
    KINDS,
    TOLERANCE,
    VISIBLE,
    classical_order,
    conditions,
    excess,
    leading,
    normal_form,
    odd_words,
    residuals,
    words,
)

ERROR = mpmath.mpf("1e-12")
HALF = mpmath.mpf(1) / 2
LEAPFROG = [("B", HALF), ("A", mpmath.mpf(1)), ("B", HALF)]
NYSTROM = [t for t in TABLES if t.kind == "nystrom"]


@pytest.fixture(autouse=True)
def full_precision():
    with mpmath.workdps(DIGITS):
        yield


def named(tables):
    return pytest.mark.parametrize("table", tables, ids=lambda t: t.name)


@named(TABLES)
def test_the_order_is_the_declared_one(table):
    """Every residual of the order vanishes, and for each power of eps that of the next degree does not."""
    steps = coefficients.steps(table.name)
    found = residuals(table.kind, steps, max(table.order) + 1)
    assert excess(found, table.order) < TOLERANCE
    assert min(leading(found, table.order)) > VISIBLE


@named(TABLES)
def test_control_an_error_of_1e_12_in_any_coefficient_is_seen(table):
    """Also one that leaves the sums as they are: what one coefficient gains its neighbour of the same kind loses."""
    steps = coefficients.steps(table.name)
    degree = min(3, min(table.order))
    for k in range(len(steps)):
        moved = shifted(steps, k, ERROR)
        assert excess(residuals(table.kind, moved, degree), (degree,)) > TOLERANCE
        if degree >= 3 and (other := neighbour(steps, k)) is not None:
            moved = shifted(moved, other, -ERROR)
            assert excess(residuals(table.kind, moved, degree), (degree,)) > TOLERANCE


def shifted(steps, k, by):
    out = list(steps)
    out[k] = out[k] + by if not isinstance(out[k], tuple) else (out[k][0], out[k][1] + by)
    return out


def neighbour(steps, k):
    """The next coefficient of the same kind and another value (a mirrored one would only reverse the words)."""
    if isinstance(steps[k], tuple):
        same = [j for j, (letter, w) in enumerate(steps) if letter == steps[k][0] and w != steps[k][1]]
    else:
        same = [j for j, g in enumerate(steps) if g != steps[k]]
    return same[0] if same else None


@named(NYSTROM)
def test_a_nystrom_splitting_has_its_order_for_quadratic_kinetic_energy_only(table):
    """For any two vector fields it is lower, but for symmetric ones of order 4: the relation is of degree 4, even."""
    lower = classical_order("splitting", coefficients.steps(table.name)) < table.classical_order
    assert lower == (table.classical_order > 4 or not table.symmetric)


@named([t for t in TABLES if t.kind == "near-integrable"])
def test_the_classical_order_of_a_near_integrable_splitting(table):
    assert classical_order("splitting", coefficients.steps(table.name)) == table.classical_order


@pytest.mark.parametrize("name", ["forest-ruth", "kahan-li-6", "yoshida-8d"])
def test_a_composition_has_the_same_order_written_out_as_a_splitting(name):
    steps = [(letter, g * w) for g in coefficients.steps(name) for letter, w in LEAPFROG]
    merged = [(letter, sum(w for _, w in group)) for letter, group in itertools.groupby(steps, key=lambda s: s[0])]
    assert classical_order("splitting", merged) == coefficients.table(name).classical_order


@pytest.mark.parametrize(("fractal", "order"), [(triple_jump, 2), (triple_jump, 4), (triple_jump, 6), (suzuki, 4)])
def test_the_fractals(fractal, order):
    assert classical_order("composition", fractal(order)) == order


@pytest.mark.parametrize("order", [-2, 0, 1, 3])
def test_a_fractal_of_no_even_order_is_refused(order):
    with pytest.raises(ValueError, match="even order"):
        suzuki(order)


def test_leapfrog_by_hand():
    """Of degree 3 the residual is [A, [A, B]] / 12 - [B, [B, A]] / 24 (Hairer, Lubich & Wanner 2006, III.4.2)."""
    residual = words(LEAPFROG, 3)
    assert all(abs(x) < TOLERANCE for r in residual[:3] for x in r)
    by_hand = as_array({("A", ("A", "B")): mpmath.mpf(1) / 12, ("B", ("B", "A")): -mpmath.mpf(1) / 24}, 3)
    assert max(abs(x - y) for x, y in zip(residual[3], by_hand, strict=True)) < TOLERANCE


def as_array(brackets, degree, left="", right=""):
    """A sum of nested commutators, between two words, as an array over the words of a degree."""
    out = [mpmath.mpf(0)] * 2**degree
    for bracket, factor in brackets.items():
        for word, c in expanded(bracket).items():
            out[int((left + word + right).replace("A", "0").replace("B", "1"), 2)] += factor * c
    return np.array(out, dtype=object)


def expanded(bracket):
    """A nested commutator as {word: coefficient}."""
    if isinstance(bracket, str):
        return {bracket: 1}
    left, right = map(expanded, bracket)
    out: dict = {}
    for (u, a), (v, b) in itertools.product(left.items(), right.items()):
        out[u + v] = out.get(u + v, 0) + a * b
        out[v + u] = out.get(v + u, 0) - a * b
    return out


RELATION, OTHER = ("B", ("B", ("B", "A"))), ("A", ("A", ("A", "B")))


@pytest.mark.parametrize(("left", "right"), [("", ""), ("B", ""), ("", "A"), ("BB", "BA"), ("A", "BB"), ("BBB", "A")])
def test_normal_forms_annihilate_the_relation_and_not_another(left, right):
    degree = len(left) + len(right) + 4
    assert not any(normal_form(as_array({RELATION: 1}, degree, left, right)))
    assert any(normal_form(as_array({OTHER: 1}, degree, left, right)))


def test_normal_forms_are_as_many_as_the_quotient_has_dimensions():
    """One relation of degree 4 without overlaps: the generating function of the dimensions is 1 / (1 - 2t + t^4)."""
    dimensions = [1]
    for n in range(1, 9):
        dimensions.append(2 * dimensions[n - 1] - (dimensions[n - 4] if n >= 4 else 0))
    assert [len(normal_form(np.zeros(2**n))) for n in range(1, 9)] == dimensions[1:]


def test_words_of_odd_letters():
    assert odd_words(4) == ((1, 1, 1, 1), (1, 3), (3, 1))
    assert [len(odd_words(n)) for n in range(1, 12)] == [1, 1, 2, 3, 5, 8, 13, 21, 34, 55, 89]


def test_a_generalised_order_asks_for_fewer_conditions():
    found = residuals("near-integrable", LEAPFROG, 4)
    few, all_of_them = conditions(found, (4, 2)), conditions(found, (4,))
    assert set(few) < set(all_of_them)
    assert (4, 1) in few
    assert (3, 2) not in few


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_not_consistent_has_order_0(kind):
    """Kicks or fractions that add up to a half: already of degree 1 a residual is a half, of every kind."""
    steps = [HALF] if kind == "composition" else [("A", mpmath.mpf(1)), ("B", HALF)]
    assert excess(residuals(kind, steps, 1), (1,)) == HALF
    assert classical_order(kind, steps) == 0


def test_an_unknown_kind_is_refused():
    with pytest.raises(ValueError, match="no kind"):
        residuals("rkn", LEAPFROG, 2)
