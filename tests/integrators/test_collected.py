"""Tables collected in the Acta's survey: orders from the coefficients, digits, records made from them, their file."""

from __future__ import annotations

import json

import mpmath
import pytest

from phasebench.integrators.coefficients import BY_NAME, collected, polished_file
from phasebench.integrators.coefficients.collected import FILE, TABLES
from phasebench.integrators.coefficients.order_conditions import (
    TOLERANCE,
    VISIBLE,
    excess,
    leading_norms,
    next_degrees,
    residuals,
)
from phasebench.integrators.coefficients.polish import starting_values
from phasebench.integrators.coefficients.table import is_exact, unit, value
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.registry import method
from support.coefficient_tables import MADE_UP
from support.coefficient_tables import full_precision as full_precision
from support.solutions import apart

each = pytest.mark.parametrize("table", TABLES, ids=lambda t: t.name)
ERROR = mpmath.mpf("1e-12")


@each
def test_the_order_is_the_declared_one(table):
    """All residuals up to the order vanish; for each power of epsilon one of the next degree does not."""
    found = residuals(table.kind, FILE.steps(table.name), next_degrees(table.order))
    assert excess(found, table.order) < TOLERANCE
    high = max(table.order)  # coefficients of the exact flow are 1 / n!, and errors of long quadrature rules far less
    assert min(leading_norms(found, table.order)) > (VISIBLE if high <= 10 else VISIBLE / mpmath.factorial(high + 1))


@each
def test_control_a_number_off_by_1e_12_is_seen(table):
    for k in range(len(table.published)):
        moved = list(FILE.numbers(table.name))
        moved[k] += ERROR
        assert excess(residuals(table.kind, table.steps(moved), 3), (min(3, *table.order),)) > TOLERANCE


@each
def test_polished_numbers_agree_with_the_published_digits(table):
    stored = FILE.stored[table.name]
    assert stored["published"] == table.digest, FILE.command
    numbers = list(map(value, stored["numbers"]))
    moved = apart(starting_values(table), numbers)
    assert moved <= table.accuracy
    assert all(not is_exact(text) or x == value(text) for text, x in zip(table.published, numbers, strict=True))
    if table.good is not None:
        assert moved > 10 * max(unit(x) for x in table.published if not is_exact(x)), "all its digits hold"
        assert moved > table.accuracy / 10, "more of its decimals hold than it says"


def test_names_are_new():
    assert not set(FILE.tables) & set(BY_NAME)


@pytest.mark.parametrize("n", [1, 2, 3, 5])
def test_lobatto_rules_are_exact_up_to_degree_2n_1(n):
    nodes, weights = collected.lobatto(n)
    for degree in range(2 * n):
        assert abs(mpmath.fdot(weights, [x**degree for x in nodes]) - mpmath.mpf(1) / (degree + 1)) < 1e-55
    assert abs(mpmath.fdot(weights, [x ** (2 * n) for x in nodes]) - mpmath.mpf(1) / (2 * n + 1)) > 1e-9


def test_the_8_4_splittings_are_those_of_mclachlan():
    """McLachlan 1995, BIT, the digits of the first number."""
    assert mpmath.nstr(FILE.numbers("mclachlan-aba-84")[0], 15) == "0.0753469602698929"
    assert method("mclachlan-aba-84").order == 4


def test_the_file_polishes_what_is_new_and_keeps_the_rest(tmp_path, monkeypatch, capsys):
    file = polished_file.PolishedFile("phasebench.integrators.coefficients.collected", [MADE_UP, TABLES[0]])
    monkeypatch.setattr(file, "path", tmp_path / "numbers.json")
    monkeypatch.setattr(file, "stored", {TABLES[0].name: FILE.stored[TABLES[0].name], "gone": {}})
    file.write()
    written = json.loads(file.path.read_text())
    assert list(written) == ["made-up", TABLES[0].name]
    assert value(written["made-up"]["numbers"][1]) == mpmath.mpf("0.5")
    assert written[TABLES[0].name] == FILE.stored[TABLES[0].name]
    assert capsys.readouterr().out.startswith("made-up: 2.0e-8 -> ")
    with pytest.warns(UserWarning, match=r"made-up is new.*python -m phasebench\.integrators\.coefficients\.collected"):
        assert file.steps("made-up")[0] == ("B", mpmath.mpf("0.5"))
    with pytest.raises(InvalidInput, match="did you mean made-up"):
        file.numbers("made-op")
