"""What studies judge on made-up rows; `test_studies` measures stored rows again."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks import report
from phasebench.benchmarks.judge.verdict import CONTRADICTED, HOLDS, MISSING, UNTESTABLE, WHERE
from phasebench.benchmarks.measure import canary
from phasebench.benchmarks.store import bench_canary
from phasebench.benchmarks.studies.catalogue import tables as transcribed
from phasebench.benchmarks.studies.costs import large, step
from phasebench.benchmarks.studies.costs.systems import SYSTEMS
from phasebench.benchmarks.studies.declared import matrix
from phasebench.benchmarks.studies.ensembles import against, maps
from phasebench.benchmarks.studies.models import measure as models
from phasebench.benchmarks.studies.molecules import water
from phasebench.benchmarks.studies.said.talks import statements
from phasebench.benchmarks.studies.said.talks.checks import PROBES
from phasebench.benchmarks.studies.said.talks.statements import CHECKS, PAGES, judge
from phasebench.integrators.compile.codegen import TUPLE_LIMIT
from phasebench.integrators.prepared import prepare
from support.commands import call
from support.pages import REPORTS

# -- what is declared --------------------------------------------------------------------------------------------------


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


# -- simplified models -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("scene", ["pendulum-0.5", "kepler-weak-perihelion", "jupiter-14-years", "fpu-soft-chain"])
def test_errors_of_simplified_models_are_those_stored(scene, monkeypatch):
    monkeypatch.setattr(models, "METHODS", models.METHODS[-1:])
    monkeypatch.setattr(models, "in_turns", lambda work, rounds: dict.fromkeys(work, np.ones(3)))
    stored = report.Data(REPORTS)("models").query("scene == @scene")["modelling error"]
    found = [row["modelling error"] for row in models.models_of(scene)["models"]]
    assert found == pytest.approx(stored.tolist(), rel=1e-6, abs=1e-12)


# -- molecules ---------------------------------------------------------------------------------------------------------


def test_errors_of_a_water_are_seen():
    x, v = water.start()
    rows = np.repeat(x[None], 40, axis=0), np.repeat(v[None], 40, axis=0)
    assert max(map(abs, water.errors(*rows).values())) < 1e-15
    rows[0][7] *= 1 + 1e-6
    assert abs(water.errors(*rows)["distances"] - 1e-6) < 1e-9
    rows[1][-4:] *= 1 + 1e-3
    assert abs(water.errors(*rows)["energy drift"] - 2e-3) < 1e-4
    assert water.errors(*rows)["angular momentum"] > 1e-4


# -- what others print and say -----------------------------------------------------------------------------------------


def test_a_changed_digit_of_a_transcribed_table_is_seen():
    table = transcribed.read()["SUNDIALS", "ARKODE_SPRK_YOSHIDA_6_8"]
    gamma = list(table.gamma)
    gamma[1] = gamma[1][:10] + ("1" if gamma[1][10] != "1" else "2") + gamma[1][11:]
    found = transcribed.check(replace(table, gamma=tuple(gamma)))
    assert (found["order"], found["digits that hold"] < 12) == ("0", True)
    done = call("audit", "--tables", "--package", "blackjax", "--json")
    assert (done.exit_code, {r["order"] for r in json.loads(done.stdout)}) == (0, {"2", "4"})
    assert call("audit", "--tables", "--package", "nothing").exit_code == 2


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


# -- costs and ensembles -----------------------------------------------------------------------------------------------


def test_rows_of_step_times_have_medians(monkeypatch):
    seconds = {"it": [9.0, 1.0, 2.0, 3.0], "stormer-verlet": [2.0, 9.0, 6.0], "C": [1.0, 3.0, 2.0]}
    monkeypatch.setattr(step, "time_in_turns", lambda work, rounds: {who: np.array(seconds[who]) for who in work})
    row = step.step("pendulum:swinging", "stormer-verlet")
    assert (row["ns per step"], row["ns, low"], row["ns, high"]) == (2.5e5, 1e5, 9e5)
    assert (row["status"], row["gradients per step"]) == ("ok", pytest.approx(1, abs=1e-3))
    monkeypatch.setattr(step, "_work", lambda *of: lambda: None)
    row = step.pair("Stormer-Verlet / C loop, kepler")
    assert [row[c] for c in ("median", "median, low", "median, high", step.WANTED)] == [3.0, 2.0, 3.0, 1.05]


def test_canary_sees_kernels_that_became_slower():
    stored = dict.fromkeys(canary.METHODS, 2.0)
    rows = [{"method": m, "ratio": 2.02} for m in canary.METHODS]
    assert canary.change(rows, stored.get) == pytest.approx(1.01)
    slower = [row | {"ratio": 2.6 if k % 3 else 2.0} for k, row in enumerate(rows)]
    assert canary.change(slower, stored.get) > canary.SAME
    assert canary.change(rows, {}.get) is None
    for few, told in ((slower, 1), (slower[:2], 0)):
        notes = []
        times = [r | {"ratio": 9e9} for r in few]
        bench_canary.bench_canary(SimpleNamespace(cells=[], failed={}, rows=lambda _, rows=times: rows), notes)
        assert len(notes) == told


# -- many degrees of freedom, ensembles --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SYSTEMS)
def test_c_and_python_integrate_alike_at_every_size(name):
    system = SYSTEMS[name]
    for d in (system.size(6), system.size(TUPLE_LIMIT + 4)):
        run, start = prepare(system.fastest_form(d), system.method), system.start(d)
        ends = system.prepare_c(d)(system.h, large.FEW)
        assert large.distance(run(system.h, large.FEW), ends) < 1e-14
        assert np.abs(ends[0] - start[0]).max() > 1e-10
    if name == "klein-gordon":
        other = replace(system, constants=lambda d: (4.001, 2.0))  # the control: the first is 4
        assert large.distance(run(system.h, large.FEW), other.prepare_c(d)(system.h, large.FEW)) > 1e-8


def test_error_is_that_of_the_worst_orbit():
    truth = np.zeros((3, 2))
    ends = np.array([[0.1, 0.0], [0.0, -0.5], [0.2, 0.3], [9.0, 9.0]])
    assert against.worst(ends, truth) == 0.5, "of those that are judged"
    ends[0, 0] = np.nan
    assert np.isnan(against.worst(ends, truth))


def test_starts_of_maps_lie_on_the_plane_at_their_energy():
    q2, p2 = np.random.default_rng(1).uniform(-0.2, 0.2, (2, 50))
    Q, P = maps.on_plane(q2, p2)
    energy = (P**2).sum(1) / 2 + (Q**2).sum(1) / 2 + Q[:, 0] ** 2 * Q[:, 1] - Q[:, 1] ** 3 / 3
    np.testing.assert_allclose(energy, maps.ENERGY, rtol=1e-14)
    assert (Q[:, 0] == 0).all()
    assert (P[:, 0] > 0).all()
