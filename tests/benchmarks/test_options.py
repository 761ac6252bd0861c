"""The pages on options: each verdict on tables for which it must change, each measurement where the answer is known."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.experiments.options import (
    arithmetic,
    bench_options,
    figures,
    findings,
    ladders,
    lambdas,
    nodes,
    numerics_page,
    page,
    solvers,
    verdicts,
)
from phasebench.benchmarks.experiments.options.cells import PARTS, cells
from phasebench.benchmarks.page.page import ROWS
from phasebench.benchmarks.page.verdict import FAIL, FINDING, PASS, Count, Range
from phasebench.benchmarks.problems import problem
from phasebench.integrators.driver import integrate
from phasebench.integrators.registry import method
from phasebench.integrators.stepping.kernel import prepare

# -- lambda ------------------------------------------------------------------------------------------------------------


def errors(best: float = 0.5, constant: float = 1e-3, uncertainty: float = 1e-12, id: str = "scheme-iii"):
    """Fabricated errors against lambda at two step sizes, smallest at lambda = ``best``."""
    lams = np.arange(-48, 73) / 24
    return pd.DataFrame(
        [
            {"scene": "a", "method": id, "lam": x, "h": 0.1 / k, "finer": k, "uncertainty": uncertainty}
            | {"trajectory": (constant + 1e-2 * (x - best) ** 2) / k**2, "end": 1e-4 + abs(x - 1)}
            for k in (1, 4)
            for x in lams
        ]
    )


def half_is_best(*tables: pd.DataFrame):
    return verdicts.half_is_best({lambdas.ERRORS: pd.concat(tables)}.get)


def test_half_is_best_only_where_its_error_is_smallest():
    good, bad = half_is_best(errors()), half_is_best(errors(0.25))
    assert (good.outcome, good.measured, good.where) == (PASS, Count(1, 1), "")
    assert (bad.outcome, bad.measured) == (FINDING, Count(0, 1))
    assert bad.where.startswith("scheme-iii on a: 1.6 times")
    assert bad.where.endswith("0.25")


def test_error_within_ten_percent_counts_as_best():
    """The error at 1/2 is 1 + 10 (1/12)^2 = 1.07 or 1 + 10 (1/8)^2 = 1.16 times the smallest."""
    assert half_is_best(errors(0.5 - 1 / 12)).outcome == PASS
    assert half_is_best(errors(0.5 - 1 / 8)).outcome == FINDING


def test_error_below_the_uncertainty_is_not_the_best():
    table = errors(0.25, uncertainty=1.2e-3)
    best = findings.best_lambdas(table[table["finer"] == 1]).iloc[0]
    assert best["least"] > 1.2e-3
    assert best["best"] != 0.25
    assert half_is_best(errors(uncertainty=1.0)) is None


def test_scene_of_the_largest_gain_is_named():
    two = half_is_best(errors(0.5), errors(0.25).assign(scene="b"), errors(0.0).assign(scene="c"))
    assert (two.outcome, two.measured) == (FINDING, Count(1, 3))
    assert two.where.startswith("scheme-iii on c: 3.5 times")


def test_scene_without_one_half_is_left_out():
    others = errors().query("lam != 0.5").assign(scene="z")
    assert findings.best_lambdas(pd.concat([others, errors()]))["scene"].tolist() == ["a", "a"]
    without = costs().query("lam != 0.5").assign(scene="z")
    assert findings.longest(pd.concat([without, costs()]))["scene"].tolist() == ["a"]


def costs(low: float = 1.0, half: float = 2.0):
    """Fabricated costs at lambda = 0, 1/2, 1: gradients per step, largest stable h (``half`` at 1/2, else ``low``)."""
    rows = [
        {"lam": x, "largest h": low if x != 0.5 else half, "gradients per step": 5 + x + (x > 0)}
        for x in (0.0, 0.5, 1.0)
    ]
    return pd.DataFrame(rows).assign(scene="a", method="scheme-iii", h=0.1)


def half_is_longest(*tables: pd.DataFrame):
    return verdicts.half_is_longest({lambdas.COSTS: pd.concat(tables)}.get)


def test_lambda_of_the_longest_stable_step():
    assert half_is_longest(costs()).outcome == PASS
    assert half_is_longest(costs(2.0, 2.0)).outcome == PASS
    three = half_is_longest(*(costs().assign(scene=s) for s in "ab"), costs(2.0, 1.0).assign(scene="c"))
    assert (three.outcome, three.measured, three.where) == (FINDING, Count(2, 3), "scheme-iii on c")


# -- ladders -----------------------------------------------------------------------------------------------------------


def rungs(knob: str, scene: str = "a", spread: float = 0.01, **power):
    """Fabricated runs at 24 step sizes for each setting of an option, given as setting=(order, us per step)."""
    out = []
    for setting, (order, cost) in power.items():
        for k in range(24):
            steps = 4 * 2 ** (k / 2)
            us = cost * steps
            out.append({"setting": setting, "error": steps**-order, "us": us, "us, low": us * (1 - spread)})
            out[-1] |= {"us, high": us * (1 + spread), "steps": steps}
    same = {"knob": knob, "scene": scene, "status": "ok", "energy error": 1e-15, "fallbacks": 0}
    return pd.DataFrame(out).assign(**same)


RISING = {"2": (2, 1.0), "4": (4, 5.0), "8": (8, 20.0)}


def on_rungs(verdict, *tables: pd.DataFrame):
    """A page's verdict on fabricated runs at several settings of an option."""
    return verdict({ladders.TABLE: pd.concat(tables)}.get)


def settings(option: str, **power) -> list[str]:
    """The cheapest settings of an option, from large to small errors; ``power``: setting=(order, cost of a step)."""
    return findings.cheapest(rungs(option, **power), option)["setting"].tolist()


def test_cheapest_order_rises_as_the_error_falls():
    assert settings(ladders.COMPOSITION, **RISING) == ["2", "2", "4", "8", "8", "8"]
    good = on_rungs(verdicts.order_rises, rungs(ladders.COMPOSITION, **RISING))
    assert (good.outcome, good.measured) == (PASS, Count(1, 1))
    falling = {"4": (2, 1.0), "2": (4, 5.0)}
    bad = on_rungs(verdicts.order_rises, rungs(ladders.COMPOSITION, **falling))
    assert (bad.outcome, bad.measured, bad.where) == (FINDING, Count(0, 1), "a")


def test_cheapest_setting_follows_the_power_laws():
    """A step of cost c and order p costs c E^(-1/p) at the error E."""
    found = findings.cheapest(rungs(ladders.COMPOSITION, **RISING), ladders.COMPOSITION).set_index("error")
    for error, row in found[found.index < 1e-1].iterrows():
        wanted = {k: c * error ** (-1 / p) for k, (p, c) in RISING.items()}
        assert row["setting"] == min(wanted, key=wanted.get)
        for name, us in row["costs"].items():
            if us > RISING[name][1] * 4 * 1.01:  # else the coarsest rung is more accurate than requested
                assert us == pytest.approx(wanted[name], rel=0.02)
    assert all(ties == [] for ties in found["ties"])
    wide = findings.cheapest(rungs(ladders.COMPOSITION, spread=0.9, **RISING), ladders.COMPOSITION)
    assert ["4", "8"] in wide["ties"].tolist()


def test_failed_runs_have_no_cost():
    table = rungs(ladders.COMPOSITION, **RISING)
    assert findings.cheapest(table.assign(status="diverged"), ladders.COMPOSITION).empty
    assert on_rungs(verdicts.order_rises, table.assign(status="diverged")) is None
    coarse = table[table["error"] > 1e-5]
    assert findings.cheapest(coarse, ladders.COMPOSITION)["error"].min() == 1e-4


LOW, MIDDLE, HIGH = "r = 1, λ = 1/3", "r = 3, λ = 1/3", "r = 6, λ = 1/3"


def test_higher_r_pays_or_not():
    rising = {LOW: (1, 1.0), MIDDLE: (3, 3.0), HIGH: (6, 9.0)}
    good = on_rungs(verdicts.higher_r_pays, rungs(ladders.GENERATING, **rising))
    assert (good.outcome, good.measured) == (PASS, Count(1, 1))
    bad = on_rungs(verdicts.higher_r_pays, rungs(ladders.GENERATING, **{LOW: (2, 1.0), HIGH: (2, 2.0)}))
    assert (bad.outcome, bad.where) == (FINDING, "a")


def test_order_that_is_cheapest_at_small_errors_pays():
    steep = {LOW: (1, 1.0), HIGH: (6, 10.0)}
    found = settings(ladders.GENERATING, **steep)
    assert found[0] == LOW
    assert set(found[1:]) == {HIGH}
    assert on_rungs(verdicts.higher_r_pays, rungs(ladders.GENERATING, **steep)).outcome == PASS


def test_costs_are_compared_at_preserved_energy():
    both = {"scheme-v": (4, 1.0), "rk4-relaxation": (4, 2.0)}
    table = rungs(ladders.ENERGY, **both)
    assert set(settings(ladders.ENERGY, **both)) == {"scheme-v"}
    assert on_rungs(verdicts.schemes_pay, table).outcome == PASS
    lost = table.assign(**{"energy error": np.where(table["setting"] == "scheme-v", 1e-9, 1e-15)})
    assert set(findings.cheapest(lost, ladders.ENERGY)["setting"]) == {"rk4-relaxation"}
    bad = on_rungs(verdicts.schemes_pay, lost)
    assert (bad.outcome, bad.measured, bad.where) == (FINDING, Count(0, 1), "a")
    missed = table.assign(fallbacks=np.where(table["setting"] == "scheme-v", 3, 0))
    assert on_rungs(verdicts.schemes_pay, missed).outcome == FINDING
    other = rungs(ladders.ENERGY, "b", **{"scheme-v": (2, 2.0), "rk4-relaxation": (4, 1.0)})
    assert on_rungs(verdicts.schemes_pay, table, other).where == "b"


def test_scenes_won_by_other_methods_are_named_in_order():
    other = {"scheme-v": (2, 9.0), "rk4-relaxation": (4, 1.0)}
    found = on_rungs(verdicts.schemes_pay, *(rungs(ladders.ENERGY, s, **other) for s in "zam"))
    assert found.where == "z, a and m"


# -- nodes, sums, precision --------------------------------------------------------------------------------------------


def rules(own: float = 1e-15, dear: float = 1.5):
    """Fabricated energy errors and times of quadratures with n nodes.

    ``own`` and ``dear`` are the energy error, and the time relative to four nodes, of the adaptive quadrature.
    """
    fixed = [{"nodes": n, "energy error": max(10.0 ** (-4 * n), 1e-16), "ns per step": 100.0 * n} for n in (1, 2, 4, 6)]
    rows = [*fixed, {"nodes": nodes.CONFIRMED, "energy error": own, "ns per step": 400 * dear}]
    return pd.DataFrame(rows).assign(scene="a", h=0.1, status="ok")


def quadratures(*tables: pd.DataFrame):
    """(verdict on the energy, verdict on the cost) of the adaptive quadrature, from fabricated tables."""
    data = {nodes.TABLE: pd.concat(tables)}.get
    return verdicts.quadrature(data), verdicts.quadrature_cost(data)


def test_quadrature_verdicts_on_energy_and_cost():
    energy, cost = quadratures(rules())
    assert (energy.outcome, energy.measured) == (PASS, 1e-15)
    assert (cost.outcome, cost.measured) == (PASS, Range(1.5, 1.5))
    assert quadratures(rules(own=1e-9))[0].outcome == FAIL
    cost = quadratures(rules(dear=2.5))[1]
    assert (cost.outcome, cost.where) == (FINDING, "a, h = 0.1")
    assert quadratures(rules().query("nodes < 4")) == (None, None)


def test_costs_on_several_scenes_are_a_range():
    """On scene b two nodes are enough, and the adaptive rule takes 1.8 times as long."""
    quick = rules(dear=0.9).assign(scene="b", **{"energy error": [1e-8, 1e-16, 1e-16, 1e-16, 1e-15]})
    both = pd.concat([rules(), quick])
    assert findings.quadratures(both)[["nodes", "cost"]].to_numpy().tolist() == [[4, 4], [2, 2]]
    assert quadratures(both)[1].measured == Range(1.5, pytest.approx(1.8))


def round_off_rows(plain: float = 1e-12, floor: float = 1e-4, doubles: float = 1e-6):
    """Fabricated round-off after 10 and 100 steps: in single precision, and in double with plain and compensated sums.

    ``floor`` is the error of single precision, ``doubles`` that of double precision, ``plain`` the round-off of plain
    sums.
    """
    rows = [
        {"steps": steps, "h": 1 / steps, "arithmetic": kind, "round-off rms": off * steps / 100, "error": error}
        for steps in (10, 100)
        for kind, off, error in (
            (arithmetic.SINGLE, 1e-4, floor * (1 if steps == 100 else 3)),
            (arithmetic.PLAIN, plain, doubles),
            (arithmetic.COMPENSATED, 1e-14, doubles),
        )
    ]
    return pd.DataFrame(rows).assign(scene="a")


def sums(table: pd.DataFrame):
    """(verdict on compensated summation, verdict on single precision) from a fabricated table of round-off."""
    data = {arithmetic.ERRORS: table}.get
    return verdicts.compensation(data), verdicts.single(data)


def test_gain_of_compensated_summation():
    good, _ = sums(round_off_rows())
    assert (good.outcome, good.measured) == (PASS, Count(1, 1))
    assert good.where.startswith("a: 100 times")
    assert [sums(round_off_rows(plain=x))[0].outcome for x in (1e-14, 1e-15)] == [FAIL, FAIL]
    assert sums(round_off_rows().query("arithmetic != 'double, plain'")) == (None, None)


def test_error_floor_of_single_precision():
    _, good = sums(round_off_rows())
    assert good.outcome == PASS
    assert good.where.endswith("1.0e-04")
    assert sums(round_off_rows(floor=1e-7))[1].outcome == FINDING


# -- the page ----------------------------------------------------------------------------------------------------------


def passing_tables(**changes) -> dict:
    """All tables of the pages on options, fabricated so that every verdict passes, some of them replaced."""
    other = {LOW: (1, 1.0), MIDDLE: (3, 3.0)}
    ladder = [
        rungs(ladders.COMPOSITION, **RISING),
        rungs(ladders.GENERATING, **other),
        rungs(ladders.ENERGY, **{"scheme-v": (4, 1.0), "rk4-relaxation": (4, 2.0)}),
    ]
    tables = {lambdas.ERRORS: errors(), lambdas.COSTS: costs(), ladders.TABLE: pd.concat(ladder), nodes.TABLE: rules()}
    tables |= {
        solvers.TABLE: solver_rows(),
        arithmetic.ERRORS: round_off_rows(),
        arithmetic.COSTS: pd.DataFrame({"scene": ["a"], "ratio": [1.25]}),
    }
    return tables | changes


PAGES = (page.PAGE, numerics_page.PAGE)


def outcomes(tables: dict) -> list[str]:
    return [v.outcome for p in PAGES for v in p.judge(tables.get)]


@pytest.mark.parametrize(
    ("name", "bad", "verdict"),
    [
        (lambdas.ERRORS, errors(0.25), 0),
        (lambdas.COSTS, costs(2.0, 1.0), 1),
        (nodes.TABLE, rules(own=1e-9), 5),
        (nodes.TABLE, rules(dear=9.0), 6),
        (solvers.TABLE, "dear", 7),
        (arithmetic.ERRORS, round_off_rows(plain=1e-15), 8),
    ],
)
def test_one_bad_table_changes_one_verdict(name, bad, verdict):
    assert outcomes(passing_tables()) == [PASS] * 10
    bad = solver_rows(engine=27.0) if name == solvers.TABLE else bad
    assert [k for k, found in enumerate(outcomes(passing_tables(**{name: bad}))) if found != PASS] == [verdict]


def test_answers_have_the_numbers_of_the_tables():
    tables = passing_tables(**{lambdas.ERRORS: pd.concat([errors(), errors(0.25).assign(scene="b")])})
    said = page.answer(tables.get)
    assert all(part in said for part in ("1 of 2", "order 8", "1e-10", "scheme-v"))
    assert all(part in numerics_page.answer(tables.get) for part in ("100 times", "4 nodes", "1e-13", "takes 1 times"))


def test_page_with_one_table_or_none(tmp_path):
    for each, draw in zip(PAGES, (figures.draw, figures.draw_numerics), strict=True):
        for nothing in ({}.get, dict.fromkeys(passing_tables(), pd.DataFrame()).get):
            assert each.judge(nothing) == []
            assert (each.answer(nothing), each.table(nothing), each.whole(nothing)) == (None, None, None)
            assert draw(nothing, tmp_path) == []
        for name, found in passing_tables().items():
            alone = {name: found}.get
            each.judge(alone), each.answer(alone), each.table(alone), each.whole(alone), draw(alone, tmp_path)
    assert len(page.full_table(passing_tables().get)) == 3 * len(findings.ERRORS)
    alone = solver_rows().query(f"solver == '{solvers.ENGINE}'")
    assert numerics_page.table({solvers.TABLE: alone}.get) is None
    none = {ladders.TABLE: passing_tables()[ladders.TABLE].assign(status="diverged")}.get
    assert (page.full_table(none), page.table(none), page.answer(none)) == (None, None, None)


def test_table_keeps_the_order_of_the_scenes():
    """The pages' tables list scenes in the order of measurement, not of their names."""
    names = ("z", "a", "m")
    ladder = pd.concat([rungs(ladders.COMPOSITION, s, **RISING) for s in names])
    found = page.table({ladders.TABLE: ladder}.get)
    assert tuple(found.frame["scene"]) == names
    several = pd.concat([rules().assign(scene=s) for s in names])
    assert tuple(numerics_page.table({nodes.TABLE: several}.get).frame["scene"]) == tuple(
        f"{s}, h = 0.1" for s in names
    )
    assert tuple(findings.quadratures(several)["scene"]) == names


def test_cost_of_a_lambda_is_that_of_the_nearest_measured():
    others = costs().assign(method="scheme-i", **{"gradients per step": [50.0, 5.0, 500.0]})
    both = {lambdas.ERRORS: errors(0.96), lambdas.COSTS: pd.concat([others, costs()])}.get
    assert page.table(both).frame["costs"].tolist() == ["1.1 times the gradients"], "7 at 1 over 6.5 at 1/2"
    below = {lambdas.ERRORS: errors(-0.04), lambdas.COSTS: costs()}.get
    assert page.table(below).frame["costs"].tolist() == ["0.77 times the gradients"], "5 at 0 over 6.5 at 1/2"
    assert page.table(below).frame["gives"].str.startswith("error 0.001,").all(), "at the larger step"


def test_tables_have_a_row_per_option_and_scene(tmp_path):
    tables = passing_tables(**{lambdas.ERRORS: errors(0.25)}).get
    frame = page.table(tables).frame.set_index("option")
    assert list(frame.index) == ["λ of scheme-iii", ladders.COMPOSITION, ladders.GENERATING, ladders.ENERGY]
    assert frame.loc["λ of scheme-iii", "best setting"] == "0.25"
    assert frame.loc["λ of scheme-iii", "gives"] == "error 0.001, at λ = 1/2 1.6 times that"
    assert frame.loc["λ of scheme-iii", "costs"] == "0.77 times the gradients"
    assert frame.loc[ladders.COMPOSITION, "best setting"] == "8"
    frame = numerics_page.table(tables).frame.set_index("option")
    assert list(frame.index) == ["nodes of AVF", f"solver of {solvers.METHOD}", "sums"]
    assert frame.loc["nodes of AVF", "best setting"] == "4"
    assert frame.loc["sums", "costs"] == "1.2 times as long as plain C"
    assert len(figures.draw(passing_tables().get, tmp_path)) == 3
    assert len(figures.draw_numerics(passing_tables().get, tmp_path)) == 2


def test_cells_have_distinct_ids_and_contents():
    made = cells()
    assert len({c.id for c in made}) == len(made)
    assert len({c.content for c in made}) == len(made)
    assert cells(quick=True) == []
    assert [c.id for part in PARTS for c in part.cells()] == [c.id for c in made], "the whole of each part by default"
    assert len(lambdas.SCENES) >= 4
    assert len(lambdas.SCENES) * len(lambdas.METHODS) + len(ladders.LADDERS) <= ROWS
    cases = sum(len(scene.sizes) for scene in (*nodes.SCENES, *solvers.SCENES))
    assert cases + len(arithmetic.SCENES) <= ROWS


def test_benches_fail_for_bad_rows():
    bench_options.bench_ladders(
        lambda _: [{"knob": "k", "scene": "a", "setting": "s", "error": e} for e in (None, 1e-3)]
    )
    with pytest.raises(AssertionError):
        bench_options.bench_ladders(
            lambda _: [{"knob": "k", "scene": "a", "setting": "s", "error": e} for e in (None, 1)]
        )
    for bench, good, bad in (
        (bench_options.bench_lambda, {"trajectory": 1.0}, {"trajectory": np.inf}),
        (bench_options.bench_largest_steps, {"largest h": 0.1}, {"largest h": 0.05}),
    ):
        same = {"lam": 0.5, "method": "m", "scene": "a", "h": 0.1}
        bench(lambda _, row=good, same=same: [same | row])
        with pytest.raises(AssertionError):
            bench(lambda _, row=bad, same=same: [same | row])


# -- measurements ------------------------------------------------------------------------------------------------------


def test_errors_over_lambda_equal_single_runs():
    made, lams, h, steps = problem("pendulum:swinging"), [Fraction(0), Fraction(1, 3), Fraction(1, 2)], 0.1, 20
    fine = integrate(made, "gauss-6", h=h / 4, steps=4 * steps, save_every=40)
    true = np.hstack([fine.q, fine.p])[1:]
    found = lambdas.errors(made, "scheme-i", lams, h * steps, steps, true)
    for lam, (end, worst) in zip(lams, found, strict=True):
        alone = integrate(made, "scheme-i", parameters={"lam": lam}, h=h, steps=steps, save_every=10)
        apart = np.abs(np.hstack([alone.q, alone.p])[1:] - true).max(axis=1)
        assert (end, worst) == pytest.approx((apart[-1], apart.max()), rel=1e-9)
    assert found[2][1] < 0.2 * found[0][1], "of order 2 at 1/2 alone"


def test_largest_step_is_below_the_closed_form():
    """Scheme I on the oscillator is stable for h omega < 2 / |1 - 2 lambda|, at 1/2 for every h.

    Just below the limit its ellipse is so elongated that the energy error exceeds the tolerance.
    """
    made = problem("harmonic-oscillator")
    lams = [Fraction(-1), Fraction(0), Fraction(1, 2), Fraction(2)]
    found = lambdas.largest(made, "scheme-i", lams, 0.5)
    for lam, h in zip(lams, found, strict=True):
        limit = 2 / abs(1 - 2 * float(lam)) if lam != Fraction(1, 2) else np.inf
        assert h <= limit
        longer = [0.5 * x for x in lambdas.LENGTHS if 0.5 * x > h]
        assert lam == Fraction(1, 2) or longer[0] > limit * 0.5
    assert found[2] == 0.5 * lambdas.LENGTHS[-1]


def test_avf_with_one_node_is_the_midpoint_rule():
    made = problem("pendulum:swinging")
    one = nodes.Run(made, 1, 0.1)
    assert one()
    midpoint = integrate(made, "implicit-midpoint", h=0.1, steps=nodes.STEPS)
    assert np.abs(one.Q - midpoint.q[1:]).max() < 1e-10
    own = nodes.Run(made, nodes.CONFIRMED, 0.1)
    assert own()
    assert own.energy_error() < 1e-14 < 1e-4 < one.energy_error()
    five = nodes.with_nodes(prepare(method(nodes.METHOD), made.system), 5).step
    assert set(five.nodes) == {5}
    assert len(five.nodes) == five.rows[0] == len(five.b) == 2, "five nodes in two rows of four lanes"
    assert np.sum(five.b) == pytest.approx(1, abs=1e-15)
    three = nodes.Run(made, 3, 0.1)
    assert three()
    assert 1e-13 < three.energy_error() < 1e-10, "no rule that it confirms itself"


def test_plain_sums_equal_the_method_up_to_round_off():
    made = problem("henon-heiles:box")
    q, p = arithmetic.starts(made)
    assert (q[0] == made.q0).all()
    assert np.abs(q - q[0]).max() <= arithmetic.SPREAD
    found = arithmetic.ends(made, 0.05, 100)
    exact = arithmetic.plain(made.system, q, p, 0.05, 100, np.longdouble)
    off = {name: np.abs(end - exact).max() for name, end in found.items()}
    assert 1e-8 < off[arithmetic.SINGLE] < 1e-4
    assert off[arithmetic.PLAIN] < 1e-13
    assert 0 < off[arithmetic.COMPENSATED] < 0.3 * off[arithmetic.PLAIN]
    assert exact.dtype == np.longdouble, "nothing on the way is rounded to a double"


@pytest.mark.parametrize("name", [s.problem for s in arithmetic.SCENES])
def test_scenes_of_the_plain_loop_have_unit_masses(name):
    system = problem(name).system
    assert system.unit_mass
    assert np.array(arithmetic.slope(system)(np.ones((system.d, 2), np.float32))).dtype == np.float32


def test_rung_has_the_error_of_its_final_state(monkeypatch):
    short = ladders.Ladder(ladders.COMPOSITION, "pendulum:swinging", 1.0, 10, 3)
    monkeypatch.setattr(ladders, "LADDERS", (short,))
    monkeypatch.setattr(ladders, "ROUNDS", 1)
    few = {"2": ("stormer-verlet", {}), "4": ("suzuki-4", {})}
    monkeypatch.setattr(ladders, "SETTINGS", {ladders.COMPOSITION: few})
    rows = pd.DataFrame(ladders.measure_rows(0)[ladders.TABLE])
    assert list(rows["steps"]) == [10, 14, 20] * 2
    for setting, part in rows.groupby("setting"):
        ratio = part["error"].iloc[0] / part["error"].iloc[2]
        assert np.log2(ratio) == pytest.approx(int(setting), abs=0.2)
    assert (rows["us"] > 0).all()
    monkeypatch.setattr(ladders, "LADDERS", (short._replace(t_end=1.5),))
    with pytest.raises(RuntimeError, match="no certified state"):
        ladders.measure_rows(0)


def test_every_setting_reaches_a_certified_end():
    for ladder in ladders.LADDERS:
        made = problem(ladder.problem)
        assert ladders.stored.end(made, ladder.t_end) is not None
        for record in ladders.settings_of(ladder.option).values():
            assert record.lacks(made.system) is None
    orders = {k: m.order for k, m in ladders.settings_of(ladders.COMPOSITION).items()}
    assert orders == {str(p): p for p in (2, 4, 6, 8, 10)}
    for name, record in ladders.settings_of(ladders.GENERATING).items():
        assert record.order == verdicts.r(name) + name.endswith("1/2")
    assert {m.energy for m in ladders.settings_of(ladders.ENERGY).values()} == {"round-off"}


# -- the solver --------------------------------------------------------------------------------------------------------


def solver_rows(engine: float = 18.0, fixed: float = 24.0, simple: float = 20.0, tolerance: float = 1e-6, **more):
    """Fabricated evaluations per step of all solvers of implicit steps, of which ``engine`` is in use.

    A start extrapolated from five steps saves two evaluations; tolerances up to ``tolerance`` are sufficient.
    """
    rows = []
    for solver, most in ((solvers.FIXED, fixed), (solvers.SIMPLE, simple)):
        status = "ok" if most < np.inf else "not-converged"
        same = {"solver": solver, "status": status}
        rows += [same | {"start": s, "tol": 0.0, "evaluations": n, "error": 1e-5} for s, n in _starts(most)]
        for tol in solvers.TOLERANCES:
            left = 1e-5 if tol <= tolerance else 1e-2
            rows.append(same | {"start": solvers.FIVE, "tol": tol, "evaluations": most / 2, "error": left})
    own = {"solver": solvers.ENGINE, "start": solvers.FIVE, "tol": 0.0, "status": "ok", "error": 1e-5}
    return pd.DataFrame([*rows, own | {"evaluations": engine}]).assign(**{"scene": "a", "h": 0.1} | more)


def _starts(most: float):
    """((start, evaluations), ...): extrapolation from five steps takes two evaluations fewer than a start from zero."""
    return (solvers.ZERO, most), (solvers.FIVE, most - 2)


def solving(*tables: pd.DataFrame):
    """The page's verdict on the solver of implicit steps that is in use, from fabricated evaluations of all solvers."""
    return verdicts.solving({solvers.TABLE: pd.concat(tables)}.get)


def test_engine_is_compared_with_the_best_solver():
    """The solver in use passes at about the 18 evaluations of the best alternative, and fails at 27."""
    good, bad = solving(solver_rows()), solving(solver_rows(engine=27.0))
    assert (good.outcome, good.measured) == (PASS, Range(1, 1))
    assert solving(solver_rows(engine=19.7)).outcome == PASS
    assert (bad.outcome, bad.measured, bad.where) == (FINDING, Range(1.5, 1.5), "a, h = 0.1")


def test_failed_fixed_point_has_no_count():
    both = pd.concat([solver_rows(), solver_rows(engine=18.0, fixed=np.inf, scene="b")])
    found = findings.solving(both)
    assert found["fixed"].isna().tolist() == [False, True]
    assert found["simplified"].tolist() == [18, 18]
    assert solving(both[both["solver"] == solvers.ENGINE]) is None


@pytest.mark.parametrize("tolerance", solvers.TOLERANCES)
def test_loosest_tolerance_that_keeps_the_error(tolerance):
    found = findings.solving(solver_rows(tolerance=tolerance)).iloc[0]
    assert found["loosest"] == tolerance
    assert found["saved"] == pytest.approx(1 - 12 / 22)
    none = findings.solving(solver_rows(tolerance=0.0)).iloc[0]
    assert np.isnan(none["loosest"])
    assert none["saved"] == 0
    smaller = solver_rows(tolerance=0.0).assign(error=lambda t: np.where(t["tol"] > 0, 1e-7, 1e-5))
    assert np.isnan(findings.solving(smaller).iloc[0]["loosest"]), "an error that happens to be small is another one"


def test_every_case_of_a_solver_is_in_the_table():
    three = pd.concat([solver_rows(engine=e, scene=s) for s, e in (("a", 20.0), ("b", 9.0), ("c", 36.0))])
    frame = numerics_page.table({solvers.TABLE: three}.get).frame
    assert frame["scene"].tolist() == ["a, h = 0.1", "b, h = 0.1", "c, h = 0.1"]
    assert [("takes 0.5 times" in x, "takes 2 times" in x, "1e-06" in x) for x in frame["costs"]] == [
        (False, False, True), (True, False, True), (False, True, True),
    ]  # fmt: skip
    assert frame["best setting"].iloc[0] == "simplified Newton, from five steps"


@pytest.mark.parametrize("start", [solvers.ZERO, solvers.POLYNOMIAL, solvers.FIVE])
@pytest.mark.parametrize("solver", [solvers.FIXED, solvers.SIMPLE, solvers.NEWTON])
def test_every_solver_and_start_gives_the_same_step(solver, start):
    made, h, steps = problem("henon-heiles:box"), 0.2, 10
    field = made.system.vector_field()
    loop = solvers.Loop(lambda y: field(0.0, y), np.array([*made.q0, *made.p0]), h, solver, start, solvers.ROUND_OFF)
    assert loop.run(steps)
    own = integrate(made, solvers.METHOD, h=h, steps=steps, save_every=0)
    assert np.abs(loop.y - np.concatenate([own.q[-1], own.p[-1]])).max() < 1e-14


def test_newton_solves_linear_equations_at_once():
    """On y' = w J y the first correction is exact; the fixed-point iteration needs h w < 2, about."""

    def loop(solver, w):
        return solvers.Loop(
            lambda y: w * np.array([y[1], -y[0]]), np.array([1.0, 0.0]), 1.0, solver, solvers.ZERO, 1e-5
        )

    newton, fast, slow = loop(solvers.SIMPLE, 20.0), loop(solvers.FIXED, 20.0), loop(solvers.FIXED, 0.5)
    assert newton.run(3)
    assert newton.iterations == 2 * 3, "and the second confirms it"
    assert newton.evaluations == 3 * (2 * solvers.STAGES + 3)
    assert np.hypot(*newton.y) == pytest.approx(1, abs=1e-4)
    assert not fast.run(3)
    assert slow.run(3)
    assert slow.evaluations == solvers.STAGES * slow.iterations


def test_solver_rows_on_the_oscillator(monkeypatch):
    """The step multiplies q + ip by the (3, 3) Pade approximation of exp at -ih."""
    h, steps = 0.5, 5
    monkeypatch.setattr(solvers, "SCENES", (solvers.Pace("harmonic-oscillator", (h,)),))
    monkeypatch.setattr(solvers, "STEPS", steps)
    rows = pd.DataFrame(solvers.measure_rows(0)[solvers.TABLE])
    assert len(rows) == len(solvers.SETTINGS) + 1
    assert set(rows["status"]) == {"ok"}
    made, z = problem("harmonic-oscillator"), -1j * h
    above, below = (1 + s * z / 2 + z**2 / 10 + s * z**3 / 120 for s in (1, -1))
    apart = (made.q0[0] + 1j * made.p0[0]) * ((above / below) ** steps - np.exp(z * steps))
    to_round_off = rows[rows["tol"] == solvers.ROUND_OFF]
    assert to_round_off["error"].to_numpy() == pytest.approx(max(abs(apart.real), abs(apart.imag)), rel=1e-6)
    loop = rows[rows["solver"] != solvers.ENGINE]
    fixed = loop[loop["solver"] == solvers.FIXED]
    assert fixed["evaluations"].to_numpy() == pytest.approx(solvers.STAGES * fixed["iterations"].to_numpy())
    assert loop["iterations"].between(1, solvers.MOST).all()
    assert loop["iterations"].max() > 2 * loop["iterations"].min()


@pytest.mark.parametrize("scene", solvers.SCENES, ids=lambda s: s.problem)
def test_reference_of_a_solver_is_finer_than_its_error(scene):
    made, h, few = problem(scene.problem), max(scene.sizes), 4

    def end(id, parts):
        run = integrate(made, id, h=h / parts, steps=few * parts, save_every=0)
        assert run.status == "ok"
        return np.concatenate([run.q[-1], run.p[-1]])

    own, fine, finer = end(solvers.METHOD, 1), end(solvers.FINE, 4), end(solvers.FINE, 8)
    assert np.abs(fine - finer).max() < 0.02 * np.abs(own - finer).max()


def test_solver_bench_detects_another_state():
    row = {"scene": "a", "h": 0.1, "status": "ok", "error": 1e-5}
    own = row | {"solver": solvers.ENGINE}
    bench_options.bench_solvers(lambda _: [own, row | {"solver": solvers.NEWTON}])
    for bad in ({"error": 2e-5}, {"status": "not-converged"}):
        with pytest.raises(AssertionError):
            bench_options.bench_solvers(lambda _, bad=bad: [own, row | {"solver": solvers.NEWTON} | bad])


@pytest.mark.parametrize(("start", "degree", "steps"), [(solvers.POLYNOMIAL, 2, 1), (solvers.FIVE, 4, 5)])
def test_start_extrapolates_polynomials_of_its_degree(start, degree, steps):
    """y' = (1, y_0^k): the slopes are the k-th powers of the stages' times."""

    def distance(k: int) -> float:
        loop = solvers.Loop(lambda y: np.array([1.0, y[0] ** k]), np.zeros(2), 0.5, solvers.FIXED, start, 0.0)
        assert loop.run(steps)
        times = 0.5 * (steps + loop.gauss.c)
        return np.abs(loop.first() - np.array([np.ones_like(times), times**k]).T).max()

    assert distance(degree) < 1e-11
    assert distance(degree + 1) > 1e-3
