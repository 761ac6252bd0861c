"""What only a hand-made case shows of the measures of studies."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.measure import clock
from phasebench.benchmarks.measure.integrator import Integrator, integrator
from phasebench.benchmarks.measure.orders import successive
from phasebench.benchmarks.measure.quantities import Truth
from phasebench.benchmarks.measure.visible import least_visible
from phasebench.benchmarks.page import long_runs
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.studies import advice, constraints, extended, hessian_free, oscillatory, rigid, sampling
from phasebench.benchmarks.studies import wisdom_holman as wh
from phasebench.benchmarks.studies.advice import asks, brute
from phasebench.integrators.coefficients import GROUPS, steps
from phasebench.integrators.coefficients.order_conditions import classical_order
from phasebench.integrators.compile.codegen import precision
from phasebench.integrators.driver import integrate
from phasebench.integrators.ensemble import integrate_ensemble
from phasebench.integrators.registry import BY_ID

# -- advice ------------------------------------------------------------------------------------------------------------


def test_drawn_questions_are_reproducible():
    drawn = tuple(asks.ASKS.values())
    assert len(drawn) == 60
    assert sum(a.outside for a in drawn) == 15
    assert asks.draw() == drawn != asks.draw(seed=asks.SEED + 1)
    assert any(a.conserve for a in drawn)
    assert {"end-state", "trajectory", "energy"} < {a.quantity for a in drawn}
    assert [a for group in advice.GROUPS for a in advice.requests(group)] == [*drawn]


@pytest.mark.parametrize("ask", [a for a in asks.ASKS.values() if a.outside][::5], ids=lambda a: a.name)
def test_questions_with_formulas_are_valid(ask):
    question = advice.asked_of(ask)
    assert question.problem.system.canonical
    assert question.quantity.name == ask.quantity


@pytest.mark.parametrize(("id", "sizes"), [("rk4", "steps"), ("heyoka", "tol")])
def test_brute_force_finds_the_cheapest_run(id, sizes):
    asked = [a for a in asks.ASKS.values() if a.words == ("pendulum:swinging",) and a.quantity == "end-state"]
    question = advice.asked_of(asked[0])
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
    (printed,) = advice.rerun([line])
    assert 0 < advice.error_of(printed) < 1e-4
    assert advice.error_of({"quantity_error": {"error": 2.0}, "global_error": 1.0}) == 2.0
    with pytest.raises(RuntimeError, match="rerun failed"):
        advice.rerun(["another command"])


# -- constraints -------------------------------------------------------------------------------------------------------


def test_plain_rattle_iterated_to_round_off_is_rattle():
    made = problem(constraints.SPHERE)
    plain = constraints.loose_rattle.py_func
    energy, iterations = plain(np.array(made.q0), np.array(made.p0), 0.05, 20, 1, 1e-15)
    s = integrate(made, "rattle", h=0.05, steps=20)
    assert np.abs(energy - s.energy()).max() < 1e-14
    loose, fewer = plain(np.array(made.q0), np.array(made.p0), 0.05, 20, 1, 1e-4)
    assert np.abs(loose - s.energy()).max() > 1e-9
    assert fewer < iterations


# -- extended phase space ----------------------------------------------------------------------------------------------


def test_the_orbit_is_that_of_the_schwarzschild_problem():
    """Radius and momentum after a while, in units of the semilatus rectum."""
    with precision(extended.DIGITS):
        whole, _, _, y = extended.orbit()
    size = float(1 / extended.EPSILON)
    made = problem("schwarzschild:precessing", semilatus=size, e=float(extended.ECCENTRICITY))
    own = integrate(whole, "gauss-4", h=0.01, steps=200, q0=[float(x) for x in y[:2]], p0=[float(x) for x in y[2:]])
    other = integrate(made, "gauss-4", h=0.01 * size**1.5, steps=200)
    r, phi = other.q[-1, 1:] / (size, 1)
    np.testing.assert_allclose(own.q[-1], [r * np.cos(phi), r * np.sin(phi)], rtol=0, atol=1e-9)
    assert abs(own.q[-1, 0] - own.q[0, 0]) > 0.1


def test_defects_and_orders_in_extended_phase_space(uncompiled):
    """Some rows, measured without compilation."""
    measured = uncompiled("benchmarks/test_study_measures.py")
    both, one, midpoint = (measured[x] for x in ("both", "one", "midpoint"))
    assert max(r["defect"] for r in both) < 1e-26 < 1e-8 < max(r["defect"] for r in one)
    assert [r[extended.DEFECT_ORDER] for r in both] == [None] * 3
    by_name = {r["problem"]: r for r in midpoint}
    assert by_name["coupled"]["defect"] > 1e-13
    assert abs(by_name["coupled"][extended.DEFECT_ORDER] - 6) < 0.05
    special, jumped = ([r["order"] for r in measured[x]] for x in ("special", "jumped"))
    assert special[0] is None
    assert abs(special[-1] - 2) < 0.1
    assert abs(jumped[-1] - 4) < 0.1
    assert measured["special"][0]["error"] < measured["jumped"][0]["error"] / 100


# -- what is declared --------------------------------------------------------------------------------------------------

DRIFTING = {
    "purpose": "drift", "status": "ok", "kind": "phasebench", "t_end": 1000.0, "h": 0.1, "fallbacks": 0, "id": "rk4",
    "method": "rk4", "scene": "pendulum-t1000", "problem": "pendulum:swinging", "energy_max": 1e-6,
    "energy_end": 0.51e-6, "energy_drift": 0.6e-9, "energy_drift_low": 0.51e-9, "energy_drift_high": 0.7e-9,
}  # fmt: skip


@pytest.mark.parametrize(
    ("change", "drifts"),
    [({}, True), ({"energy_drift_low": 0.49e-9}, False), ({"energy_end": 0.49e-6}, False),
     ({"energy_end": -1e-6}, False), ({"energy_drift_low": -0.1e-9}, False)],
)  # fmt: skip
def test_a_drift_is_sure_and_half_of_the_error(change, drifts):
    row = DRIFTING | change
    low, high = row["energy_drift_low"], row["energy_drift_high"]
    falling = row | {"energy_end": -row["energy_end"], "energy_drift_low": -high, "energy_drift_high": -low}
    assert long_runs.completed_runs(pd.DataFrame([row, falling]))["drifts"].tolist() == [drifts, drifts]


def test_long_runs_are_those_of_this_project_that_reached_the_end():
    others = [{"purpose": "order"}, {"kind": "rebound"}, {"status": "skipped"}, {"status": "diverged"}]
    prey = {"problem": "lotka-volterra", "id": "hbvm-2-1"}
    frame = pd.DataFrame([DRIFTING | change for change in (*others, {}, prey, {"id": "hbvm-2-1"})])
    assert long_runs.long_runs(frame)["status"].tolist() == ["diverged", "ok", "ok", "ok"]
    ran = long_runs.completed_runs(frame)
    assert ran["canonical"].tolist() == [True, False, True]
    assert ran["few nodes"].tolist()[::2] == [False, True]


def test_high_orders_are_seen_by_their_digits():
    """Gauss of order 16 is measured in 128 digits, and a processed method is nearly symmetric."""
    assert least_visible("gauss-8-field", "symmetry") == pytest.approx(1e-64)
    assert [least_visible("rk4", name) for name in ("symplecticity", "symmetry")] == [1e-22, 1e-22]
    processed = [least_visible("blanes-casas-murua-p11-6", name) for name in ("symplecticity", "symmetry")]
    assert processed == [1e-22, 1e-25]


# -- the energy without the Hessian ------------------------------------------------------------------------------------


def test_partners_have_the_structure_of_the_hessian_free_method():
    """Drifts, kicks and gradients stand at the same places."""
    for free, partner in hessian_free.WITH.items():
        shapes = [[tuple(bool(x) for x in row) for row in BY_ID[id].data[0]] for id in (free, partner)]
        assert shapes[0] == shapes[1], free


def test_chaotic_rows_show_the_drift_of_a_runge_kutta_method():
    rows = {m: hessian_free.chaotic(m, steps=20_000) for m in ("hessian-free-badab", "chin-4a", "rk4")}
    for m in ("hessian-free-badab", "chin-4a"):
        assert rows[m]["failed"] == 0
        assert abs(rows[m]["change"]) < 1e-5
    assert rows["rk4"]["high"] < 0
    assert rows["rk4"]["orbits"] == hessian_free.ORBITS


def test_the_interval_of_a_mean():
    """Student's, for 0, 1, 2: 1 +- 4.3027 / 3^(1/2)."""
    mean, low, high = hessian_free.student(np.array([0.0, 1.0, 2.0]))
    assert (mean, high - mean, mean - low) == pytest.approx((1.0, *[4.302652729911275 / np.sqrt(3)] * 2))


# -- highly oscillatory systems ----------------------------------------------------------------------------------------


def resonant(**errors: float) -> pd.DataFrame:
    """Runs of a method with these energy errors; p_10 is the error at h omega / pi = 1.0."""
    rows = [{oscillatory.RATIO: int(k[2:]) / 10, "status": "ok", oscillatory.ENERGY: e} for k, e in errors.items()]
    return pd.DataFrame(rows)


@pytest.mark.parametrize(
    ("rows", "where"),
    [
        (resonant(p_1=1e-3, p_10=0.99, p_20=0.5, p_31=0.1), ""),
        (resonant(p_1=1e-4, p_10=1.01, p_20=0.5, p_31=3.0, p_35=7.0, p_37=0.1), "near 1 π and 3 π and at 1 other step"),
        (resonant(p_1=1e-3, p_5=0.1, p_6=2.0, p_9=4.0), "above 0.5 π"),
        (resonant(p_1=1e-3, p_12=2.0, p_13=1e-2, p_14=3.0, p_16=0.1), "at 2 other steps"),
        (resonant(p_1=2.0, p_5=3.0), "at every step"),
        (resonant(p_1=1e-3, p_11=2.0, p_13=1e-3), "near 1 π"),
        (resonant(p_1=1e-3, p_10=0.1, p_20=0.1).assign(status=["ok", "diverged", "ok"]), "near 1 π"),
    ],
)
def test_places_of_resonances(rows, where):
    assert oscillatory.where_lost(rows) == where


# -- rigid bodies ------------------------------------------------------------------------------------------------------


def test_an_angle_is_that_of_the_turn_between_attitudes():
    half = np.radians(15.0)
    q, turn = np.array([1.0, 0, 0, 0]), np.array([np.cos(half), 0, np.sin(half), 0])
    assert rigid.angle(q, turn) == pytest.approx(30.0, rel=1e-14)
    assert rigid.angle(q, -3 * turn) == pytest.approx(30.0, rel=1e-14), "the same attitude"
    assert rigid.angle(q, q) == 0


def test_orders_stop_where_rounding_is_seen():
    found = successive([1e-2, 2.5e-3, 1e-12], [1e-11] * 3)
    assert np.isnan([found[0], found[2]]).all()
    assert found[1] == pytest.approx(2)


# -- sampling ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("table", GROUPS["sampling"], ids=lambda t: t.name)
def test_splittings_for_sampling_have_order_2_with_the_numbers_as_printed(table):
    found = steps(table.name)
    assert classical_order("splitting", found) == 2
    letter, weight = found[0]
    assert classical_order("splitting", [(letter, weight + 1e-9), *found[1:]], tolerance=1e-12) == 0, "the control"


@pytest.mark.parametrize("id", sampling.EVALUATIONS)
def test_evaluations_per_step_are_those_of_the_method(id):
    """By the counts of a run, in which the first kick of the first step comes on top."""
    q, p = sampling.draws("quartic", 1)
    found = integrate_ensemble(sampling.system("quartic"), id, q, p, h=0.001, steps=100)
    assert found.counts["gradient"] // 100 == sampling.EVALUATIONS[id]


@pytest.mark.parametrize("target", sampling.TARGETS)
def test_draws_have_the_moments_of_the_target(target):
    """Means of (w q)^2 and p^2 over draws, against one-dimensional quadrature, within four standard errors."""
    q, p = sampling.draws(target, 4000)
    x = np.linspace(-8, 8, 4001)
    density = np.exp(-(x**2 / 2 + (x**4 / 4 if target == "quartic" else 0)))
    wanted = (x**2 * density).sum() / density.sum()
    squares = (q * 2 * np.arange(1, sampling.D + 1)) ** 2
    assert abs(squares.mean() - wanted) < 4 * squares.std() / np.sqrt(squares.size)
    assert abs((p**2).mean() - 1) < 4 * np.sqrt(2 / p.size)
    assert (wanted < 0.6) == (target == "quartic"), "the control: a normal x has the mean 1"


def test_acceptance_by_stormer_verlet_is_that_of_a_plain_run():
    """Stormer-Verlet in NumPy from the same draws."""
    budget, n = 48, 500
    q, p = sampling.draws("quartic", n)
    omega, h = 2.0 * np.arange(1, sampling.D + 1), sampling.TIME / budget

    def gradient(q):
        return omega * (omega * q + (omega * q) ** 3)

    def energy(q, p):
        return (p**2 / 2 + (omega * q) ** 2 / 2 + (omega * q) ** 4 / 4).sum(axis=1)

    x, v = q.copy(), p.copy()
    with np.errstate(all="ignore"):
        for _ in range(budget):
            v = v - h / 2 * gradient(x)
            x = x + h * v
            v = v - h / 2 * gradient(x)
        error = energy(x, v) - energy(q, p)
        accepted = np.where(np.isfinite(error), np.exp(-np.clip(error, 0, 700)), 0.0)
    found = sampling.mean_acceptance("quartic", sampling.VERLET, budget, n)
    assert found["acceptance"] == pytest.approx(accepted.mean(), abs=0.01)
    assert found["low"] < found["acceptance"] < found["high"]
    assert 0.3 < accepted.mean() < 0.9, "the control: it is no trivial share"


def test_hessian_free_kicks_are_the_same_on_a_gaussian_target():
    """There gradients are linear, and a second force is exact."""
    both = [sampling.mean_acceptance("Gaussian", id, 48, 200)["acceptance"] for id in ("chin-4a", "hessian-free-badab")]
    assert both[0] == pytest.approx(both[1], abs=1e-12)


def test_time_of_a_proposal_is_measured_with_its_acceptance(monkeypatch):
    monkeypatch.setattr(sampling, "ROUNDS", 2)
    monkeypatch.setattr(sampling, "EVALUATIONS", {"stormer-verlet": 1})
    monkeypatch.setattr(sampling, "BUDGETS", {"Gaussian": (36,)})
    (row,) = sampling.times("Gaussian")
    assert row["acceptance"] == sampling.mean_acceptance("Gaussian", "stormer-verlet", 36)["acceptance"]
    assert row["ns an accepted proposal"] == row["ns a proposal"] / row["acceptance"] > row["ns a proposal"]


# -- Wisdom-Holman splittings ------------------------------------------------------------------------------------------


def test_failed_pair_raises(monkeypatch):
    lost = SimpleNamespace(status="diverged", reason="it fell", method=SimpleNamespace(label="who"))
    monkeypatch.setattr(wh, "integrator", lambda name: SimpleNamespace(run=lambda *of, **how: lost))
    with pytest.raises(RuntimeError, match=": it fell"):
        wh.pair("perturbed-kepler, e = 0.2", "wisdom-holman", 0.1)


def test_every_variant_of_rebound_is_measured():
    ids = {c.id for c in wh.rivals()}
    theirs = {i.removeprefix("rebound-") for i in ids if i.startswith("rebound-")}
    kernels = {f"whfast({k}, corrector2)" for k in ("default", "lazy", "modifiedkick", "composition")}
    others = {f"whfast(coordinates={c})" for c in ("democraticheliocentric", "whds", "barycentric")}
    assert theirs >= {"whfast", "whfast-plain", "whfast-modifiedkick", "whfast-composition", *kernels, *others}
    assert theirs >= {*(f"whfast-corrector-{n}" for n in (3, 5, 7, 11, 17)), "whfast512", "whfast512-corrector-17"}
    assert len([i for i in theirs if i.startswith("saba")]) == 18
    labels = [c.label for c in wh.rivals()]
    assert len(set(labels)) == len(labels)
    assert {f"wisdom-holman-corrector(corrector={n})" for n in (3, 5, 7, 11, 17)} < set(labels)
    assert {"wisdom-holman-aba-8-6-4", "wisdom-holman-saba-2"} < set(labels)


@pytest.fixture
def fake_clocks(monkeypatch):
    """Short runs, and clocks that return 99 (warm-up, not counted), 1, 2, 3, ... seconds."""
    run = Integrator.run

    def short(self, problem, **how):
        return run(self, problem, **how | {"steps": min(how["steps"], 400)})

    def told(*_, **__):
        spent = iter([99.0, *range(1, 99)])
        return lambda: float(next(spent))

    monkeypatch.setattr(Integrator, "run", short)
    monkeypatch.setattr(clock, "clock", told)


def test_times_are_medians_of_alternating_rounds(fake_clocks, monkeypatch):
    chosen = [c for c in wh.rivals() if c.id in ("wisdom-holman", "rebound-whfast-plain", "rebound-whfast512")]
    monkeypatch.setattr(wh, "rivals", lambda: chosen)
    monkeypatch.setattr(wh, "ROUNDS_OF_ALL", 3)
    monkeypatch.setitem(wh.CASES, "perturbed-kepler, e = 0.2", ("perturbed-kepler", {"e": 0.2}, [0.1], 40.0))
    rows = wh.every_rival("perturbed-kepler, e = 0.2")
    by = {r["method"]: r for r in rows}
    assert by["rebound-whfast512"]["status"] == "skipped"
    assert "Newtonian gravity alone" in by["rebound-whfast512"]["reason"]
    for name in ("wisdom-holman", "rebound-whfast-plain"):
        per = 1e9 / wh.TIMED_OF_ALL / 0.1
        assert [by[name][c] for c in (wh.COST, wh.LOW, wh.HIGH)] == pytest.approx([2 * per, 1 * per, 3 * per])
    assert by["wisdom-holman"][wh.ERROR] == pytest.approx(by["rebound-whfast-plain"][wh.ERROR], rel=1e-3)


def test_row_of_a_pair_has_medians_and_largest_distance(fake_clocks, monkeypatch):
    monkeypatch.setattr(wh, "ROUNDS", 3)
    monkeypatch.setitem(wh.CASES, "perturbed-kepler, e = 0.2", ("perturbed-kepler", {"e": 0.2}, [0.1], 40.0))
    row = wh.pair("perturbed-kepler, e = 0.2", "wisdom-holman", 0.1)
    per = 2e9 / wh.TIMED
    assert (row["ns per step"], row["REBOUND's ns per step"]) == pytest.approx((per, per))
    assert (row["time ratio"], row["ratio, low"], row["ratio, high"]) == (1.0, 1.0, 1.0)
    assert 0 < row["distance of early positions"] <= row["distance of end positions"] * 100 < 1e-9
    assert row["energy error"] == pytest.approx(row["REBOUND's energy error"], rel=1e-3)
    other = wh.PAIRS | {"wisdom-holman": "rebound-saba-4"}
    monkeypatch.setattr(wh, "PAIRS", other)
    wrong = wh.pair("perturbed-kepler, e = 0.2", "wisdom-holman", 0.1)
    assert wrong["distance of early positions"] > 1e-8


def test_energy_error_is_the_largest_of_either_sign():
    system = SimpleNamespace(H=None, observe=lambda H, q, p: np.array(q))
    made = SimpleNamespace(system=system)
    assert wh.energy_error(made, [2.0, 2.1, 1.6, 2.0], None) == pytest.approx(0.2)
    assert wh.energy_error(made, [-2.0, -2.6, -1.9], None) == pytest.approx(0.3)


def test_distances_of_a_pair_are_relative(fake_clocks, monkeypatch):
    """Two runs of size 20 differ by 0.02 early, by 4 in the middle and by 1 at the end."""
    theirs = 20 * np.ones((wh.SAVED + 1, 2))
    apart = np.zeros_like(theirs)
    apart[5, 1], apart[wh.SAVED // 2, 0], apart[-1, 0] = -0.02, 4.0, -1.0

    def made(name):
        q = theirs if name.startswith("rebound") else theirs + apart
        method = SimpleNamespace(label=name)
        s = SimpleNamespace(q=q, p=q, status="ok", reason="", seconds=1.0, method=method)
        return SimpleNamespace(run=lambda *of, **how: s)

    monkeypatch.setattr(wh, "integrator", made)
    monkeypatch.setattr(wh, "energy_error", lambda *of: 0.0)
    row = wh.pair("perturbed-kepler, e = 0.2", "wisdom-holman", 0.1)
    assert row["distance of early positions"] == pytest.approx(1e-3)
    assert row["distance of end positions"] == pytest.approx(0.05)


if __name__ == "__main__":
    extended.LADDER = (4, 16, 32)
    maps = {
        "both": ("tao-2", extended.BOTH),
        "one": ("tao-2", extended.ONE),
        "midpoint": ("extended-midpoint-2", extended.ONE),
    }
    rows = {name: extended.structure(*of) for name, of in maps.items()}
    rows |= {name: extended.orders(id) for name, id in (("special", extended.SPECIAL), ("jumped", extended.JUMPED))}
    print(json.dumps({"result": rows}))
