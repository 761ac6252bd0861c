"""The page on advice: its verdicts follow from the rows, and its random questions are reproducible and valid."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from markdown_it import MarkdownIt

from phasebench.benchmarks.advice import prior
from phasebench.benchmarks.advice.bench_stored import competition
from phasebench.benchmarks.experiments.advice import asks, brute, page, rerun
from phasebench.benchmarks.experiments.advice.bench_advice import unmet
from phasebench.benchmarks.experiments.advice.cells import asked_of, cells
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.measure.quantities import Truth
from phasebench.benchmarks.page.markdown import verdicts_table
from phasebench.benchmarks.page.verdict import FAIL, FINDING, PASS, Count


def rows(**changes) -> pd.DataFrame:
    """A fabricated table of twenty questions to `advise`, all answered within the accuracy.

    Every second answer was compared with brute force (running all methods). ``changes``: {column: {row: value}}.
    """
    table = pd.DataFrame(
        {
            "ask": [f"{n:02d}" for n in range(20)],
            "problem": "pendulum",
            "outside": [n >= 15 for n in range(20)],
            "choice": "heyoka",
            "command": "phasebench integrate pendulum heyoka --tol 1e-9 --t-end 1 --error",
            "accuracy": 1e-6,
            "met": True,
            "rerun error": 1e-7,
            "best": [("heyoka" if n % 2 == 0 else None) for n in range(20)],
            "ratio": [(1.0 if n % 2 == 0 else None) for n in range(20)],
            "ratio high": [(1.1 if n % 2 == 0 else None) for n in range(20)],
        }
    )
    for column, values in changes.items():
        for n, value in values.items():
            table.loc[n, column] = value
    return table


def data(table):
    return lambda name: table


def test_verdict_on_accuracy_met():
    good = page.met(data(rows()))
    assert (good.outcome, good.measured, good.where) == (PASS, Count(20, 20), "")
    bad = page.met(data(rows(met={3: False})))
    assert (bad.outcome, bad.measured, bad.where) == (FAIL, Count(19, 20), "03 (pendulum)")
    assert page.met(data(rows().iloc[:0])) is None


def test_verdict_on_nearness_to_brute_force():
    assert page.near(data(rows())).outcome == PASS
    edge = page.near(data(rows(ratio={0: 1.5, 2: page.NEAR})))
    assert (edge.outcome, edge.measured) == (PASS, Count(9, 10))
    far = page.near(data(rows(ratio={0: 1.5, 2: 3.0})))
    assert (far.outcome, far.measured, far.where) == (FINDING, Count(8, 10), "heyoka on pendulum: 3 times heyoka")
    assert page.near(data(rows().drop(columns="ratio"))) is None
    assert page.near(data(rows(ratio=dict.fromkeys(range(0, 20, 2))))) is None


def test_beaten_brute_force_is_counted(tmp_path):
    """Advice beats an exhaustive search where the whole interval of advised time over searched time is below 1."""
    table = rows(ratio={0: 0.41, 2: 0.9, 4: 0.97, 6: 0.7})
    for n, high in ((0, 0.45), (2, 0.99), (4, 1.01), (6, 0.8)):
        table.loc[n, "ratio high"] = high
    (picture,) = page.draw(data(table), tmp_path)
    assert " in 3 of 10" in picture.caption


def test_energy_preserving_choices_are_counted():
    table = rows(choice={0: "dop853-relaxation", 1: "rk4", 2: "avf"}).assign(quantity="end-state")
    without = page.table(data(table)).caption
    table.loc[[0, 1, 3], "quantity"] = "energy"
    assert page.table(data(table)).caption.removeprefix(without).startswith(" 1 of the 3 ")


FORMULA = "p1**2 + p2**2/2 + q1*q2**2/3"


def test_formula_is_shown_as_code():
    """Two asterisks would be bold; a formula in the table is code, a name is not."""
    table = rows(problem={18: FORMULA, 16: FORMULA}, met={16: False}, ratio={18: 3.0, 0: 1.5})
    render = MarkdownIt("commonmark").enable("table").render
    shown = page.table(data(table)).frame.set_index("ask")["problem"]
    for number in ("16", "18"):
        assert f"<code>{FORMULA}</code>" in render(shown[number])
    assert shown["00"] == "pendulum"
    verdicts = render(verdicts_table([page.near(data(table)), page.met(data(table))]))
    assert verdicts.count(FORMULA) == 2


def test_refusals_need_brute_force_to_be_wrong():
    assert page.refusals(data(rows(choice={1: None}).drop(columns="best"))) is None


def test_verdict_on_refusals():
    assert page.refusals(data(rows())).outcome == PASS
    assert page.refusals(data(rows(choice={1: None}))).outcome == PASS
    found = page.refusals(data(rows(choice={0: None})))
    assert (found.outcome, found.measured, found.where) == (FINDING, Count(1, 10), "00")


def test_bench_fails_for_unmet_accuracy():
    assert unmet(rows().to_dict("records")) == []
    assert len(unmet(rows(met={3: False}).to_dict("records"))) == 1


def test_table_shows_the_unmet_first():
    shown = page.table(data(rows(met={7: False}, ratio={4: 2.0}))).frame
    assert list(shown["ask"][:2]) == ["07", "04"]
    quick = page.table(data(rows(ratio={4: 0.5}))).frame
    assert list(quick["ask"][8:11]) == ["18", "04", "01"]
    assert len(page.PAGE.whole(data(rows()))) == 20
    many = pd.concat([rows(), rows()])
    assert list(page.table(data(many)).frame["ask"][:3]) == ["00", "02", "04"]
    assert len(page.table(data(many)).frame) == 25
    assert list(page.table(data(rows().drop(columns=["met", "ratio"]))).frame["ask"][:2]) == ["00", "01"]


def test_drawn_questions_are_reproducible():
    assert len(asks.ASKS) == 60
    assert sum(a.outside for a in asks.ASKS) == 15
    assert asks.draw() == asks.ASKS
    assert asks.draw(seed=asks.SEED + 1) != asks.ASKS
    assert any(a.conserve for a in asks.ASKS)
    assert {"end-state", "trajectory", "energy"} < {a.quantity for a in asks.ASKS}
    covered = [name for c in cells() for name in c.arguments[1]]
    assert covered == [a.name for a in asks.ASKS]
    assert len(cells(quick=True)[0].arguments[1]) == 2


@pytest.mark.parametrize("ask", [a for a in asks.ASKS if a.outside][::5], ids=lambda a: a.name)
def test_questions_with_formulas_are_valid(ask):
    question = asked_of(ask)
    assert question.problem.system.canonical
    assert question.quantity.name == ask.quantity


@pytest.mark.parametrize(("id", "sizes"), [("rk4", "steps"), ("heyoka", "tol")])
def test_brute_force_finds_the_cheapest_run(id, sizes):
    question = asked_of(next(a for a in asks.ASKS if a.words == ("pendulum:swinging",) and a.quantity == "end-state"))
    runs = brute.Runs(integrator(id), question, Truth(np.ones(1), 0.0, "a law"))

    def run(x):
        error, seconds = ((20 / x) ** 4, 1e-8 * x) if sizes == "steps" else (x, 1e-5 * x**-0.1)
        return brute.Run(x, True, error, seconds) if error < 1e3 else brute.Run(x, False, np.inf, 0.0)

    runs._run = run
    found = brute.cheapest_of(runs, 1.0)
    least = 20 * question.accuracy**-0.25
    if sizes == "steps":
        assert least <= found.size <= 1.12 * least
    else:
        assert question.accuracy / 3.2 <= found.size <= question.accuracy


def test_command_is_rerun_in_another_process():
    line = "phasebench integrate pendulum rk4 --steps 10 --t-end 1.0 --error"
    (printed,) = rerun.rerun([line])
    assert 0 < rerun.error_of(printed) < 1e-4
    assert rerun.error_of({"quantity_error": {"error": 2.0}, "global_error": 1.0}) == 2.0
    with pytest.raises(RuntimeError, match="rerun failed"):
        rerun.rerun(["another command"])


def test_prior_is_built_from_trade_off_rows():
    row = {"scene": "pendulum-long", "status": "ok", "error": 1e-7}
    found = [row | {"id": "gauss-4", "seconds": 1.0}, row | {"id": "heyoka", "seconds": 3.0}]
    found += [row | {"id": id, "seconds": 0.1} for id in ("heyoka-batch", "no-name-of-the-registry")]
    found += [row | {"id": "pefrl", "seconds": 0.1, "status": "diverged"}]
    lines = {(x["problem"], x["decade"], x["integrator"]): x["factor"] for x in prior.build(*competition(found))}
    assert lines["pendulum", -7, "heyoka"] == 3.0
    assert {id for problem, _, id in lines if problem != prior.ANY} == {"gauss-4", "heyoka"}
    assert {"pefrl", "gauss-4"} <= {id for problem, _, id in lines if problem == prior.ANY}
