"""Tables of coefficients transcribed from packages: what is found of them."""

from __future__ import annotations

import json
from dataclasses import replace

import mpmath
import pytest

from phasebench.benchmarks.studies.catalogue import tables as transcribed
from support.commands import call

TABLES = transcribed.read()


@pytest.mark.parametrize("table", TABLES.values(), ids=map(" ".join, TABLES))
def test_table_says_where_it_stands_and_is_consistent(table):
    assert table.line > 0
    assert table.commit
    assert table.date[:2] == "20"
    assert table.expected
    with mpmath.workdps(60):
        if table.kind == transcribed.RUNGE_KUTTA:
            _, b = transcribed.tableau(table)
            sums = [sum(b)]
        elif table.kind == transcribed.COMPOSITION:
            sums = [sum(table.steps())]
        else:
            sums = [sum(w for s, w in table.steps() if s == letter) for letter in "AB"]
        assert all(abs(x - 1) < 1e-9 for x in sums)


@pytest.mark.parametrize(
    ("package", "name", "order", "digits"),
    [
        ("SUNDIALS", "ARKODE_SPRK_RUTH_3_3", "3", None),
        ("SUNDIALS", "ARKODE_SPRK_YOSHIDA_6_8", "6", 0),
        ("REBOUND", "SABA, ABA(8,6,4)", "8,6,4", 10),
        ("GeometricIntegrators.jl", "Yoshida8", "8", 3),
        ("OpenMM", "Suzuki-Yoshida weights, 3", "2", 14),
        ("OrdinaryDiffEq.jl", "McAte42", "1", 0),
        ("Accelerator Toolbox (GPU)", "type 2", "1", None),
        ("diffrax", "Dopri8", "8", None),
    ],
)
def test_orders_and_lost_digits(package, name, order, digits):
    """Exact numbers, printed ones, rational approximations; tables with a wrong sequence or a wrong exponent."""
    found = transcribed.check(TABLES[package, name])
    assert found["order"] == order
    assert (None if digits is None else found["digits printed"] - found["digits that hold"]) == digits


def test_changed_digit_loses_the_order():
    table = TABLES["SUNDIALS", "ARKODE_SPRK_YOSHIDA_6_8"]
    gamma = list(table.gamma)
    gamma[1] = gamma[1][:10] + ("1" if gamma[1][10] != "1" else "2") + gamma[1][11:]
    found = transcribed.check(replace(table, gamma=tuple(gamma)))
    assert found["order"] == "0"
    assert found["digits that hold"] < 12


def test_decimals_are_exact():
    with mpmath.workdps(60):
        assert transcribed.evaluate("0.1") == mpmath.mpf(1) / 10
        assert abs(transcribed.evaluate("1/(2 - 2**(1/3))") - 1 / (2 - mpmath.cbrt(2))) < 1e-58


def test_command_checks_the_tables_of_a_package():
    done = call("audit", "--tables", "--package", "blackjax", "--json")
    assert done.exit_code == 0
    assert {r["order"] for r in json.loads(done.stdout)} == {"2", "4"}
    assert call("audit", "--tables", "--package", "nothing").exit_code == 2
