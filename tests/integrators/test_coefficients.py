"""Tables of coefficients: orders from the numbers, digits beyond the published ones, the records made from them."""

from __future__ import annotations

import json
import runpy
import sys
from dataclasses import replace
from fractions import Fraction

import mpmath
import pytest

from phasebench.benchmarks.studies.catalogue.coefficients import DAMAGED
from phasebench.integrators import coefficients
from phasebench.integrators.coefficients import (
    BY_NAME,
    GROUPS,
    TABLES,
    __main__,
    force_gradient,
    polished_numbers,
    processed,
    steps,
)
from phasebench.integrators.coefficients.fractions import DIGITS, substeps, suzuki, triple_jump
from phasebench.integrators.coefficients.order_conditions import (
    TOLERANCE,
    VISIBLE,
    classical_order,
    excess,
    leading_norms,
    modified_residuals,
    next_degrees,
    residuals,
)
from phasebench.integrators.coefficients.polish import (
    entry,
    locate,
    polish,
    starting_values,
)
from phasebench.integrators.coefficients.table import Table, is_exact, unit, value
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.records import compositions, splittings
from phasebench.integrators.registry import method

#: Leapfrog with a wrong digit in its kick.
MADE_UP = Table("made-up", "splitting", (2,), "made up", (), a=("1",), b=("0.50000001",))
ROUND_OFF, ERROR = mpmath.mpf("1e-50"), mpmath.mpf("1e-12")
EVERY = [t for t in BY_NAME.values() if not t.printed]
each = pytest.mark.parametrize("table", EVERY, ids=lambda t: t.name)


def apart(a, b):
    """The largest difference of two sequences, entry by entry."""
    return max(abs(x - y) for x, y in zip(a, b, strict=True))


@pytest.fixture(autouse=True)
def full_precision():
    with mpmath.workdps(DIGITS):
        yield


@pytest.mark.parametrize("table", GROUPS["sampling"], ids=lambda t: t.name)
def test_splittings_used_as_printed_have_order_2(table):
    (letter, weight), *rest = steps(table.name)
    assert classical_order("splitting", [(letter, weight), *rest]) == 2
    assert classical_order("splitting", [(letter, weight + 1e-9), *rest], tolerance=1e-12) == 0, "the control"


def test_every_name_is_of_one_table():
    assert len(BY_NAME) == sum(map(len, GROUPS.values()))


def errors(table, numbers):
    """(largest residual up to the order, least of the next degree's largest ones) of a table's order conditions."""
    if isinstance(table, force_gradient.ForceGradientTable):
        *own, beyond = modified_residuals(table.steps(numbers), table.order[0] + 1)
        return max(abs(x) for r in own for x in r), max(abs(x) for x in beyond)
    found = residuals(table.kind, table.steps(numbers), next_degrees(table.order))
    return excess(found, table.order), min(leading_norms(found, table.order))


@each
def test_the_order_is_the_declared_one(table):
    """All residuals up to the order vanish; for each power of epsilon one of the next degree does not."""
    own, beyond = errors(table, polished_numbers(table.name))
    assert own < TOLERANCE
    high = max(table.order)  # coefficients of the exact flow are 1 / n!, and errors of long quadrature rules far less
    assert beyond > (VISIBLE if high <= 10 else VISIBLE / mpmath.factorial(high + 1))


@each
def test_control_a_number_off_by_1e_12_is_seen(table):
    processes = isinstance(table, processed.ProcessedTable)  # numbers change before those that follow from them
    modified = isinstance(table, force_gradient.ForceGradientTable)
    degree = max(table.order) if processes else min(3, *table.order)
    count = len(table.published)
    if modified and table.order == (2,):
        count -= len(table.c)  # a gradient of any weight has order 2
    for k in (0, count - 1) if processes and degree >= 8 else range(count):
        moved = list(polished_numbers(table.name))
        moved[k] += ERROR
        if modified:
            assert max(abs(x) for r in modified_residuals(table.steps(moved), degree) for x in r) > TOLERANCE, k
        else:
            bounds = table.order if processes else (degree,)
            assert excess(residuals(table.kind, table.steps(moved), degree), bounds) > TOLERANCE, k


@each
def test_polished_numbers_agree_with_the_published_digits(table):
    """Numbers published as exact stay; what is stored belongs to the table as it is now."""
    assert coefficients.read_polished()[table.name]["published"] == table.digest
    pairs = list(zip(table.published, polished_numbers(table.name), strict=True))
    assert all(not is_exact(text) or number == value(text) for text, number in pairs)
    moved = max(abs(value(text) - number) for text, number in pairs)
    assert moved <= table.accuracy
    if table.good is not None:
        assert moved > 10 * max(unit(x) for x in table.published if not is_exact(x)), "all its digits hold"
        assert moved > table.accuracy / 10, "more of its decimals hold than it says"


#: Other publications of tables: drifts of the first half of the splitting (Yoshida 1990; Suzuki & Umeno 1993).
ELSEWHERE = {
    "yoshida-6a": "0.78451361047755726382 0.23557321335935813369 -1.17767998417887100695 1.31518632068391121889",
    "suzuki-umeno-8": "0.7416703643506129534 -0.4091008258000315940 0.1907547102962383800 -0.5738624711160822667"
    " 0.2990641813036559238 0.3346249182452981838 0.3152930923967665966 -0.796887939352916354",
}


@pytest.mark.parametrize("name", ELSEWHERE)
def test_a_table_published_twice_is_the_same(name):
    texts = ELSEWHERE[name].split()
    assert apart(polished_numbers(name), [value(x) for x in texts]) <= 10 * max(map(unit, texts))


def test_closed_forms_and_other_programs():
    assert apart(steps("forest-ruth"), triple_jump(4)) < ROUND_OFF
    assert apart(steps("suzuki-4"), suzuki(4)) < ROUND_OFF
    root = mpmath.sqrt(2) / 2
    assert apart([w for _, w in steps("mclachlan-atela-2")], (1 - root, root, root, 1 - root)) < 1e-17
    # McLachlan 1995, BIT; REBOUND's `reb_saba_cc`, whose halves stand at either end of the step
    assert mpmath.nstr(polished_numbers("mclachlan-aba-84")[0], 15) == "0.0753469602698929"
    known = {2: 0.01116454968463011276968973577, 3: 0.005634593363122809402267823769, 4: 0.003396775048208601331532}
    for n, c in known.items():
        first, *_, last = steps(f"sabac-{n}")
        assert float(first[2] + last[2]) == pytest.approx(c, rel=1e-15)


@pytest.mark.parametrize("table", GROUPS["processed"], ids=lambda t: t.name)
def test_a_kernel_needs_its_processor(table):
    """The kernel alone has a lower order; a record has the order of the systems it runs on."""
    found = residuals(table.kind, table.kernel(polished_numbers(table.name)), max(table.order))
    assert excess(found, table.order) > VISIBLE
    made, order = method(table.name), table.classical_order
    if "quadratic kinetic energy" in made.requires:
        found = residuals("nystrom", steps(table.name), made.order + 1)
        assert excess(found, (made.order,)) < 1e-16
        assert min(leading_norms(found, (made.order,))) > VISIBLE
        assert made.order > order
    else:
        assert made.order == order


@pytest.mark.parametrize("name", [t.name for t in GROUPS["force_gradient"] if t.hessian_free and t.order[0] == 6])
def test_order_6_without_the_hessian_needs_one_more_condition(name):
    """The second force differs by c^2 / b at degree 5; the methods of order 6 with the Hessian do not meet this."""
    sums = [
        abs(mpmath.fsum(c * c / b for letter, b, c in steps(x) if letter == "B")) for x in (name, "omelyan-6-5f3g-p")
    ]
    assert sums[0] < ROUND_OFF
    assert sums[1] > 1e-5


# -- polishing --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["forest-ruth", "chin-4b", "blanes-casas-ros-p2", "blanes-moan-srkn6b", "saba-3"])
def test_stored_numbers_are_those_of_the_command(name):
    assert entry(BY_NAME[name]) == coefficients.read_polished()[name]


def test_accuracy_of_printed_numbers():
    """Ten units in the last place of the shortest number; numbers of up to six digits and fractions count as exact."""
    printed = replace(BY_NAME["ruth-3"], a=("0.1234567", "0.12345678"), b=("2/3", "0.123456", "0.12345600"))
    assert [is_exact(x) for x in printed.published] == [False, False, True, True, True]
    assert abs(printed.accuracy * mpmath.mpf(10) ** 6 - 1) < ROUND_OFF
    assert replace(printed, good=12).accuracy == mpmath.mpf(10) ** -12
    assert replace(printed, a=("1/3",)).accuracy < ROUND_OFF


def test_a_damaged_number_is_located_and_corrected():
    """The worst one first; the correction agrees with the true number far better than the damaged one."""
    name = "aba-864"
    table = BY_NAME[name]
    numbers, left = starting_values(table, DAMAGED[name]), dict(DAMAGED[name])
    while left:
        k, mended = locate(table, numbers)
        true = value(table.published[k])
        assert abs(mended - true) < mpmath.mpf("1e-6") * abs(value(left.pop(k)) - true)
        numbers[k] = true
    assert apart(numbers, starting_values(table)) == 0


def test_a_start_without_a_near_solution_is_refused():
    table = BY_NAME["ruth-3"]
    with pytest.raises(ArithmeticError, match="ruth-3"):
        polish(table, [x + mpmath.mpf("1e-9") for x in starting_values(table)])
    with pytest.raises(ArithmeticError, match="has not the order 6"):
        polish(replace(BY_NAME["chin-4b"], order=(6,)))


@pytest.fixture
def edit_table(monkeypatch):
    """Function that adds a coefficient table to the registered ones, or replaces the one of the same name."""

    def enter(table):
        monkeypatch.setitem(BY_NAME, table.name, table)
        coefficients.describe.cache_clear()
        return table

    yield enter
    coefficients.describe.cache_clear()


def test_an_edited_table_is_polished_on_demand(edit_table):
    """Its method uses the edited numbers at once and warns until the command has stored them."""
    name = "blanes-moan-s6"
    before = polished_numbers(name)
    edited = edit_table(replace(BY_NAME[name], a=("0.209515106713362", *BY_NAME[name].a[1:])))
    with pytest.warns(UserWarning, match=r"blanes-moan-s6 is new or was edited.*python -m phasebench\.integrators"):
        after = polished_numbers(name)
    assert 1e-12 < apart(before, after) < 1e-9
    assert edited.excess(after) < ROUND_OFF
    edit_table(replace(BY_NAME["ruth-3"], b=("7/24", "3/4", "1/24")))
    with pytest.warns(UserWarning, match="edited"), pytest.raises(ArithmeticError, match="ruth-3"):
        splittings.weights(BY_NAME["ruth-3"])


OLD = {"numbers": ["as it was"]}


@pytest.fixture
def command(monkeypatch, tmp_path, capsys):
    """Function (tables, stored numbers, names) -> (written file, output) of the command that refines coefficients."""

    def run(tables, kept, *names):
        monkeypatch.setattr(coefficients, "BY_NAME", {t.name: t for t in tables})
        monkeypatch.setattr(coefficients, "read_polished", lambda: kept)
        monkeypatch.setattr(coefficients, "POLISHED", path := tmp_path / "polished.json")
        monkeypatch.setattr(sys, "argv", ["command", *names])
        runpy.run_path(__main__.__file__, run_name="__main__")
        return path.read_text(), capsys.readouterr().out

    return run


def test_the_command_polishes_new_edited_and_named_tables(command, tmp_path):
    new, edited, named, left = (replace(MADE_UP, name=name) for name in ("new", "edited", "named", "left"))
    kept = {"gone": OLD, "left": OLD | {"published": left.digest}, "named": OLD | {"published": named.digest}}
    text, said = command((left, new, edited, named), kept | {"edited": OLD | {"published": "of before"}}, "named")
    written, made = json.loads(text), entry(MADE_UP)
    assert list(written) == ["left", "new", "edited", "named"]
    assert written["left"] == kept["left"]
    assert written["new"] == written["edited"] == written["named"] == made
    assert value(made["numbers"][1]) == mpmath.mpf("0.5")
    assert made["residual_before"] == "2.0e-8"
    assert len(said.splitlines()) == 3
    with pytest.raises(InvalidInput, match="did you mean made-up"):
        command((MADE_UP,), {}, "made-op")


def test_the_command_leaves_current_entries_byte_identical(command):
    before = coefficients.POLISHED.read_text()
    assert command(BY_NAME.values(), coefficients.read_polished()) == (before, "")


# -- records ----------------------------------------------------------------------------------------------------------


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


@pytest.mark.parametrize("m", [*splittings.METHODS, *compositions.METHODS], ids=lambda m: m.id)
def test_the_order_of_a_record_follows_from_its_data(m):
    table = BY_NAME.get(m.id)
    if m.family == "force_gradient" or (table and table.printed):
        return  # the table's own order is tested
    if table and not table.gamma and m.family == "parametric":
        assert classical_order("splitting", letters(m.data[1])) == m.order
        return
    if table and not table.gamma:
        a, b = m.data
        parts = [(letter, w) for pair in zip(b, (*a, 0), strict=False) for letter, w in zip("BA", pair, strict=True)]
        assert classical_order("nystrom", parts) == m.order
        return
    rows = m.data[1] if m.family == "parametric" else m.data
    size = 1 if m.id.startswith("implicit-midpoint") else 2  # substeps per step of the base method
    fractions = [mpmath.fsum(r[0] for r in rows[i : i + size]) for i in range(0, len(rows), size)]
    assert classical_order("composition", fractions) == m.order
    if m.family == "schemes_iv_v":
        assert [r[2] for r in rows] == [i // size for i in range(len(rows))], "each fraction has a root of its own"


def test_leapfrog_is_symplectic_euler_and_its_adjoint():
    half, one = mpmath.mpf(1) / 2, mpmath.mpf(1)
    assert substeps([("B", half), ("A", one), ("B", half)]) == ((half, 0, 1), (half, 1, 0))
    assert substeps([("A", half), ("B", one), ("A", half)]) == ((half, 1, 0), (half, 0, 1))
    with pytest.raises(ValueError, match="differ in their sums"):
        substeps([("A", half), ("B", one), ("A", one / 3)])


def test_compositions():
    base = method("implicit-midpoint")
    a, b = compositions.compose(base, "kahan-li-6"), compositions.compose(base, steps("kahan-li-6"))
    assert a.data == b.data == method("implicit-midpoint-kahan-li-6").data
    assert (b.order, b.symmetric) == (6, True)
    assert compositions.compose(base, list(map(float, steps("kahan-li-6")))).order == 6
    unequal = compositions.compose(method("stormer-verlet"), [Fraction(1, 3), Fraction(2, 3)])
    assert (unequal.order, unequal.symmetric) == (2, False)
    twice = compositions.compose(method("scheme-iv"), [Fraction(1, 2), "0.5"])
    assert [row[2] for row in twice.data] == [0, 1]
    assert [row[2] for row in compositions.compose(twice, "forest-ruth").data] == [0, 1, 2, 3, 4, 5]
    m = compositions.compose(method("scheme-iii"), "forest-ruth")
    for lam in (Fraction(1, 3), Fraction(-2)):
        made, known = m(lam=lam).data[1], method("scheme-iii-yoshida-4", lam=lam).data[1]
        assert [row[1:] for row in made] == [row[1:] for row in known]
        assert apart([row[0] for row in made], [row[0] for row in known]) < ROUND_OFF


@pytest.mark.parametrize(
    ("base", "fractions", "message"),
    [
        (method("symplectic-euler-p"), "kahan-li-6", "not symmetric"),
        (method("scheme-i"), "kahan-li-6", "not symmetric"),
        (method("shake"), "yoshida-6a", "not symmetric"),
        (method("kahan-li-6"), "kahan-li-6", "of order 6"),
        (method("avf"), "kahan-li-6", "family"),
        (method("stormer-verlet"), "kahan-li-7", "did you mean"),
        (method("stormer-verlet"), "blanes-moan-s6", "is a splitting"),
        (method("stormer-verlet"), ["0.5", "0.500000000005"], "not to 1"),
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


# -- order conditions --------------------------------------------------------------------------------------------------


def test_orders_for_general_systems():
    """A quadratic kinetic energy gives a relation between commutators of degree 4, on which some orders rest."""
    for table in TABLES:
        order = classical_order("splitting", coefficients.steps(table.name)) if table.kind != "composition" else 0
        if table.kind == "nystrom":
            assert (order < table.classical_order) == (table.classical_order > 4 or not table.symmetric), table.name
        elif table.kind == "near-integrable":
            assert order == table.classical_order, table.name


def test_fractal_compositions_have_their_order():
    for fractal, order in ((triple_jump, 2), (triple_jump, 4), (triple_jump, 6), (suzuki, 4)):
        assert classical_order("composition", fractal(order)) == order
    for order in (0, 3):
        with pytest.raises(ValueError, match="even order"):
            suzuki(order)
