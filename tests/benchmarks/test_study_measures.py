"""What studies measure, where the answer is known otherwise: closed forms, plain runs, published columns and tables."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise
from math import atan2, hypot, pi
from types import SimpleNamespace

import mpmath
import numpy as np
import pandas as pd
import pytest
import sympy as sp
from scipy.integrate import solve_ivp

from phasebench.benchmarks import report
from phasebench.benchmarks.judge.evidence import NO_DEFECT
from phasebench.benchmarks.judge.verdict import CONTRADICTED, HOLDS, MISSING, UNTESTABLE, WHERE
from phasebench.benchmarks.ladder import choice as ladder_choice
from phasebench.benchmarks.measure import every_problem
from phasebench.benchmarks.measure.declared import least_visible
from phasebench.benchmarks.measure.timing import NONE, OURS, PEERS, TIED
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.models import one_body, springs
from phasebench.benchmarks.studies import constraints, extended, printed, rigid, sampling
from phasebench.benchmarks.studies.catalogue import tables as transcribed
from phasebench.benchmarks.studies.declared import matrix
from phasebench.benchmarks.studies.extremes import encounters
from phasebench.benchmarks.studies.models import choice
from phasebench.benchmarks.studies.molecules import argon, water
from phasebench.benchmarks.studies.options import nodes, solvers
from phasebench.benchmarks.studies.said import minimum_norm
from phasebench.benchmarks.studies.said.talks import statements
from phasebench.benchmarks.studies.said.talks.checks import PROBES
from phasebench.benchmarks.studies.said.talks.statements import CHECKS, PAGES, judge
from phasebench.benchmarks.studies.statistics import measure as statistics
from phasebench.benchmarks.studies.statistics import scenes
from phasebench.benchmarks.studies.trade import joined, trade
from phasebench.integrators.compile.codegen import precision
from phasebench.integrators.driver import integrate
from phasebench.integrators.registry import BY_ID
from support import cells
from support.commands import call
from support.needs import need
from support.pages import REPORTS

# -- what is declared --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def matrix_rows(uncompiled):
    rows = uncompiled("support/cells.py")
    return {(r["method"], r["problem"]): r for r in rows}


def test_rows_of_every_method_on_every_problem(matrix_rows):
    """A number or its reason; the measured order is the declared one, and nothing declared is contradicted."""
    assert len(matrix_rows) == len(cells.METHODS) * len(cells.PROBLEMS)
    for row in matrix_rows.values():
        assert row.get("reason") or all(k in row or f"{k}_reason" in row for k in every_problem.MEASURED), row
        assert abs(row.get("order", BY_ID[row["method"]].order) - BY_ID[row["method"]].order) < 0.1, row
        assert not matrix.contradictions(row)
    assert sum("order" in row for row in matrix_rows.values()) >= 10
    assert matrix_rows["wisdom-holman", "kepler"]["order_reason"] == "exact"
    for name in ("symplecticity", "reversibility"):
        assert matrix_rows["stormer-verlet", "pendulum"][name] < NO_DEFECT
        assert matrix_rows["rk4", "pendulum"][name] > 1e6 * NO_DEFECT
    assert matrix_rows["avf", "kepler"]["energy"] < 1e-14 < matrix_rows["gauss-2", "kepler"]["energy"]
    assert matrix_rows["gauss-2", "kepler"]["quadratic"] < 1e-14 < matrix_rows["avf", "kepler"]["quadratic"]
    made = problem("kepler")
    run = integrate(made, "gauss-2", h=float(every_problem.STEP) * made.pace.unit, steps=every_problem.RUN)
    error = np.abs(run.energy() - run.energy()[0]).max()
    assert error / 50 < matrix_rows["gauss-2", "kepler"]["energy"] < error / 4, "in units of H's terms, 2.5 and 2"


CELL = {"method": "rk4", "problem": "pendulum", "declared_order": 4, "order": 4.0, "symplectic": True,
        "symmetric": True, "symplecticity": 0.0, "reversibility": 0.0, "energy_class": "round-off",
        "quadratic_class": "round-off", "energy": 0.0, "quadratic": 0.0}  # fmt: skip


@pytest.mark.parametrize(
    ("column", "good", "bad", "undeclared"),
    [
        ("order", 3.91, 3.89, {}),
        ("symplecticity", 0.9e-22, 1.1e-22, {"symplectic": False}),
        ("reversibility", 0.9e-22, 1.1e-22, {"symmetric": False}),
        ("energy", 199 * 2.0**-52, 201 * 2.0**-52, {"energy_class": "bounded"}),
        ("quadratic", 199 * 2.0**-52, 201 * 2.0**-52, {"quadratic_class": "drift"}),
    ],
)
def test_a_row_is_compared_with_what_is_declared(column, good, bad, undeclared):
    assert not matrix.contradictions(CELL | {column: good})
    assert len(matrix.contradictions(CELL | {column: bad})) == 1
    assert bool(matrix.contradictions(CELL | {column: np.inf})) == (column != "order")
    assert not undeclared or not matrix.contradictions(CELL | undeclared | {column: 1.0})


def test_high_orders_are_seen_by_their_digits():
    """Gauss of order 16 is measured in 128 digits, and a processed method is nearly symmetric."""
    assert least_visible("gauss-8-field", "symmetry") == pytest.approx(1e-64)
    assert [least_visible("rk4", name) for name in ("symplecticity", "symmetry")] == [1e-22, 1e-22]
    processed = [least_visible("blanes-casas-murua-p11-6", name) for name in ("symplecticity", "symmetry")]
    assert processed == [1e-22, 1e-25]


# -- options -----------------------------------------------------------------------------------------------------------


def test_avf_with_one_node_is_the_midpoint_rule():
    made = problem("pendulum:swinging")
    one, own, three = (nodes.Run(made, n, 0.1) for n in (1, nodes.CONFIRMED, 3))
    assert all((one(), own(), three()))
    midpoint = integrate(made, "implicit-midpoint", h=0.1, steps=nodes.STEPS)
    assert np.abs(one.Q - midpoint.q[1:]).max() < 1e-10
    assert own.energy_error() < 1e-14 < 1e-4 < one.energy_error()
    assert 1e-13 < three.energy_error() < 1e-10, "no rule that it confirms itself"


@pytest.mark.parametrize("start", [solvers.ZERO, solvers.FIVE])
@pytest.mark.parametrize("solver", [solvers.FIXED, solvers.SIMPLE, solvers.NEWTON])
def test_every_solver_and_start_gives_the_same_step(solver, start):
    made, h, steps = problem("henon-heiles:box"), 0.2, 10
    field = made.system.vector_field()
    loop = solvers.Loop(lambda y: field(0.0, y), np.array([*made.q0, *made.p0]), h, solver, start, solvers.ROUND_OFF)
    assert loop.run(steps)
    own = integrate(made, solvers.METHOD, h=h, steps=steps, save_every=0)
    assert np.abs(loop.y - np.concatenate([own.q[-1], own.p[-1]])).max() < 1e-14


# -- statistics of chaotic orbits --------------------------------------------------------------------------------------


@pytest.mark.parametrize("id", [id for id, s in scenes.SCENES.items() if s.known])
def test_starts_lie_on_the_surface_and_an_ensemble_keeps_its_average(id):
    """By Gauss's method an ensemble keeps the exact average; by explicit Euler at the same step it does not."""
    scene = scenes.SCENES[id]
    q, p = scenes.start(replace(scene, orbits=2000))
    assert np.abs(problem(scene.problem).system.energies(q, p) - scene.energy).max() < 1e-10
    few = replace(scene, orbits=64, span=scene.span / 10)
    for method in ("gauss-4", *(["explicit-euler"] if id == "henon-heiles-mean" else [])):
        found = statistics.sums(few, method, 8)
        mean, error = statistics.statistic(found.total, found.number)
        assert (abs(mean - scenes.exact(few)) < 4 * error) == (method == "gauss-4")


def test_exact_averages_of_a_harmonic_oscillator_are_known(monkeypatch):
    """At a small energy Henon-Heiles is an oscillator: <q2^2> = E / 2, and crossings are uniform in a disc.

    A cap beyond half of the radius is 1/3 - sqrt(3) / (4 pi) of the disc, but 1/4 of its width.
    """
    monkeypatch.setitem(scenes.BOXES, "henon-heiles", 2e-3)
    mean = replace(scenes.SCENES["henon-heiles-mean"], energy=1e-6, formula="q2**2")
    cap = replace(mean, kind=scenes.SECTION, plane="q1", formula=f"q2 - {np.sqrt(5e-7)}")
    for scene, value in ((mean, 5e-7), (cap, 1 / 3 - np.sqrt(3) / (4 * np.pi))):
        assert abs(scenes.exact(scene) / value - 1) < 2e-3


def test_a_share_of_crossings_counts_crossings_and_not_orbits():
    """An orbit that crosses more often counts more; the error is that of the ratio (Cochran 1977, section 6.4)."""
    rng = np.random.default_rng(5)
    number = rng.integers(1, 40, 400).astype(float)
    total = rng.binomial(number.astype(int), np.where(number > 20, 0.8, 0.3)).astype(float)
    value, error = statistics.statistic(total, number)
    assert value == total.sum() / number.sum()
    assert abs(value - (total / number).mean()) > 5 * error  # the mean over orbits is another number
    drawn = rng.integers(0, 400, (2000, 400))
    spread = (total[drawn].sum(axis=1) / number[drawn].sum(axis=1)).std()
    assert abs(error / spread - 1) < 0.1


# -- simplified models -------------------------------------------------------------------------------------------------


def solve_with_scipy(made, t_end, **more):
    """SciPy's solution (DOP853, rtol 1e-12) of a problem to ``t_end``."""
    s = made.system
    f = sp.lambdify((*s.q, *s.p), [*s.dq, *s.dp], cse=True)
    y0 = [*made.q0, *made.p0]
    return solve_ivp(lambda t, y: f(*y), (0, t_end), y0, method="DOP853", rtol=1e-12, atol=1e-34, **more)


def end(made, t_end):
    return solve_with_scipy(made, t_end).y[: made.system.d, -1]


def test_averaged_model_is_first_order_in_mu():
    """The averaged model's radial period and advance are wrong by O(mu^2), the Kepler model's period by O(mu)."""

    def turning(t, y):
        return y[0] * y[2] + y[1] * y[3] if t > 4 else -1.0  # after the apocentre

    turning.direction, turning.terminal, wrong = 1, True, {}
    for mu in (1e-3, 1e-4):
        averaged = one_body.kepler_models(0.3, mu)[2]
        period = 2 * pi * one_body.mean_semi_axis(0.3, mu) ** 1.5 / averaged.rate
        one = np.array([[1.0, 0.0]])
        (x, y), _ = (z[0] for z in averaged.lift(None, np.array([period]), one, one))
        found = solve_with_scipy(problem("perturbed-kepler", e=0.3, mu=mu), 20.0, events=turning)
        t, (u, v) = found.t_events[0][0], found.y_events[0][0][:2]
        wrong[mu] = abs(period - t), abs(atan2(y, x) - atan2(v, u)), abs(2 * pi - t)
        made = averaged.make()
        assert hypot(*made.q0) * hypot(*made.p0) == pytest.approx((1 - 0.3**2) ** 0.5, rel=1e-14)
    ratios = np.array(wrong[1e-3]) / np.array(wrong[1e-4])
    assert (ratios[:2] > 60).all()
    assert 8 < ratios[2] < 12


def test_soft_chain_is_accurate_to_its_order_in_omega():
    """The model's error times omega^2 falls with omega if the model has all terms of that order; else it stays."""
    far = {}
    for omega in (50.0, 150.0):
        true = end(problem("fpu", omega=omega), 2.0)[:3]
        far[omega] = [omega**2 * np.abs(end(springs.soft_chain(k, omega), 2.0) - true).max() for k in range(3)]
    ratios = np.array(far[50.0]) / np.array(far[150.0])
    assert ratios[2] > 2
    assert (abs(ratios[:2] - 1) < 0.3).all()


def test_cheapest_sufficient_model_is_chosen():
    """A run of a model with error 10^-n takes 1, 2 or 10 times n seconds."""
    names, errors = ("least", "middle", "full"), (1e-2, 1e-5, 0.0)
    rows = [
        {"scene": "s", "rung": k, "model": m, "full": m == "full", "d": 1, "modelling error": e, "uncertainty": 1e-15}
        | {"integration": 1e-13 if m == "full" else 1e-14, "source": "certified"}
        for k, (m, e) in enumerate(zip(names, errors, strict=True))
    ]
    runs = [
        {"scene": "s", "rung": k, "method": "m", "steps": n, "error": 10.0**-n, "seconds": s * n}
        for k, s in enumerate((1.0, 2.0, 10.0))
        for n in range(1, 13)
    ]
    chosen = {a: choice.at(pd.DataFrame(rows), pd.DataFrame(runs), a) for a in (1e-1, 1e-3, 1e-6, 1e-14)}
    assert chosen[1e-1] == ("least", 10 / 2, False)  # one finer step: less than 1e-1 is left to the integration
    assert chosen[1e-3] == ("middle", 30 / 8, False)
    assert chosen[1e-6] == ("full", 1.0, True)
    assert chosen[1e-14][0] == "none"


# -- molecules ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [argon.OURS, "openmm", "ase"])
def test_packages_report_the_energy_of_the_same_orbit_and_keep_a_rigid_water(monkeypatch, name):
    if name != argon.OURS:
        need(name)
    for module, steps, every in ((argon, 1000, 10), (water, 100, 1)):
        monkeypatch.setattr(module, "STEPS", steps)
        monkeypatch.setattr(module, "EVERY", every)
    if name in argon.ENGINES:
        row, own = (argon.measure(n, argon.BEST) for n in (name, argon.OURS))
        assert abs(row["mean"] / own["mean"] - 1) < 1e-7
        assert abs(row["spread"] / own["spread"] - 1) < 1e-3
    row = water.measure(name, argon.BEST)
    bound = 1e-7 if name == "openmm" else 1e-11  # it holds a water's distances in single precision
    assert max(row["distances"], row["angular momentum"], abs(row["energy drift"])) < bound


def test_errors_of_a_water_are_seen():
    x, v = water.start()
    rows = np.repeat(x[None], 40, axis=0), np.repeat(v[None], 40, axis=0)
    assert max(map(abs, water.errors(*rows).values())) < 1e-15
    rows[0][7] *= 1 + 1e-6
    assert abs(water.errors(*rows)["distances"] - 1e-6) < 1e-9
    rows[1][-4:] *= 1 + 1e-3
    assert abs(water.errors(*rows)["energy drift"] - 2e-3) < 1e-4
    assert water.errors(*rows)["angular momentum"] > 1e-4


# -- the trade between cost and error ----------------------------------------------------------------------------------


def random_sweeps(scatter: float, seed: int, count: int = 200):
    """(times of the first sweep, rows of two more) of integrators whose median times scatter between sweeps."""
    rng = np.random.default_rng(seed)
    finals, times = [], []
    for k in range(count):
        for side, name, mean in ((OURS, "a", 1.0), (OURS, "b", 1.2), (PEERS, "c", 2.0)):
            seconds = 1e-3 * mean * np.exp(rng.normal(0, scatter, 3))
            key = {"scene": f"s{k}", "accuracy": 1e-3, "side": side, "integrator": name}
            finals.append(key | {"seconds": seconds[0], "low": seconds[0], "high": seconds[0], "steps": k})
            times += [key | {"sweep": s, "seconds": seconds[s - 1]} for s in (2, 3)]
    return pd.DataFrame(finals), pd.DataFrame(times)


@pytest.mark.parametrize("scatter", [0.005, 0.1])
def test_intervals_of_joined_sweeps_cover_a_third_one(scatter, monkeypatch):
    shares = pd.DataFrame([joined.coverage(*random_sweeps(scatter, seed)) for seed in range(8)]).mean()
    assert ((shares > 0.93) & (shares < 0.975)).all()
    monkeypatch.setattr(joined, "LEVEL", 0.0)
    assert (joined.coverage(*random_sweeps(0.1, 0)) < 0.6).all(), "the control: without the scatter between sweeps"


def case(accuracy=1e-6, steps=(100, 50), seconds=(1e-5, 2e-5), spread=0.01, **more):
    """A made-up case; pairs are (our best method, the best peer), steps None for a side that does not get there."""
    out = {"scene": "toda", "quantity": "end-state", "accuracy": accuracy, f"{OURS} evaluations": 800}
    for side, n, s in zip((OURS, PEERS), steps, seconds, strict=True):
        known = {"integrator": f"one of {side}", "h": 0.1, "tol": np.nan, "steps": n, "seconds": s}
        out |= {f"{side} {k}": v if n is not None else np.nan for k, v in known.items()}
    ratio = seconds[0] / seconds[1] if None not in steps else np.nan
    return out | {"ratio": ratio, "ratio low": ratio * (1 - spread), "ratio high": ratio * (1 + spread)} | more


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (case(), OURS),
        (case(seconds=(2e-5, 1e-5)), PEERS),
        (case(**{"ratio low": 0.93, "ratio high": 0.95}), OURS),
        (case(**{"ratio low": 0.9, "ratio high": 0.99}), TIED),
        (case(**{"ratio low": 1.04, "ratio high": 1.2}), TIED),
        (case(**{"ratio low": 0.1, "ratio high": 3.0}), TIED),
        (case(steps=(100, None)), OURS),
        (case(steps=(None, 50)), PEERS),
        (case(steps=(None, None)), NONE),
    ],
)
def test_cheaper_side(given, expected):
    found = ladder_choice.choices(pd.DataFrame([given]))
    assert found["cheaper"].tolist() == [expected]
    assert trade.counts(found) == tuple(int(expected == x) for x in (OURS, PEERS, TIED))
    named = {PEERS: "one of peer", NONE: ""}.get(expected, "one of ours")
    assert ladder_choice.winner(found.iloc[0]) == named


# -- what others print and say -----------------------------------------------------------------------------------------

#: The talk's columns, copied from it independently.
TALK = """
4.31E-03 2.09E-03 1.03E-03 5.13E-04   4.38E-04 2.23E-04 1.12E-04 5.63E-05   2.63E-03 1.34E-03 6.73E-04 3.38E-04
3.85E-03 1.98E-03 1.00E-03 5.06E-04   5.09E-04 1.25E-04 3.11E-05 7.74E-06   2.35E-05 5.87E-06 1.47E-06 3.67E-07
2.24E-04 5.67E-05 1.42E-05 3.57E-06   4.77E-04 1.21E-04 3.06E-05 7.68E-06   1.12E-04 2.79E-05 6.97E-06 1.74E-06
3.54E-06 8.84E-07 2.21E-07 5.52E-08   5.04E-05 1.26E-05 3.15E-06 7.88E-07   1.18E-04 2.94E-05 7.34E-06 1.84E-06
1.78E-05 4.46E-06 1.11E-06 2.78E-07   2.50E-03 1.24E-03 6.22E-04 3.10E-04   4.23E-06 1.06E-06 2.64E-07 6.60E-08
"""


def test_printed_columns_equal_the_talks():
    assert [entry for column in printed.PRINTED.values() for entry in column] == TALK.split()
    assert all(1.8 < float(a) / float(b) < 4.3 for column in printed.PRINTED.values() for a, b in pairwise(column))


@pytest.mark.parametrize(
    ("package", "name", "order", "digits"),
    [
        ("SUNDIALS", "ARKODE_SPRK_RUTH_3_3", "3", None),
        ("SUNDIALS", "ARKODE_SPRK_YOSHIDA_6_8", "6", 0),
        ("REBOUND", "SABA, ABA(8,6,4)", "8,6,4", 10),
        ("OpenMM", "Suzuki-Yoshida weights, 3", "2", 14),
        ("OrdinaryDiffEq.jl", "McAte42", "1", 0),
        ("diffrax", "Dopri8", "8", None),
    ],
)
def test_orders_and_lost_digits_of_transcribed_tables(package, name, order, digits):
    """Exact numbers, printed ones, rational approximations; tables with a wrong sequence or a wrong exponent."""
    found = transcribed.check(transcribed.read()[package, name])
    assert found["order"] == order
    assert (None if digits is None else found["digits printed"] - found["digits that hold"]) == digits


def test_transcribed_tables_are_consistent_and_a_changed_digit_is_seen():
    known = transcribed.read()
    for table in known.values():
        assert all((table.line > 0, table.commit, table.date[:2] == "20", table.expected)), table
        if table.kind == transcribed.COMPOSITION:
            with mpmath.workdps(60):
                assert abs(sum(table.steps()) - 1) < 1e-9, table
    table = known["SUNDIALS", "ARKODE_SPRK_YOSHIDA_6_8"]
    gamma = list(table.gamma)
    gamma[1] = gamma[1][:10] + ("1" if gamma[1][10] != "1" else "2") + gamma[1][11:]
    found = transcribed.check(replace(table, gamma=tuple(gamma)))
    assert (found["order"], found["digits that hold"] < 12) == ("0", True)
    done = call("audit", "--tables", "--package", "blackjax", "--json")
    assert (done.exit_code, {r["order"] for r in json.loads(done.stdout)}) == (0, {"2", "4"})
    assert call("audit", "--tables", "--package", "nothing").exit_code == 2


@pytest.mark.parametrize("id", [minimum_norm.LEAPFROG, minimum_norm.MINIMUM_NORM])
@pytest.mark.parametrize("first", [minimum_norm.POSITIONS, minimum_norm.MOMENTA])
def test_rms_on_the_oscillator_is_that_of_the_step_matrix(id, first):
    """z'(M'M - 1)z / 2 for Gaussian z."""
    lam = 0.19318332750378357396
    substeps = [("A", 0.5), ("B", 1.0), ("A", 0.5)]
    if id == minimum_norm.MINIMUM_NORM:
        substeps = [("A", lam), ("B", 0.5), ("A", 1 - 2 * lam), ("B", 0.5), ("A", lam)]
    step = np.eye(2)
    for letter, c in substeps:
        step = (np.array([[1, c / 8], [0, 1]]) if letter == "A" else np.array([[1, 0], [-c / 8, 1]])) @ step
    M = np.linalg.matrix_power(step, 8)
    S = M.T @ M - np.eye(2)
    d, weights = minimum_norm.jumps("oscillator", id, first, 1.0, 8)
    rms = np.sqrt((2 * np.trace(S @ S) + np.trace(S) ** 2) / 4)
    assert np.sqrt(weights @ d**2) == pytest.approx(rms, rel=1e-9)
    assert weights @ np.expm1(-d) == pytest.approx(0, abs=1e-12)


#: What makes a statement of the talks fail, by column.
BAD = dict.fromkeys(("defect", "energy", "symplecticity", "largest", "two-form", "total energy error"), 1.0)
BAD |= dict.fromkeys(("invariant error", "angular momentum error", "energy error"), 1.0)
BAD |= {"value": 1e3, "order": 17.0, "units": 99.0, "median": 9.0, "x": "1 2 3 4", "y": "2 1 1 1"}


@pytest.fixture(scope="module")
def talks():
    """The committed tables, and with wrong values in these columns."""
    known = report.Data(REPORTS)

    def changed(columns, name):
        frame = known(name)
        here = {c: x for c, x in columns.items() if c in frame and (c != "status" or "figure" in frame)}
        return frame.assign(**{c: range(len(frame)) if x is None else x for c, x in here.items()})

    wrong = BAD | {"status": "diverged", "area": None, "measure": None}
    of = {}, wrong | {"energy_error": 1e-9}, wrong | {"energy_error": 1e9}, dict.fromkeys(BAD, 0.0)
    return [lambda name, columns=columns: changed(columns, name) for columns in of]


@pytest.mark.parametrize(
    "statement", [pytest.param(x, id=f"{page}-{x[1]}") for page, of in PAGES.items() for x in of["said"]]
)
def test_wrong_rows_change_the_verdict_on_a_statement(statement, talks):
    parts = statement[5:]
    before, *after = (judge(tables, parts).verdict for tables in talks)
    assert before != MISSING
    assert CONTRADICTED in after or before == UNTESTABLE
    assert judge(lambda name: None, parts).verdict in (MISSING, UNTESTABLE)


@pytest.mark.parametrize(
    ("entry", "good", "bad"),
    [
        ({"printed": "avf"}, {"units": [0.5, 0.59]}, {"units": [0.5, 0.61]}),
        ({"symmetric": "avf"}, {"defect": [0.0, 9e-23]}, {"defect": [0.0, 2e-22]}),
        ({"energy": "avf"}, {"energy": [0.0, 9e-12]}, {"energy": [0.0, 2e-11]}),
        ({"check": "species", "at_most": 0.5}, {"value": [-0.5], "control": 0.6}, {"value": [-0.6], "control": 0.7}),
        ({"check": "species", "at_most": 0.5}, {"value": [0.5], "control": 0.6}, {"value": [0.5], "control": 0.4}),
    ],
)
def test_bounds_of_judges(entry, good, bad):
    shared = {"scheme": "avf", "method": "avf", "property": "symmetry", "problem": "henon-heiles", "check": "species"}
    shared |= {"what": "a", "against": "b"}
    for rows, verdict in ((good, HOLDS), (bad, CONTRADICTED)):
        frame = pd.DataFrame(rows).assign(**shared)
        assert judge(lambda name, frame=frame: frame, [entry]).verdict == verdict


def test_the_worst_verdict_counts_and_a_condition_is_stated():
    rows = {"check": ["good", "bad"], "value": [0.0, 1.0], "control": 9.0, "what": "a", "against": "b"}
    good, bad, missing = ({"check": name, "at_most": 0.5} for name in ("good", "bad", "none"))

    def verdict(*entries):
        return judge(lambda name: pd.DataFrame(rows), entries).verdict

    assert [verdict(good, x) for x in (good, bad, missing)] == [HOLDS, CONTRADICTED, MISSING]
    for inside, outside, expected in ((good, bad, WHERE), (good, good, HOLDS), (bad, bad, CONTRADICTED),
                                      (bad, good, CONTRADICTED), (good, missing, MISSING)):  # fmt: skip
        assert verdict({"condition": "x > 0", "judged": [inside], "otherwise": [outside]}) == expected


#: The checks that compile no kernel, and two that do.
QUICK = (*(id for id, probe in PROBES.items() if not probe.methods), "form-third", "adjoint")


@pytest.mark.parametrize("id", QUICK)
def test_a_check_reproduces_its_committed_row(id):
    then = report.Data(REPORTS)(CHECKS).set_index("check").loc[id]
    now = statements.probe(id)
    assert now["control"] == pytest.approx(then["control"], rel=1e-6, abs=1e-12)
    assert now["value"] == pytest.approx(then["value"], rel=1e-6, abs=1e-9)


# -- single studies ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("share", "left"), [(0.9, 0), (1.1, 1)])
def test_the_longest_run_of_an_encounter_is_left_out_where_it_cannot_suffice(monkeypatch, share, left):
    """An error of order 2 + 1 falls by the ratio of the last two rungs to the third power."""
    *_, before, last = encounters.LADDER
    made = []

    def climb(*of):
        for rung in encounters.LADDER:
            made.append(rung)
            yield rung, SimpleNamespace(status="ok", counts={"steps": rung})

    monkeypatch.setattr(encounters, "climb", climb)
    monkeypatch.setattr(encounters, "ECCENTRICITIES", (0.5,))
    monkeypatch.setattr(encounters, "error", lambda s, far: share * encounters.HELD * (last / before) ** 3)
    encounters.kepler("stormer-verlet")
    assert made == [*encounters.LADDER][: len(encounters.LADDER) - left]


def test_plain_rattle_iterated_to_round_off_is_rattle():
    made = problem(constraints.SPHERE)
    plain = constraints.loose_rattle.py_func
    energy, iterations = plain(np.array(made.q0), np.array(made.p0), 0.05, 20, 1, 1e-15)
    s = integrate(made, "rattle", h=0.05, steps=20)
    assert np.abs(energy - s.energy()).max() < 1e-14
    loose, fewer = plain(np.array(made.q0), np.array(made.p0), 0.05, 20, 1, 1e-4)
    assert np.abs(loose - s.energy()).max() > 1e-9
    assert fewer < iterations


def test_the_orbit_in_extended_phase_space_is_that_of_the_schwarzschild_problem():
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


def test_an_angle_is_that_of_the_turn_between_attitudes():
    half = np.radians(15.0)
    q, turn = np.array([1.0, 0, 0, 0]), np.array([np.cos(half), 0, np.sin(half), 0])
    assert [rigid.angle(q, x) for x in (turn, -3 * turn, q)] == pytest.approx([30.0, 30.0, 0.0], rel=1e-14)


def test_acceptance_by_stormer_verlet_is_that_of_a_plain_run():
    """Stormer-Verlet in NumPy from the same draws, which have the moments of the target."""
    budget, n = 48, 2000
    q, p = sampling.draws("quartic", n)
    omega, h = 2.0 * np.arange(1, sampling.D + 1), sampling.TIME / budget
    x = np.linspace(-8, 8, 4001)
    density = np.exp(-(x**2 / 2 + x**4 / 4))
    squares = (q * omega) ** 2
    assert abs(squares.mean() - (x**2 * density).sum() / density.sum()) < 4 * squares.std() / np.sqrt(squares.size)
    assert abs((p**2).mean() - 1) < 4 * np.sqrt(2 / p.size)

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
