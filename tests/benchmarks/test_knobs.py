"""The knobs: each sentence on tables for which it must change, each measure where the answer is known."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.experiments.knobs import (
    arithmetic,
    bench_knobs,
    figures,
    findings,
    ladders,
    lambdas,
    nodes,
    page,
    solvers,
    verdicts,
)
from phasebench.benchmarks.experiments.knobs.cells import PARTS, cells
from phasebench.benchmarks.problems import problem
from phasebench.integrators.driver import integrate
from phasebench.integrators.engine.kernel import prepare
from phasebench.integrators.registry import method

# -- lambda ------------------------------------------------------------------------------------------------------------


def errors(best: float = 0.5, constant: float = 1e-3, uncertainty: float = 1e-12, id: str = "scheme-iii"):
    """Errors that are least at ``best``, at two sizes of the step."""
    lams = np.arange(-48, 73) / 24
    return pd.DataFrame(
        [
            {"scene": "a", "method": id, "lam": x, "h": 0.1 / k, "finer": k, "uncertainty": uncertainty}
            | {"trajectory": (constant + 1e-2 * (x - best) ** 2) / k**2, "end": 1e-4 + abs(x - 1)}
            for k in (1, 4)
            for x in lams
        ]
    )


def test_lambda_is_one_half_only_where_its_error_is_least():
    good, bad = verdicts.lam(errors()), verdicts.lam(errors(0.25))
    assert good.holds
    assert "1 of 1 cases" in good.text
    assert "Scheme III is best at λ = 0.5," in good.text
    assert not bad.holds
    assert "0 of 1 cases" in bad.text
    assert "best at λ = 0.25" in bad.text
    assert "up to 1.6 times the least error (a)" in bad.text


def test_an_error_within_ten_percent_is_as_good():
    """At 1/2 it is 1 + 10 (1/12)^2 = 1.07 or 1 + 10 (1/8)^2 = 1.16 times the least."""
    assert verdicts.lam(errors(0.5 - 1 / 12)).holds
    assert not verdicts.lam(errors(0.5 - 1 / 8)).holds


def test_an_error_below_the_truths_own_uncertainty_is_not_the_best():
    table = errors(0.25, uncertainty=1.2e-3)
    best = findings.best_lambdas(table[table["finer"] == 1]).iloc[0]
    assert best["least"] > 1.2e-3
    assert best["best"] != 0.25
    assert best["best at the end"] == 1
    assert verdicts.lam(errors(uncertainty=1.0)) is None


def costs(low: float = 1.0, half: float = 2.0):
    rows = [
        {"lam": x, "largest h": low if x != 0.5 else half, "gradients per step": 5 + x + (x > 0)}
        for x in (0.0, 0.5, 1.0)
    ]
    return pd.DataFrame(rows).assign(scene="a", method="scheme-iii", h=0.1)


def test_where_the_longest_step_is():
    assert verdicts.stable(costs()).holds
    assert verdicts.stable(costs(2.0, 2.0)).holds
    bad = verdicts.stable(costs(2.0, 1.0))
    assert not bad.holds
    assert "0 of 1; not of Scheme III on a;" in bad.text
    assert bad.text.endswith("the fewest gradients at λ = 0, 1.3 times fewer than at 1/2.")
    explicit = costs().assign(**{"gradients per step": [1.0, 6.0, 1.0]})
    assert "λ = 0 and 1, 6 times fewer" in verdicts.stable(explicit).text


# -- ladders -----------------------------------------------------------------------------------------------------------


def rungs(knob: str, scene: str = "a", spread: float = 0.01, **power):
    """Ladders of settings: setting -> (order, cost of a step)."""
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


def test_the_order_rises_as_the_error_falls():
    good = verdicts.composition(rungs(ladders.COMPOSITION, **RISING))
    assert good.holds
    assert "a: 2 to 1e-2, 4 to 1e-4, 8 to 1e-10." in good.text
    bad = verdicts.composition(rungs(ladders.COMPOSITION, **{"4": (2, 1.0), "2": (4, 5.0)}))
    assert not bad.holds
    assert "does not rise with accuracy on a" in bad.text


def test_the_cheapest_is_where_the_power_laws_say():
    """A cost of c steps at an order p takes c E^(-1/p)."""
    found = findings.cheapest(rungs(ladders.COMPOSITION, **RISING), ladders.COMPOSITION).set_index("error")
    for error, row in found[found.index < 1e-1].iterrows():
        wanted = {k: c * error ** (-1 / p) for k, (p, c) in RISING.items()}
        assert row["setting"] == min(wanted, key=wanted.get)
        for name, us in row["costs"].items():
            if us > RISING[name][1] * 4 * 1.01:  # else the shortest ladder is better than was asked for
                assert us == pytest.approx(wanted[name], rel=0.02)
    assert all(ties == [] for ties in found["ties"])
    wide = findings.cheapest(rungs(ladders.COMPOSITION, spread=0.9, **RISING), ladders.COMPOSITION)
    assert any(ties for ties in wide["ties"])
    assert "(or 4, 8, in a tie)" in findings.ranges(wide)
    many = wide.assign(ties=[["a", "b", "c"]] * len(wide))
    assert "(in a tie with 3 others)" in findings.ranges(many)


def test_what_did_not_arrive_or_cannot_get_there_costs_nothing_comparable():
    table = rungs(ladders.COMPOSITION, **RISING)
    assert findings.cheapest(table.assign(status="diverged"), ladders.COMPOSITION).empty
    assert verdicts.composition(table.assign(status="diverged")) is None
    coarse = table[table["error"] > 1e-5]
    assert findings.cheapest(coarse, ladders.COMPOSITION)["error"].min() == 1e-4


LOW, MIDDLE, HIGH = "r = 1, λ = 1/3", "r = 3, λ = 1/3", "r = 6, λ = 1/3"


def test_a_higher_r_pays_or_not():
    good = verdicts.generating(rungs(ladders.GENERATING, **{LOW: (1, 1.0), MIDDLE: (3, 3.0), HIGH: (6, 9.0)}))
    assert good.holds
    assert "a higher r pays" in good.text
    bad = verdicts.generating(rungs(ladders.GENERATING, **{LOW: (2, 1.0), HIGH: (2, 2.0)}))
    assert not bad.holds
    assert "does not pay on a" in bad.text


def test_keepers_are_compared_at_equal_energy_error():
    table = rungs(ladders.ENERGY, **{"scheme-v": (4, 1.0), "rk4-relaxation": (4, 2.0)})
    good = verdicts.energy(table)
    assert good.holds
    assert "scheme-v to 1e-10" in good.text
    lost = table.assign(**{"energy error": np.where(table["setting"] == "scheme-v", 1e-9, 1e-15)})
    bad = verdicts.energy(lost)
    assert not bad.holds
    assert "nowhere the cheapest on a" in bad.text
    assert "rk4-relaxation to 1e-10" in bad.text
    missed = table.assign(fallbacks=np.where(table["setting"] == "scheme-v", 3, 0))
    assert not verdicts.energy(missed).holds
    two = pd.concat([table, rungs(ladders.ENERGY, "b", **{"scheme-v": (2, 2.0), "rk4-relaxation": (4, 1.0)})])
    assert "nowhere the cheapest on b" in verdicts.energy(two).text


# -- nodes, sums, precision --------------------------------------------------------------------------------------------


def rules(own: float = 1e-15, dear: float = 1.5):
    fixed = [{"nodes": n, "energy error": max(10.0 ** (-4 * n), 1e-16), "ns per step": 100.0 * n} for n in (1, 2, 4, 6)]
    rows = [*fixed, {"nodes": nodes.CONFIRMED, "energy error": own, "ns per step": 400 * dear}]
    return pd.DataFrame(rows).assign(scene="a", h=0.1, status="ok")


def test_the_fewest_nodes_and_the_rule_that_confirms_itself():
    good = verdicts.quadrature(rules())
    assert good.holds
    assert "with 4 to 4 nodes, which take 4 to 4 times" in good.text
    assert "takes 1.5 to 1.5 times" in good.text
    for bad in (verdicts.quadrature(rules(own=1e-9)), verdicts.quadrature(rules(dear=2.5))):
        assert not bad.holds
        assert "too dear, or not kept: a, h = 0.1." in bad.text
    assert verdicts.quadrature(rules().query("nodes < 4")) is None


def rounded(plain: float = 1e-12, floor: float = 1e-4, doubles: float = 1e-6):
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


def test_what_compensation_gives_and_costs():
    ratios = pd.DataFrame({"scene": ["a", "b"], "ratio": [1.25, 1.5]})
    good = verdicts.compensation(rounded(), ratios)
    assert good.holds
    assert "100 times after 100 steps (a)" in good.text
    assert "1.2 to 1.5 times as long" in good.text
    assert not verdicts.compensation(rounded(plain=1e-15)).holds
    assert "as long" not in verdicts.compensation(rounded()).text
    assert verdicts.compensation(rounded().query("arithmetic != 'double, plain'")) is None


def test_where_single_precision_ends():
    good = verdicts.single(rounded())
    assert good.holds
    assert "1.0e-04 at h = 0.01 (a), doubles go further." in good.text
    assert not verdicts.single(rounded(floor=1e-7)).holds


# -- the page ----------------------------------------------------------------------------------------------------------


def whole(**changes) -> dict:
    other = {LOW: (1, 1.0), MIDDLE: (3, 3.0)}
    ladder = [
        rungs(ladders.COMPOSITION, **RISING),
        rungs(ladders.GENERATING, **other),
        rungs(ladders.ENERGY, **{"scheme-v": (4, 1.0), "rk4-relaxation": (4, 2.0)}),
    ]
    tables = {lambdas.ERRORS: errors(), lambdas.COSTS: costs(), ladders.TABLE: pd.concat(ladder), nodes.TABLE: rules()}
    tables |= {
        solvers.TABLE: solved(),
        arithmetic.ERRORS: rounded(),
        arithmetic.COSTS: pd.DataFrame({"scene": ["a"], "ratio": [1.25]}),
    }
    return tables | changes


@pytest.mark.parametrize(
    ("name", "bad", "verdict"),
    [
        (lambdas.ERRORS, errors(0.25), 0),
        (lambdas.COSTS, costs(2.0, 1.0), 0),
        (ladders.TABLE, rungs(ladders.GENERATING, **{LOW: (2, 1.0), HIGH: (2, 2.0)}), 1),
        (nodes.TABLE, rules(dear=9.0), 2),
        (arithmetic.ERRORS, rounded(plain=1e-15), 2),
        (solvers.TABLE, "dear", 2),
    ],
)
def test_one_bad_sentence_is_a_finding_and_comes_first(name, bad, verdict):
    assert [v.holds for v in page.PAGE.judged(whole().get)] == [True, True, True]
    bad = solved(engine=27.0) if name == solvers.TABLE else bad
    judged = page.PAGE.judged(whole(**{name: bad}).get)
    assert [v.holds for v in judged] == [k != verdict for k in range(3)]
    good = page.PAGE.judged(whole().get)[verdict]
    assert judged[verdict].short != good.short


def test_the_page_says_what_was_measured_alone(tmp_path):
    assert page.PAGE.judged({}.get) == []
    assert page.table({}.get) is None
    assert page.whole({}.get) is None
    assert figures.draw({}.get, tmp_path) == []
    for name, found in whole().items():
        alone = {name: found}.get
        page.PAGE.judged(alone), page.table(alone), page.whole(alone), figures.draw(alone, tmp_path)
    assert len(page.whole(whole().get)) == 3 * len(findings.ERRORS)


def test_tables_without_a_row_say_nothing(tmp_path):
    empty = dict.fromkeys(whole(), pd.DataFrame()).get
    assert page.PAGE.judged(empty) == []
    assert page.table(empty) is None
    assert page.whole(empty) is None
    assert figures.draw(empty, tmp_path) == []
    alone = solved().query(f"solver == '{solvers.ENGINE}'")
    assert page.table({solvers.TABLE: alone}.get) is None
    none = {ladders.TABLE: whole()[ladders.TABLE].assign(status="diverged")}.get
    assert page.whole(none) is None
    assert page.table(none) is None


def test_the_table_is_in_the_order_of_the_scenes():
    """As they were measured, whatever their names; and the caption says between which errors."""
    names = ("z", "a", "m")
    ladder = pd.concat([rungs(ladders.COMPOSITION, s, **RISING) for s in names])
    found = page.table({ladders.TABLE: ladder}.get)
    assert tuple(found.frame["scene"]) == names
    assert "the smallest error reached of 1e-1 to 1e-10;" in found.caption
    several = pd.concat([rules().assign(scene=s) for s in names])
    assert tuple(page.table({nodes.TABLE: several}.get).frame["scene"]) == names
    assert tuple(findings.quadratures(several)["scene"]) == names


def test_the_cost_of_a_lambda_is_that_of_its_own_method_at_the_nearest_one_measured():
    others = costs().assign(method="scheme-i", **{"gradients per step": [50.0, 5.0, 500.0]})
    both = {lambdas.ERRORS: errors(0.96), lambdas.COSTS: pd.concat([others, costs()])}.get
    assert page.table(both).frame["costs"].tolist() == ["1.1 x"], "7 at 1 over 6.5 at 1/2"
    below = {lambdas.ERRORS: errors(-0.04), lambdas.COSTS: costs()}.get
    assert page.table(below).frame["costs"].tolist() == ["0.77 x"], "5 at 0 over 6.5 at 1/2"
    composed = {lambdas.ERRORS: pd.concat([errors(), errors(id="scheme-iii-suzuki-4")])}.get
    assert page.table(composed).frame["knob"].tolist() == ["λ of scheme-iii"], "of the two schemes alone"
    assert page.table(composed).frame["gives"].tolist() == ["error 0.001, at 1/2 1 x"], "at the larger step"


def test_the_table_has_a_row_for_each_knob_and_scene(tmp_path):
    frame = page.table(whole(**{lambdas.ERRORS: errors(0.25)}).get).frame.set_index("knob")
    assert list(frame.index) == [
        "λ of scheme-iii", ladders.COMPOSITION, ladders.GENERATING, ladders.ENERGY, "nodes of AVF", "sums", "solver",
    ]  # fmt: skip
    assert frame.loc["λ of scheme-iii", "best setting"] == "0.25"
    assert frame.loc["λ of scheme-iii", "gives"] == "error 0.001, at 1/2 1.6 x"
    assert frame.loc["λ of scheme-iii", "costs"] == "0.77 x"
    assert frame.loc[ladders.COMPOSITION, "best setting"] == "8"
    assert frame.loc["nodes of AVF", "best setting"] == "4 at h = 0.1"
    assert frame.loc["sums", "costs"] == "1.2 x plain C"
    assert len(figures.draw(whole().get, tmp_path)) == 5


def test_every_cell_is_told_from_the_others():
    made = cells()
    assert len({c.id for c in made}) == len(made)
    assert len({c.content for c in made}) == len(made)
    assert cells(quick=True) == []
    assert [c.id for part in PARTS for c in part.cells()] == [c.id for c in made], "the whole of each part by default"
    assert len(lambdas.SCENES) >= 4
    rows = 2 * len(lambdas.SCENES) + len(ladders.LADDERS) + len(nodes.SCENES) + len(arithmetic.SCENES) + 2
    assert rows <= 25, "the page's table"


def test_the_benches_fail_where_they_should():
    bench_knobs.bench_ladders(lambda _: [{"knob": "k", "scene": "a", "setting": "s", "error": e} for e in (None, 1e-3)])
    with pytest.raises(AssertionError):
        bench_knobs.bench_ladders(
            lambda _: [{"knob": "k", "scene": "a", "setting": "s", "error": e} for e in (None, 1)]
        )
    for bench, good, bad in (
        (bench_knobs.bench_lambda, {"trajectory": 1.0}, {"trajectory": np.inf}),
        (bench_knobs.bench_largest_steps, {"largest h": 0.1}, {"largest h": 0.05}),
    ):
        same = {"lam": 0.5, "method": "m", "scene": "a", "h": 0.1}
        bench(lambda _, row=good, same=same: [same | row])
        with pytest.raises(AssertionError):
            bench(lambda _, row=bad, same=same: [same | row])


# -- measures ----------------------------------------------------------------------------------------------------------


def test_errors_over_lambda_are_those_of_single_runs():
    made, lams, h, steps = problem("pendulum:swinging"), [Fraction(0), Fraction(1, 3), Fraction(1, 2)], 0.1, 20
    fine = integrate(made, "gauss-6", h=h / 4, steps=4 * steps, save_every=40)
    true = np.hstack([fine.q, fine.p])[1:]
    found = lambdas.errors(made, "scheme-i", lams, h * steps, steps, true)
    for lam, (end, worst) in zip(lams, found, strict=True):
        alone = integrate(made, "scheme-i", parameters={"lam": lam}, h=h, steps=steps, save_every=10)
        apart = np.abs(np.hstack([alone.q, alone.p])[1:] - true).max(axis=1)
        assert (end, worst) == pytest.approx((apart[-1], apart.max()), rel=1e-9)
    assert found[2][1] < 0.2 * found[0][1], "of order 2 at 1/2 alone"


def test_the_largest_step_is_below_the_one_in_closed_form():
    """Scheme I on the oscillator is stable to h omega = 2 / |1 - 2 lambda|, and at 1/2 for every h.

    A little below the limit its ellipse is so long that the energy is lost on the way round.
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


def test_one_node_is_the_implicit_midpoint_rule():
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


def test_plain_sums_are_the_method_to_round_off_in_every_precision():
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
def test_the_plain_loop_needs_unit_masses_and_a_gradient_without_fractions(name):
    system = problem(name).system
    assert system.unit_mass
    assert np.array(arithmetic.slope(system)(np.ones((system.d, 2), np.float32))).dtype == np.float32


def test_a_rung_has_the_error_of_its_end(monkeypatch):
    short = ladders.Ladder(ladders.COMPOSITION, "pendulum:swinging", 1.0, 10, 3)
    monkeypatch.setattr(ladders, "LADDERS", (short,))
    monkeypatch.setattr(ladders, "ROUNDS", 1)
    few = {"2": ("stormer-verlet", {}), "4": ("suzuki-4", {})}
    monkeypatch.setattr(ladders, "SETTINGS", {ladders.COMPOSITION: few})
    rows = pd.DataFrame(ladders.measured(0)[ladders.TABLE])
    assert list(rows["steps"]) == [10, 14, 20] * 2
    for setting, part in rows.groupby("setting"):
        ratio = part["error"].iloc[0] / part["error"].iloc[2]
        assert np.log2(ratio) == pytest.approx(int(setting), abs=0.2)
    assert (rows["us"] > 0).all()
    monkeypatch.setattr(ladders, "LADDERS", (short._replace(t_end=1.5),))
    with pytest.raises(RuntimeError, match="no certified state"):
        ladders.measured(0)


def test_every_ladder_has_a_certified_end_and_every_setting_can_do_its_problem():
    for ladder in ladders.LADDERS:
        made = problem(ladder.problem)
        assert ladders.stored.end(made, ladder.t_end) is not None
        for record in ladders.chosen(ladder.knob).values():
            assert record.lacks(made.system) is None
    orders = {k: m.order for k, m in ladders.chosen(ladders.COMPOSITION).items()}
    assert orders == {str(p): p for p in (2, 4, 6, 8, 10)}
    for name, record in ladders.chosen(ladders.GENERATING).items():
        assert record.order == verdicts._r(name) + name.endswith("1/2")
    assert {m.energy for m in ladders.chosen(ladders.ENERGY).values()} == {"round-off"}


# -- the solver --------------------------------------------------------------------------------------------------------


def solved(engine: float = 18.0, fixed: float = 24.0, simple: float = 20.0, tolerance: float = 1e-6, **more):
    """Evaluations to round-off of either, from five steps two less than from zero; tolerances that leave the error."""
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
    return (solvers.ZERO, most), (solvers.FIVE, most - 2)


def test_the_engines_way_is_as_good_as_the_best_or_it_is_said_where_not():
    """The best of the loop takes 18."""
    good, bad = verdicts.solving(solved()), verdicts.solving(solved(engine=27.0))
    assert good.holds
    assert "1 to 1 times the evaluations" in good.text
    assert "simplified Newton takes 0.82 to 0.82 of the fixed point's" in good.text
    assert "from five steps takes 0.92 to 0.92 of those from zero" in good.text
    assert verdicts.solving(solved(engine=19.7)).holds
    assert not bad.holds
    assert "1.5 to 1.5 times the evaluations of the best of a plain loop, more than it need on a, h = 0.1" in bad.text


def test_where_the_fixed_point_does_not_converge_is_named():
    both = pd.concat([solved(), solved(engine=18.0, fixed=np.inf, scene="b")])
    said = verdicts.solving(both).text
    assert "does not converge on b, h = 0.1" in said
    assert "does not converge" not in verdicts.solving(solved()).text
    found = findings.solving(both)
    assert found["fixed"].isna().tolist() == [False, True]
    assert verdicts.solving(both[both["solver"] == solvers.ENGINE]) is None


@pytest.mark.parametrize("tolerance", solvers.TOLERANCES)
def test_the_loosest_tolerance_is_the_one_that_leaves_the_error(tolerance):
    found = findings.solving(solved(tolerance=tolerance)).iloc[0]
    assert found["loosest"] == tolerance
    assert found["saved"] == pytest.approx(1 - 12 / 22)
    assert (
        f"a tolerance of {tolerance:.0e} to {tolerance:.0e} leaves"
        in verdicts.solving(solved(tolerance=tolerance)).text
    )
    none = findings.solving(solved(tolerance=0.0)).iloc[0]
    assert np.isnan(none["loosest"])
    assert none["saved"] == 0
    smaller = solved(tolerance=0.0).assign(error=lambda t: np.where(t["tol"] > 0, 1e-7, 1e-5))
    assert np.isnan(findings.solving(smaller).iloc[0]["loosest"]), "an error that happens to be small is another one"


def test_the_table_has_the_nearest_and_the_farthest_case():
    three = pd.concat([solved(engine=e, scene=s) for s, e in (("a", 20.0), ("b", 9.0), ("c", 36.0))])
    frame = page.table({solvers.TABLE: three}.get).frame
    assert frame["scene"].tolist() == ["b", "c"]
    assert frame["costs"].tolist() == ["the engine 0.5 x", "the engine 2 x"]
    assert frame["best setting"].iloc[0] == "simplified Newton, from five steps, at h = 0.1"


@pytest.mark.parametrize("start", [solvers.ZERO, solvers.POLYNOMIAL, solvers.FIVE])
@pytest.mark.parametrize("solver", [solvers.FIXED, solvers.SIMPLE, solvers.NEWTON])
def test_every_solver_from_every_start_is_the_registered_method(solver, start):
    made, h, steps = problem("henon-heiles:box"), 0.2, 10
    field = made.system.vector_field()
    loop = solvers.Loop(lambda y: field(0.0, y), np.array([*made.q0, *made.p0]), h, solver, start, solvers.ROUND_OFF)
    assert loop.run(steps)
    own = integrate(made, solvers.METHOD, h=h, steps=steps, save_every=0)
    assert np.abs(loop.y - np.concatenate([own.q[-1], own.p[-1]])).max() < 1e-14


def test_newtons_method_solves_linear_equations_at_once_and_the_fixed_point_only_where_it_contracts():
    """On the oscillator y' = w J y the first correction is exact; the fixed point needs h w below about 2."""

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


def test_the_rows_of_a_solver_on_the_oscillator(monkeypatch):
    """The method's step multiplies q + ip by its stability function at -ih, Pade's (3, 3) approximation of exp."""
    h, steps = 0.5, 5
    monkeypatch.setattr(solvers, "SCENES", (solvers.Pace("harmonic-oscillator", (h,)),))
    monkeypatch.setattr(solvers, "STEPS", steps)
    rows = pd.DataFrame(solvers.measured(0)[solvers.TABLE])
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
def test_what_a_solver_is_compared_with_is_finer_than_what_is_compared(scene):
    made, h, few = problem(scene.problem), max(scene.sizes), 4

    def end(id, parts):
        run = integrate(made, id, h=h / parts, steps=few * parts, save_every=0)
        assert run.status == "ok"
        return np.concatenate([run.q[-1], run.p[-1]])

    own, fine, finer = end(solvers.METHOD, 1), end(solvers.FINE, 4), end(solvers.FINE, 8)
    assert np.abs(fine - finer).max() < 0.02 * np.abs(own - finer).max()


def test_the_solvers_bench_sees_another_end():
    row = {"scene": "a", "h": 0.1, "status": "ok", "error": 1e-5}
    own = row | {"solver": solvers.ENGINE}
    bench_knobs.bench_solvers(lambda _: [own, row | {"solver": solvers.NEWTON}])
    for bad in ({"error": 2e-5}, {"status": "not-converged"}):
        with pytest.raises(AssertionError):
            bench_knobs.bench_solvers(lambda _, bad=bad: [own, row | {"solver": solvers.NEWTON} | bad])


@pytest.mark.parametrize(("start", "degree", "steps"), [(solvers.POLYNOMIAL, 2, 1), (solvers.FIVE, 4, 5)])
def test_a_start_continues_slopes_that_are_polynomials_of_its_degree(start, degree, steps):
    """y' = (1, y_0^k): the slopes are the k-th powers of the stages' times."""

    def apart(k: int) -> float:
        loop = solvers.Loop(lambda y: np.array([1.0, y[0] ** k]), np.zeros(2), 0.5, solvers.FIXED, start, 0.0)
        assert loop.run(steps)
        times = 0.5 * (steps + loop.gauss.c)
        return np.abs(loop.first() - np.array([np.ones_like(times), times**k]).T).max()

    assert apart(degree) < 1e-11
    assert apart(degree + 1) > 1e-3


# -- sentences of several scenes ---------------------------------------------------------------------------------------


def test_the_best_lambdas_of_several_scenes_are_a_span_and_the_greatest_gain_is_named():
    two = pd.concat([errors(0.5), errors(0.25).assign(scene="b"), errors(0.0).assign(scene="c")])
    said = verdicts.lam(two)
    assert "in 1 of 3 cases" in said.text
    assert (
        "best at λ = 0 to 0.5, with a smaller h at λ = 0 to 0.5; 1/2 has up to 3.5 times the least error (c)"
        in said.text
    )
    assert said.short == "λ = 1/2 has the least trajectory error in 1 of 3 cases of a scheme and a scene."


def test_what_was_not_measured_at_one_half_is_left_out_alone():
    others = errors().query("lam != 0.5").assign(scene="z")
    assert findings.best_lambdas(pd.concat([others, errors()]))["scene"].tolist() == ["a", "a"]
    without = costs().query("lam != 0.5").assign(scene="z")
    assert findings.longest(pd.concat([without, costs()]))["scene"].tolist() == ["a"]


def test_the_longest_steps_are_counted():
    three = pd.concat([costs().assign(scene=s) for s in "ab"] + [costs(2.0, 1.0).assign(scene="c")])
    assert "in 2 of 3; not of Scheme III on c;" in verdicts.stable(three).text


def test_an_order_pays_that_is_the_cheapest_at_once_below_the_largest_error():
    table = rungs(ladders.GENERATING, **{LOW: (1, 1.0), HIGH: (6, 10.0)})
    found = findings.cheapest(table, ladders.GENERATING).sort_values("error", ascending=False)["setting"].tolist()
    assert found[0] == LOW
    assert set(found[1:]) == {HIGH}
    assert verdicts.generating(table).holds


def test_scenes_without_a_scheme_of_the_talk_are_named_as_they_come():
    other = {"scheme-v": (2, 9.0), "rk4-relaxation": (4, 1.0)}
    said = verdicts.energy(pd.concat([rungs(ladders.ENERGY, s, **other) for s in "zam"]))
    assert "nowhere the cheapest on z, a and m." in said.text


def test_nodes_of_several_scenes_are_a_range():
    """Of b two nodes do, and the rule that confirms itself takes 1.8 times as long as these."""
    quick = rules(dear=0.9).assign(scene="b", **{"energy error": [1e-8, 1e-16, 1e-16, 1e-16, 1e-15]})
    said = verdicts.quadrature(pd.concat([rules(), quick]))
    assert "with 2 to 4 nodes, which take 2 to 4 times as long as one;" in said.text
    assert "takes 1.5 to 1.8 times as long as the fewest that do." in said.text


def test_tolerances_of_several_scenes_are_a_range():
    loose, tight = max(solvers.TOLERANCES), min(t for t in solvers.TOLERANCES if t > 0)
    said = verdicts.solving(pd.concat([solved(tolerance=loose), solved(tolerance=tight, fixed=30.0, scene="b")]))
    assert f"a tolerance of {tight:.0e} to {loose:.0e} leaves the error as it is and saves 45 to 46 % of" in said.text
    assert said.short == f"{said.text.partition(';')[0]}."
    assert said.short.startswith("To solve the stages of")
