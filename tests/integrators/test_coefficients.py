"""Coefficient tables: digits refined from the published ones, misprints located, method records made from them."""

from __future__ import annotations

import io
import json
import runpy
import sys
from dataclasses import replace
from fractions import Fraction

import mpmath
import numpy as np
import pytest

from phasebench.integrators import coefficients
from phasebench.integrators.coefficients import BY_NAME, DAMAGED, TABLES, __main__, polished_numbers, steps
from phasebench.integrators.coefficients.fractions import substeps, suzuki, triple_jump
from phasebench.integrators.coefficients.gauss import gauss
from phasebench.integrators.coefficients.order_conditions import classical_order
from phasebench.integrators.coefficients.polish import (
    entry,
    independent_rows,
    jacobian,
    locate,
    polish,
    residual,
    starting_values,
)
from phasebench.integrators.coefficients.table import is_exact, unit, value
from phasebench.integrators.driver import integrate
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.records import compositions, splittings
from phasebench.integrators.registry import method
from phasebench.integrators.systems.hamiltonian import Hamiltonian
from support.coefficient_tables import MADE_UP
from support.coefficient_tables import full_precision as full_precision
from support.solutions import apart

ROUND_OFF = mpmath.mpf("1e-50")
#: A few tables of every kind; one has published numbers that are right to 12 decimals only.
AGAIN = (
    "yoshida-8d",
    "mclachlan-ss9",
    pytest.param("blanes-moan-s6", marks=pytest.mark.processor),
    "blanes-moan-srkn11b",
    pytest.param("calvo-sanz-serna-4", marks=pytest.mark.processor),
    "aba-864",
    "saba-3",
)
#: Other publications of tables: drifts of the first half of the splitting (Yoshida 1990; Suzuki & Umeno 1993).
ELSEWHERE = {
    "yoshida-6a": "0.78451361047755726382 0.23557321335935813369 -1.17767998417887100695 1.31518632068391121889",
    "suzuki-umeno-8": "0.7416703643506129534 -0.4091008258000315940 0.1907547102962383800 -0.5738624711160822667"
    " 0.2990641813036559238 0.3346249182452981838 0.3152930923967665966 -0.796887939352916354",
}
named = pytest.mark.parametrize("table", TABLES, ids=lambda t: t.name)


# -- polished against published --------------------------------------------------------------------------------------


@named
def test_polished_numbers_agree_with_the_published_digits(table):
    moved = apart(polished_numbers(table.name), starting_values(table))
    assert moved <= table.accuracy
    if table.good is not None:
        printed = 10 * max(unit(x) for x in table.published if not is_exact(x))
        assert moved > printed, "its published numbers are right to all their digits"
        assert moved > table.accuracy / 10, "its published numbers are right to more decimals than it says"


@named
def test_polishing_keeps_exact_numbers_and_meets_conditions(table):
    """Numbers published as exact stay; the order conditions hold to round-off."""
    for text, number in zip(table.published, polished_numbers(table.name), strict=True):
        assert not is_exact(text) or number == value(text)
    assert max(map(abs, residual(table, polished_numbers(table.name)))) < ROUND_OFF


#: Number of order conditions counted by hand: words per degree, only odd degrees for a symmetric method.
COUNTED = {
    "pefrl": 2 + 8,
    "ruth-3": 2 + 4 + 8,
    "blanes-moan-srkn6b": 2 + 8,
    "mclachlan-atela-4": 2 + 4 + 8 + 15,
    "aba-864": 2 + 8 + (1 + 5 + 10) + (1 + 7),
    "kahan-li-6": 1 + 2 + 5,
}


@pytest.mark.parametrize("name", COUNTED)
def test_the_number_of_order_conditions(name):
    assert len(residual(BY_NAME[name], polished_numbers(name))) == COUNTED[name]


@pytest.mark.parametrize("name", AGAIN)
def test_polishing_again_finds_the_same_numbers(name):
    assert apart(polish(BY_NAME[name]), polished_numbers(name)) < ROUND_OFF


def test_control_polishing_from_another_start():
    """In a family the nearest member to the start is found; an isolated solution is found from any near start."""
    free, isolated = BY_NAME["sofroniou-spaletta-6"], BY_NAME["yoshida-6b"]
    first, *others = starting_values(free)
    assert apart(polish(free, [first + mpmath.mpf("1e-15"), *others]), polished_numbers(free.name)) > 1e-17
    start = [x + mpmath.mpf("1e-12") for x in starting_values(isolated)]
    assert apart(polish(isolated, start), polished_numbers(isolated.name)) < ROUND_OFF


@pytest.mark.parametrize("name", ["blanes-moan-s6", "pefrl"])
def test_polished_numbers_are_the_nearest_of_their_family(name):
    """x - x0 is orthogonal to the tangent space of the family, to the digits of the Jacobian."""
    table = BY_NAME[name]
    moved = np.array([a - b for a, b in zip(polished_numbers(name), starting_values(table), strict=True)])
    J = jacobian(table, polished_numbers(name), range(len(moved)))
    rows = J[independent_rows(J)]
    factors = np.array(list(mpmath.lu_solve((rows @ rows.T).tolist(), list(rows @ moved))), dtype=object)
    assert len(rows) < len(moved)
    assert max(abs(moved - rows.T @ factors)) < mpmath.mpf("1e-38") < mpmath.mpf("1e-20") * max(abs(moved))


@pytest.fixture
def edit_table(monkeypatch):
    """Function that adds a coefficient table to the registered ones, or replaces the one of the same name."""

    def enter(table):
        monkeypatch.setitem(BY_NAME, table.name, table)
        monkeypatch.setattr(__main__, "TABLES", tuple(BY_NAME.values()))
        coefficients.describe.cache_clear()
        return table

    yield enter
    coefficients.describe.cache_clear()


def test_polished_numbers_belong_to_the_current_tables():
    assert {name: entry["published"] for name, entry in coefficients.read_polished().items()} == {
        t.name: t.digest for t in TABLES
    }


def test_an_edited_table_is_polished_on_demand(edit_table, tmp_path, monkeypatch):
    """Its method uses the edited numbers at once and warns until the command has stored them."""
    table = BY_NAME["blanes-moan-s6"]
    before = polished_numbers(table.name)
    edit_table(replace(table, a=("0.209515106713362", *table.a[1:])))
    with pytest.warns(UserWarning, match=r"blanes-moan-s6 is new or was edited.*python -m phasebench\.integrators"):
        after = polished_numbers(table.name)
    assert 1e-12 < apart(before, after) < 1e-9
    assert max(map(abs, residual(BY_NAME[table.name], after))) < ROUND_OFF
    path = tmp_path / "polished.json"
    monkeypatch.setattr(__main__, "POLISHED", path)
    __main__.main([])
    written = json.loads(path.read_text())
    changed = [name for name, entry in written.items() if entry != coefficients.read_polished()[name]]
    assert changed == [table.name]
    assert apart([value(x) for part in "ab" for x in written[table.name][part]], after) == 0


def test_new_tables_are_polished_and_wrong_orders_refused(edit_table):
    edit_table(replace(BY_NAME["pefrl"], name="pefrl-again"))
    with pytest.warns(UserWarning, match="pefrl-again is new"):
        assert apart(polished_numbers("pefrl-again"), polished_numbers("pefrl")) == 0
    edit_table(replace(BY_NAME["ruth-3"], b=("7/24", "3/4", "1/24")))
    with pytest.warns(UserWarning, match="edited"), pytest.raises(ArithmeticError, match="ruth-3"):
        splittings.weights(BY_NAME["ruth-3"])


def test_tables_without_stored_numbers_warn(edit_table):
    """The warning, which is an error in tests, names the command to run."""
    edit_table(replace(BY_NAME["pefrl"], name="pefrl-again"))
    with pytest.raises(UserWarning, match=r"pefrl-again is new.* is polished now; .*python -m phasebench\.integrators"):
        polished_numbers("pefrl-again")


OLD = {"b": ["as it was"]}


@pytest.fixture
def command(monkeypatch, tmp_path, capsys):
    """Function (tables, stored numbers, names) -> (written file, output) of the command that refines coefficients."""

    def run(tables, kept, *names):
        monkeypatch.setattr(coefficients, "TABLES", tuple(tables))
        monkeypatch.setattr(coefficients, "BY_NAME", {t.name: t for t in tables})
        monkeypatch.setattr(coefficients, "read_polished", lambda: kept)
        monkeypatch.setattr(coefficients, "POLISHED", path := tmp_path / "polished.json")
        monkeypatch.setattr(sys, "argv", ["command", *names])
        runpy.run_path(__main__.__file__, run_name="__main__")
        return path.read_text(), capsys.readouterr().out

    return run


def test_the_command_polishes_new_edited_and_named_tables(command):
    new, edited, named, left = (replace(MADE_UP, name=name) for name in ("new", "edited", "named", "left"))
    kept = {"gone": OLD, "left": OLD | {"published": left.digest}, "named": OLD | {"published": named.digest}}
    text, said = command((left, new, edited, named), kept | {"edited": OLD | {"published": "of before"}}, "named")
    written = json.loads(text)
    assert list(written) == ["left", "new", "edited", "named"]
    assert written["left"] == kept["left"]
    made = entry(MADE_UP)
    assert written["new"] == written["edited"] == written["named"] == made
    assert made["published"] == MADE_UP.digest
    assert value(made["b"][0]) == mpmath.mpf("0.5")
    change = f"{made['residual_before']} -> {made['residual_after']}"
    assert said.splitlines() == [f"new: {change}", f"edited: {change}", f"named: {change}"]
    assert made["residual_before"] == "2.0e-8"


def test_the_command_reports_each_table_at_once(command, monkeypatch):
    """Each takes up to minutes; buffered output would not be seen."""
    raw, seen = io.BytesIO(), []

    def looked(table):
        seen.append(raw.getvalue())
        return entry(table)

    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(raw))
    monkeypatch.setattr(sys.modules[entry.__module__], "entry", looked)
    command([replace(MADE_UP, name=name) for name in ("first", "second")], {})
    assert seen[0] == b""
    assert seen[1].startswith(b"first: 2.0e-8 -> ")


def test_the_command_leaves_current_entries_byte_identical(command):
    before = coefficients.POLISHED.read_text()
    assert command(TABLES, coefficients.read_polished()) == (before, "")


def test_the_command_refuses_an_unknown_name(command, tmp_path):
    with pytest.raises(InvalidInput, match="did you mean made-up"):
        command((MADE_UP,), {}, "made-op")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["forest-ruth", "pefrl"])
def test_stored_numbers_equal_those_of_the_command(name):
    assert entry(BY_NAME[name]) == coefficients.read_polished()[name]


def test_accuracy_of_printed_numbers():
    """Ten units in the last place of the shortest number; numbers of up to six digits and fractions count as exact."""
    printed = replace(BY_NAME["ruth-3"], a=("0.1234567", "0.12345678"), b=("2/3", "0.123456", "0.12345600"))
    assert [is_exact(x) for x in printed.published] == [False, False, True, True, True]
    assert abs(printed.accuracy * mpmath.mpf(10) ** 6 - 1) < ROUND_OFF
    assert replace(printed, good=12).accuracy == mpmath.mpf(10) ** -12
    assert replace(printed, a=("1/3",)).accuracy < ROUND_OFF


def test_a_start_without_a_near_solution_is_refused():
    table = BY_NAME["ruth-3"]
    wrong = [x + mpmath.mpf("1e-9") for x in starting_values(table)]
    with pytest.raises(ArithmeticError, match="ruth-3"):
        polish(table, wrong)


@pytest.mark.parametrize("name", DAMAGED)
def test_a_damaged_number_is_located_and_corrected(name):
    """The worst one first; the correction agrees with the true number far better than the damaged one."""
    table = BY_NAME[name]
    numbers, left = starting_values(table, DAMAGED[name]), dict(DAMAGED[name])
    while left:
        k, mended = locate(table, numbers)
        true = value(table.published[k])
        assert abs(mended - true) < mpmath.mpf("1e-6") * abs(value(left.pop(k)) - true)
        numbers[k] = true
    assert apart(numbers, starting_values(table)) == 0


def without(text, digits):
    """The text with `digits` consecutive characters removed, at every position."""
    return {text[:k] + text[k + digits :] for k in range(len(text))}


def test_damages_are_typical_misprints():
    """The damages are exchanged, dropped or added digits of the published numbers."""
    texts = [(BY_NAME[name].published[k], text) for name in DAMAGED for k, text in DAMAGED[name].items()]
    (right, exchanged), (shorter, longer), (whole, lost) = texts
    assert sorted(exchanged) == sorted(right)
    assert sum(a != b for a, b in zip(exchanged, right, strict=True)) == 2
    assert shorter in without(longer, 3)
    assert lost in without(whole, 1)


def test_closed_forms():
    assert apart(steps("forest-ruth"), triple_jump(4)) < ROUND_OFF
    assert apart(steps("suzuki-4"), suzuki(4)) < ROUND_OFF
    root = mpmath.sqrt(2) / 2
    assert apart([w for _, w in steps("mclachlan-atela-2")], (1 - root, root, root, 1 - root)) < 1e-17
    nodes, weights = gauss(3)
    outer = mpmath.sqrt(mpmath.mpf(3) / 5)
    assert apart(nodes, [(1 - outer) / 2, 0.5, (1 + outer) / 2]) < 1e-58
    assert apart(weights, [mpmath.mpf(n) / 18 for n in (5, 8, 5)]) < 1e-58


@pytest.mark.parametrize("name", ELSEWHERE)
def test_a_table_published_twice_is_the_same(name):
    texts = ELSEWHERE[name].split()
    assert apart(polished_numbers(name), [value(x) for x in texts]) <= 10 * max(map(unit, texts))


# -- records ---------------------------------------------------------------------------------------------------------


def letters(found):
    """[letter, weight] of the drifts A and kicks B in substeps (length c, mu, lambda), neighbours merged."""
    out = []
    for c, _, lam in found:
        for letter in "BA" if lam == 1 else "AB":
            if out and out[-1][0] == letter:
                out[-1][1] += c
            else:
                out.append([letter, c])
    return out


@pytest.mark.parametrize(
    "table", [t for t in TABLES if t.kind in ("splitting", "near-integrable")], ids=lambda t: t.name
)
def test_substeps_of_a_splitting_are_its_kicks_and_drifts(table):
    made, published = letters(method(table.name).data[1]), steps(table.name)
    assert [x for x, _ in made] == [x for x, _ in published]
    assert apart([w for _, w in made], [w for _, w in published]) < ROUND_OFF


def test_leapfrog_is_symplectic_euler_and_its_adjoint():
    half, one = mpmath.mpf(1) / 2, mpmath.mpf(1)
    assert substeps([("B", half), ("A", one), ("B", half)]) == ((half, 0, 1), (half, 1, 0))
    assert substeps([("A", half), ("B", one), ("A", half)]) == ((half, 1, 0), (half, 0, 1))


def test_control_unequal_sums_of_drifts_and_kicks_are_refused():
    with pytest.raises(ValueError, match="differ in their sums"):
        substeps([("A", mpmath.mpf(1) / 2), ("B", mpmath.mpf(1)), ("A", mpmath.mpf(1) / 3)])


@pytest.mark.parametrize("m", splittings.METHODS, ids=lambda m: m.id)
def test_the_order_of_a_splitting_follows_from_its_data(m):
    if m.family == "parametric":
        assert classical_order("splitting", letters(m.data[1])) == m.order
        return
    a, b = m.data
    parts = [(letter, w) for pair in zip(b, (*a, 0), strict=False) for letter, w in zip("BA", pair, strict=True)]
    assert classical_order("nystrom", parts) == m.order


@pytest.mark.parametrize("m", compositions.METHODS, ids=lambda m: m.id)
def test_the_order_of_a_composition_follows_from_its_data(m):
    rows = m.data[1] if m.family == "parametric" else m.data
    size = 1 if m.id.startswith("implicit-midpoint") else 2  # substeps per step of the base method
    fractions = [mpmath.fsum(r[0] for r in rows[i : i + size]) for i in range(0, len(rows), size)]
    assert classical_order("composition", fractions) == m.order
    if m.family == "schemes_iv_v":
        assert [r[2] for r in rows] == [i // size for i in range(len(rows))], "each fraction has a root of its own"


STEP, STEPS = 0.05, 20


def by_hand(table, q, p):
    """End state of a pendulum run from (q, p), with the kicks and drifts of a coefficient table applied in order."""
    for _ in range(STEPS):
        for letter, w in steps(table.name):
            if letter == "B":
                p = p - float(w) * STEP * np.sin(q)
            else:
                q = q + float(w) * STEP * p
    return np.array([q, p])


@pytest.mark.parametrize("name", ["mclachlan-atela-4", "blanes-moan-srkn14a", "ruth-3", "pefrl"])
def test_a_run_applies_the_kicks_and_drifts_of_its_table(name):
    pendulum = Hamiltonian(q="q", p="p", H="p**2/2 - cos(q)")
    s = integrate(pendulum, name, h=STEP, steps=STEPS, q0=[1.3], p0=[0.4])
    assert np.abs(np.hstack([s.q[-1], s.p[-1]]) - by_hand(BY_NAME[name], 1.3, 0.4)).max() < 1e-13


def test_a_nystrom_splitting_refuses_another_kinetic_energy():
    quartic = Hamiltonian(q="q", p="p", H="p**4/4 + p**2/2 + q**2/2")
    with pytest.raises(InvalidInput, match="quadratic kinetic energy"):
        integrate(quartic, "okunbor-skeel-6", h=0.1, steps=1, q0=[1.0], p0=[0.0])


# -- compositions ----------------------------------------------------------------------------------------------------


def test_composition_by_name_equals_composition_by_fractions():
    base = method("implicit-midpoint")
    a, b = compositions.compose(base, "kahan-li-6"), compositions.compose(base, steps("kahan-li-6"))
    assert a.data == b.data == method("implicit-midpoint-kahan-li-6").data
    assert (b.order, b.symmetric) == (6, True)
    assert compositions.compose(base, [Fraction(1, 2), "0.5"]).order == 2
    assert compositions.compose(base, list(map(float, steps("kahan-li-6")))).order == 6


def test_a_composition_keeps_the_parameters_of_its_base():
    m = compositions.compose(method("scheme-iii"), "forest-ruth")
    for lam in (Fraction(1, 3), Fraction(-2)):
        made, known = m(lam=lam).data[1], method("scheme-iii-yoshida-4", lam=lam).data[1]
        assert [row[1:] for row in made] == [row[1:] for row in known]
        assert apart([row[0] for row in made], [row[0] for row in known]) < ROUND_OFF


def test_a_composition_of_unequal_fractions_is_not_symmetric():
    made = compositions.compose(method("stormer-verlet"), [Fraction(1, 3), Fraction(2, 3)])
    assert (made.order, made.symmetric) == (2, False)


def test_nested_compositions_number_their_roots():
    twice = compositions.compose(method("scheme-iv"), [Fraction(1, 2), Fraction(1, 2)])
    assert [row[2] for row in twice.data] == [0, 1]
    assert [row[2] for row in compositions.compose(twice, "forest-ruth").data] == [0, 1, 2, 3, 4, 5]


def test_fractions_must_add_up_to_one():
    base = method("stormer-verlet")
    assert compositions.compose(base, ["0.5", "0.5000000000005"]).order == 2
    with pytest.raises(InvalidInput, match="not to 1"):
        compositions.compose(base, ["0.5", "0.500000000005"])


@pytest.mark.parametrize(
    ("base", "fractions", "message"),
    [
        (method("symplectic-euler-p"), "kahan-li-6", "not symmetric"),
        (method("scheme-i"), "kahan-li-6", "not symmetric"),
        (method("kahan-li-6"), "kahan-li-6", "of order 6"),
        (method("avf"), "kahan-li-6", "family"),
        (method("stormer-verlet"), "kahan-li-7", "did you mean"),
        (method("stormer-verlet"), "blanes-moan-s6", "is a splitting"),
    ],
)
def test_invalid_compositions_are_refused(base, fractions, message):
    with pytest.raises(InvalidInput, match=message):
        compositions.compose(base, fractions)


def test_a_parameter_that_breaks_symmetry_is_refused():
    m = compositions.compose(method("scheme-i", lam=Fraction(1, 2)), "kahan-li-6")
    assert m.symmetric
    with pytest.raises(InvalidInput, match="not symmetric"):
        m(lam=Fraction(1, 3))
