"""The page of the advice: its sentences follow their rows; its asks are drawn once and can be asked."""

from __future__ import annotations

import pandas as pd
import pytest
from markdown_it import MarkdownIt

from phasebench.benchmarks.advice.trial import Point, Trial
from phasebench.benchmarks.experiments.advice import asks, brute, page, rerun
from phasebench.benchmarks.experiments.advice.bench_advice import prior_of, unmet
from phasebench.benchmarks.experiments.advice.cells import asked_of, cells
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.integrators.driver import DIVERGED


def rows(**changes) -> pd.DataFrame:
    """A table of twenty asks, all met, each third held against everything."""
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
            table.loc[n, column.replace("_", " ") if column == "rerun_error" else column] = value
    return table


def data(table):
    return lambda name: table


def test_met_or_not():
    verdict = page.met(data(rows()))
    assert verdict.holds
    assert "20 of these met" in verdict.text
    assert "(5 on problems that are in no registry)" in verdict.text
    verdict = page.met(data(rows(met={3: False})))
    assert not verdict.holds
    assert "not met: 03 (pendulum)" in verdict.text
    assert page.met(data(rows().iloc[:0])) is None


def test_near_or_far():
    assert page.near(data(rows())).holds
    assert page.near(data(rows(ratio={0: 1.5}))).holds
    verdict = page.near(data(rows(ratio={0: 1.5, 2: 3.0})))
    assert not verdict.holds
    assert "in 8 of 10" in verdict.text
    assert "3 times heyoka" in verdict.text
    assert page.near(data(rows().drop(columns="ratio"))) is None


def test_brute_force_that_is_beaten_is_told():
    """Beaten is who takes longer for certain: the ratio's whole interval is below 1."""
    table = rows(ratio={0: 0.41, 2: 0.9, 4: 0.97, 6: 0.7})
    for n, high in ((0, 0.45), (2, 0.99), (4, 1.01), (6, 0.8)):
        table.loc[n, "ratio high"] = high
    said = page.near(data(table))
    assert said.holds
    assert "Brute force is itself beaten in 3 of 10" in said.text
    order = [said.text.index(f"takes {x} of heyoka's time") for x in ("0.41", "0.7", "0.9")]
    assert order == sorted(order), "the most beaten first"
    assert "0.97" not in said.text
    assert said.short == f"At most {page.NEAR} times the best in 10 of 10; brute force is beaten in 3."
    none = page.near(data(rows()))
    assert "beaten" not in none.text
    assert none.short.endswith("beaten in 0.")


def test_an_energy_that_is_kept_by_construction_says_nothing_of_the_orbit():
    table = rows(choice={0: "dop853-relaxation", 1: "rk4", 2: "avf"}).assign(quantity="end-state")
    assert "construction" not in page.met(data(table)).text
    table.loc[[0, 1, 3], "quantity"] = "energy"
    text = page.met(data(table)).text
    assert text.endswith(
        " Of the 3 asks of the energy 1 are met by a method that keeps it by construction, whatever the orbit: "
        "dop853-relaxation."
    )


FORMULA = "p1**2 + p2**2/2 + q1*q2**2/3"


def test_a_formula_stands_as_it_was_asked():
    """In the sentences and in the table, where two asterisks would be bold; a name is no code."""
    table = rows(problem={18: FORMULA, 16: FORMULA}, met={16: False}, ratio={18: 3.0, 0: 1.5})
    near, met = page.near(data(table)).text, page.met(data(table)).text
    shown = page.table(data(table)).frame.set_index("ask")["problem"]
    for text in (near, met, shown["16"], shown["18"]):
        html = MarkdownIt("commonmark").render(text)
        assert f"<code>{FORMULA}</code>" in html
        assert "<strong>" not in html
    assert shown["00"] == "pendulum"


def test_the_median_and_the_farthest_are_told_apart():
    said = page.near(data(rows(ratio={0: 1.5, 2: page.NEAR})))
    assert "in 9 of 10, in the median 1 times; the farthest is heyoka on pendulum at 1.5 times heyoka." in said.text
    assert said.holds
    assert page.near(data(rows(ratio=dict.fromkeys(range(0, 20, 2))))) is None


def test_without_brute_force_no_refusal_is_wrong():
    said = page.refused(data(rows(choice={1: None}).drop(columns="best")))
    assert said.holds
    assert said.text == "1 were refused."


def test_refused_rightly_or_wrongly():
    assert page.refused(data(rows())).text == "No ask was refused."
    assert page.refused(data(rows())).holds
    assert page.refused(data(rows(choice={1: None}))).holds
    verdict = page.refused(data(rows(choice={0: None})))
    assert not verdict.holds
    assert "brute force meets 00" in verdict.text


def test_the_bench_fails_for_what_is_not_met():
    assert unmet(rows().to_dict("records")) == []
    assert len(unmet(rows(met={3: False}).to_dict("records"))) == 1


def test_the_table_shows_the_unmet_first():
    shown = page.table(data(rows(met={7: False}, ratio={4: 2.0}))).frame
    assert list(shown["ask"][:2]) == ["07", "04"]
    quick = page.table(data(rows(ratio={4: 0.5}))).frame
    assert list(quick["ask"][8:11]) == ["18", "04", "01"]
    assert len(page.PAGE.whole(data(rows()))) == 20
    many = pd.concat([rows(), rows()])
    assert list(page.table(data(many)).frame["ask"][:3]) == ["00", "02", "04"]
    assert len(page.table(data(many)).frame) == 25
    assert list(page.table(data(rows().drop(columns=["met", "ratio"]))).frame["ask"][:2]) == ["00", "01"]


def test_the_asks():
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
def test_formulas_can_be_asked(ask):
    question = asked_of(ask)
    assert question.problem.system.canonical
    assert question.quantity.name == ask.quantity


@pytest.mark.parametrize(("id", "sizes"), [("rk4", "steps"), ("heyoka", "tol")])
def test_brute_force_finds_the_cheapest(id, sizes):
    question = asked_of(next(a for a in asks.ASKS if a.words == ("pendulum:swinging",) and a.quantity == "end-state"))
    from phasebench.benchmarks.measure.quantities import Truth

    trial = Trial(integrator(id), question, Truth(pd.Series([1.0]).to_numpy(), 0.0, "a law"), 1.0)

    def run(size):
        x = size[sizes]
        error, seconds = ((20 / x) ** 4, 1e-8 * x) if sizes == "steps" else (x, 1e-5 * x**-0.1)
        return Point(size, error, seconds, 10) if error < 1e3 else Point(size, 1e9, 0.0, 0, DIVERGED)

    trial._run = run
    found = brute.cheapest_of(trial, 1.0)
    least = 20 * question.accuracy**-0.25
    if sizes == "steps":
        assert least <= found.size["steps"] <= 1.12 * least
    else:
        assert question.accuracy / 3.2 <= found.size["tol"] <= question.accuracy


def test_a_command_is_run_by_another_process():
    line = "phasebench integrate pendulum rk4 --steps 10 --t-end 1.0 --error"
    (printed,) = rerun.rerun([line])
    assert 0 < rerun.error_of(printed) < 1e-4
    assert rerun.error_of({"quantity_error": {"error": 2.0}, "global_error": 1.0}) == 2.0
    with pytest.raises(RuntimeError, match="rerun failed"):
        rerun.rerun(["another command"])


def test_the_prior_is_made_of_the_trades_rows():
    row = {"scene": "pendulum-long", "status": "ok", "error": 1e-7}
    found = [row | {"id": "gauss-4", "seconds": 1.0}, row | {"id": "heyoka", "seconds": 3.0}]
    found += [row | {"id": id, "seconds": 0.1} for id in ("heyoka-batch", "no-name-of-the-registry")]
    found += [row | {"id": "pefrl", "seconds": 0.1, "status": "diverged"}]
    lines = {(x["problem"], x["decade"], x["integrator"]): x["factor"] for x in prior_of(found)}
    assert lines["pendulum", -7, "heyoka"] == 3.0
    assert {id for _, _, id in lines} == {"gauss-4", "heyoka"}
