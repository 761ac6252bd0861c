"""Checks that the measurements of the methods' options are sound; the report pages judge whether an option pays.

Options are the parameter lambda of a scheme, the order, the nodes of a quadrature, the arithmetic, the stage solver.
"""

from __future__ import annotations

from collections.abc import Callable

from phasebench.benchmarks.experiments.options import arithmetic, ladders, lambdas, nodes, solvers
from phasebench.benchmarks.experiments.options.cells import cells  # noqa: F401

#: The lambda at which Scheme I is the implicit midpoint rule.
HALF = 0.5
#: Largest relative difference between the errors of two solvers of the same equations.
ALIKE = 1e-2
#: Bound for the smallest error of every setting: its ladder of steps is fine enough.
REACHED = 1e-2


def short(rows: list[dict]) -> list[str]:
    """Return messages about the settings of an option whose smallest error is above `REACHED`.

    The steps tried with such a setting are too long.  ``rows`` are those of `ladders`, a row for each setting and step.
    """
    least: dict = {}
    for r in rows:
        key = (r["knob"], r["scene"], r["setting"])
        least[key] = min(least.get(key, float("inf")), float("inf") if r["error"] is None else r["error"])
    return [f"{', '.join(key)}: {error:.1e}" for key, error in least.items() if not error <= REACHED]


def bench_lambda(measured_rows: Callable[[str], list[dict]]) -> None:
    """Test that every run of Schemes I and III with the parameter lambda = 1/2 reaches its end time.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    rows = [r for r in measured_rows(lambdas.ERRORS) if r["lam"] == HALF]
    off = [f"{r['method']} on {r['scene']}" for r in rows if not r["trajectory"] < float("inf")]
    assert not off, "\n".join(off)


def bench_largest_steps(measured_rows: Callable[[str], list[dict]]) -> None:
    """Test that schemes with the parameter lambda = 1/2 are stable up to the step h at which all lambda are compared.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    rows = [r for r in measured_rows(lambdas.COSTS) if r["lam"] == HALF]
    off = [f"{r['method']} on {r['scene']}" for r in rows if not r["largest h"] >= r["h"]]
    assert not off, "\n".join(off)


def bench_ladders(measured_rows: Callable[[str], list[dict]]) -> None:
    """Test that every setting of every option reaches an error of at most `REACHED`.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    wrong = short(measured_rows(ladders.TABLE))
    assert not wrong, "\n".join(wrong)


def bench_nodes(measured_rows: Callable[[str], list[dict]]) -> None:
    """Test that the stage equations of every step are solved, with every quadrature rule.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    wrong = [f"{r['scene']}, {r['nodes']} nodes" for r in measured_rows(nodes.TABLE) if r["status"] != "ok"]
    assert not wrong, "\n".join(wrong)


def bench_arithmetic(measured_rows: Callable[[str], list[dict]]) -> None:
    """Test that single precision has more round-off than double, on every orbit and for every number of steps.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    rows = measured_rows(arithmetic.ERRORS)
    off = {(r["scene"], r["steps"], r["arithmetic"]): r["round-off rms"] for r in rows}
    wrong = [k for k, x in off.items() if k[2] == arithmetic.PLAIN and not x < off[(*k[:2], arithmetic.SINGLE)]]
    assert not wrong, wrong


def bench_costs_of_sums(measured_rows: Callable[[str], list[dict]]) -> None:
    """Test that the ratio of the times of compensated and of plain sums is positive.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    assert all(r["ratio"] > 0 for r in measured_rows(arithmetic.COSTS))


def bench_solvers(measured_rows: Callable[[str], list[dict]]) -> None:
    """Test that Newton's method solves the stage equations to round-off, on every orbit and with every step size.

    The error of the end state must be the same as with the solver inside the integrators.  ``measured_rows`` is a
    fixture: table name -> rows.
    """
    rows = measured_rows(solvers.TABLE)
    own = {(r["scene"], r["h"]): r["error"] for r in rows if r["solver"] == solvers.ENGINE}
    newton = [r for r in rows if r["solver"] == solvers.NEWTON]
    wrong = [r for r in newton if r["status"] != "ok" or not abs(r["error"] / own[r["scene"], r["h"]] - 1) < ALIKE]
    assert not wrong, wrong
