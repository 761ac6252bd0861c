"""What a certificate prints of cost: ratios of evaluations and time, what is left out, and the width of lines."""

from __future__ import annotations

import pytest

from phasebench.benchmarks.certificate import behaviour, costs
from phasebench.benchmarks.certificate.battery import entries
from phasebench.benchmarks.certificate.subject import subject
from phasebench.benchmarks.cli.validate import WIDEST, folded
from phasebench.benchmarks.judge.evidence import Tables

SCENE = "double-pendulum-chaotic"
PRICE = {"low": 900.0, "value": 1234.0, "high": 1500.0}


def found(evaluations=(23.0, 31.4), high=110.0, python=PRICE):
    """(tables, times) of a fabricated certificate: costs of a step over the cheapest method's at errors 1e-2 and 1e-4.

    It takes ``evaluations`` times as many gradient evaluations, and 100 and 2.34 times the time.
    """
    errors = [{"error": 10.0 ** (-2 * k), "factor": f} for k, f in enumerate(evaluations, 1)]
    timed = [{"error": 1e-2, "low": 90.0, "factor": 100.0, "high": high}]
    timed.append({"error": 1e-4, "low": 1.0, "factor": 2.34, "high": 1e9})
    times = [{"on": SCENE, "errors": timed, "python": python}]
    return Tables({"place": [{"on": SCENE, "errors": errors}]}), times


def test_rows_have_both_ratios_of_a_scene():
    first, second = costs.cost_rows(*found())
    assert (first["error"], first["evaluations"], first["time"]) == (1e-2, 23.0, 100.0)
    assert (second["error"], second["evaluations"], second["time"]) == (1e-4, 31.4, 2.34)
    assert costs.cost_rows(Tables({}), []) == costs.format_costs(Tables({}), []) == []


@pytest.mark.parametrize(("high", "varies"), [(180.0, False), (180.1, True)])
def test_time_that_varies_between_runs_is_not_given(high, varies):
    row = costs.cost_rows(*found(high=high))[0]
    assert (row["time"] is None) is row["varies"] is varies
    assert any(costs.VARIES in line for line in costs.format_costs(*found(high=high))) is varies


def test_lines_are_short_and_end_with_the_first_error_that_is_not_met():
    lines = costs.format_costs(*found())
    assert max(map(len, lines)) <= WIDEST
    assert sum(SCENE in line and "times" in line for line in lines[:4]) == 2
    assert "1200 times" in lines[-1]
    assert "1200 times" not in costs.format_costs(*found(python=PRICE | {"high": 2000.0}))[-1]
    lines = costs.format_costs(*found((None, None)))
    assert sum(costs.NOT_MET in line for line in lines) == 1


def test_long_reasons_are_folded_and_options_stay_whole():
    text = folded("  order 2: " + "it is another on this system; " * 20)
    assert max(map(len, text.splitlines())) <= WIDEST
    assert text.count("another") == 20
    offer = "measured and not claimed: " + "--claim energy=bounded " * 9
    assert folded(offer) == offer


def test_reason_for_doubles_names_the_line_and_not_the_package_of_many_digits(tmp_path):
    path = tmp_path / "step.py"
    path.write_text(
        "import numpy as np\n"
        "def step(system, q, p, h):\n"
        "    np.isnan(q).any()\n"
        "    return q + h * system.dH_dp(q, p), p\n"
    )
    reason = behaviour.arithmetic(subject(str(path)), entries()[:1], 0)
    assert "line 3" in reason
    assert "TypeError" not in reason
    assert "mpfr" not in reason
