"""The main run's rows: truths and errors, sweeps of a scene, orders, and the stored tables with their bands."""

from __future__ import annotations

import json
from dataclasses import replace
from decimal import Decimal
from importlib import metadata
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.ladder import bench_errors, peer_rows, sweep
from phasebench.benchmarks.measure import accuracy
from phasebench.benchmarks.measure.orders import orders
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.scenes import BY_ID, DRIFT, ORDER, SCENES
from phasebench.benchmarks.store import error_tables
from phasebench.integrators.registry import METHODS
from phasebench.reference import files
from phasebench.reference.peers import BY_ID as PEERS
from phasebench.reference.peers import integrate_peer
from phasebench.reference.solvers import taylor

SCENE = BY_ID["lotka-volterra-t1"]
OSCILLATOR = BY_ID["oscillator-t2"]
KEPLER = problem("kepler")

# -- truths and errors -------------------------------------------------------------------------------------------------

REGULAR, CHAOTIC = (next(s for s in SCENES if s.regular is regular) for regular in (True, False))


@pytest.mark.parametrize(
    ("scene", "horizon", "times", "at", "source"),
    [
        (REGULAR, 2, (0.5, 1, 2), 1, accuracy.STORED),
        (REGULAR, 2, (0.5, 2), 1, accuracy.COMPUTED),
        (REGULAR, 0.5, (0.25, 1), 1, accuracy.COMPUTED),  # past the horizon it is not stored's
        (CHAOTIC, 0.5, (0.5, 1), 0.5, accuracy.STORED),
        (CHAOTIC, 9, (0.25, 2), 0.25, accuracy.STORED),  # nor past the scene's end
    ],
)
def test_truth_of_a_scene(monkeypatch, scene, horizon, times, at, source):
    """Of a regular scene it is at its end, of a chaotic one before the horizon (in units of the scene's span)."""
    end = scene.t_end
    ends = [SimpleNamespace(t=t * end, q_text=(f"{t}",), p_text=("0",), uncertainty=1e-20 * t) for t in times]
    certificate = SimpleNamespace(horizon=horizon * end, ends=ends) if times else None
    monkeypatch.setattr(accuracy.stored, "find", lambda problem: certificate)
    computed = lambda problem, t: accuracy.Truth(t, (), 0.0, t, accuracy.COMPUTED)  # noqa: E731
    monkeypatch.setattr(accuracy, "_compute_truth", computed)
    found = accuracy.truth.__wrapped__(scene.id)
    assert (found.t, found.source) == (at * end, source)
    if source == accuracy.STORED:
        assert (found.texts, found.uncertainty) == ((f"{at}", "0"), 1e-20 * at)
        assert found.horizon == min(horizon, 1) * end


def test_error_is_computed_without_round_off():
    true, tenth = accuracy.Truth(1.0, ("0.1", "-2"), 0.0, 1.0, accuracy.STORED), 0.1
    assert true.error([tenth, -2.0]) == float(abs(Decimal(tenth) - Decimal("0.1"))) > 0
    assert true.error([tenth, -2.5]) == 0.5


def test_trajectory_error_needs_a_row_within_the_horizon(monkeypatch):
    def measured(*times: float, horizon: float = 3.0) -> dict:
        told = accuracy.Truth(3.0, ("1", "0"), 1e-20, horizon, accuracy.STORED)
        monkeypatch.setattr(accuracy, "truth", lambda scene: told)
        rows = np.arange(len(times), dtype=float)[:, None]
        return accuracy.trajectory_error(REGULAR, SimpleNamespace(t=np.array(times), q=rows, p=0 * rows))

    found = measured(0.0, 1.0, 3.0 * (1 + 2e-16), 4.0)
    assert (found["global_error"], found["global_error_time"], found["reference_uncertainty"]) == (1.0, 3.0, 1e-20)
    assert measured(0.0, 2.0, 2.9) == measured(0.0) == {"reference_horizon": 3.0}
    assert measured(0.0, 3.0, horizon=2.0) == {"reference_horizon": 2.0}


def standing(n: int, late: float = 1.0, last: float = 1.0, status: str = "ok") -> dict:
    """Invariant errors of n equal Kepler rows, but p is ``late`` times as large after a tenth, ``last`` in the last."""
    scale = np.where(np.arange(n) < n // 10, 1.0, late)
    scale[-1] *= last
    q, p = np.tile(KEPLER.q0, (n, 1)), np.outer(scale, KEPLER.p0)
    rows = SimpleNamespace(t=np.linspace(0, 100.0, n), q=q, p=p, status=status)
    return accuracy.invariants(KEPLER, rows, 100.0)


def test_invariant_errors_have_columns_by_name():
    found = standing(400, late=1.01)
    kinetic = np.dot(KEPLER.p0, KEPLER.p0) / 2
    assert found["energy_max"] == found["energy_end"] == pytest.approx(kinetic * (1.01**2 - 1))
    assert found["energy_max_early"] == 0.0, "of the first twentieth"
    L = KEPLER.q0[0] * KEPLER.p0[1] - KEPLER.q0[1] * KEPLER.p0[0]
    assert found["angular-momentum_max"] == pytest.approx(0.01 * abs(L))
    assert {f"{name}_max" for name in KEPLER.invariants} <= found.keys()
    assert standing(400, last=np.nan)["energy_max"] == 0.0, "without what is not finite"
    slope = {"energy_drift", "energy_drift_low", "energy_drift_high"}
    assert [slope <= standing(n).keys() for n in (47, 48)] == [False, True]
    assert [standing(n).get("energy_max_early") for n in (200, 201)] == [None, 0.0], "ten steps in the first twentieth"
    assert not slope & standing(400, status="diverged").keys()


# -- scenes and rows ---------------------------------------------------------------------------------------------------


def test_every_method_and_peer_has_a_cell_on_every_scene():
    for quick in (False, True):
        cells = sweep.cells(quick)
        names = {(c.key["scene"], n) for c in cells for n in c.names}
        assert names >= {(s.id, x.id) for s in SCENES for x in (*METHODS, *peer_rows.swept())}
    handful = {c.key["method"] for c in cells if c.quick}
    assert {"stormer-verlet", "implicit-midpoint", "heyoka", "rebound-leapfrog"} <= handful
    assert len(handful) < 10
    full, quick = (sweep.tasks([SCENE], q, lambda m: m.id == "rk4") for q in (False, True))
    assert ([t.h for t in full], [t.h for t in quick]) == ([*SCENE.steps], [*SCENE.steps[:4]])


def measured(scene: str, id: str, h: float) -> dict:
    return sweep.measure(sweep.Task(scene, id, (), h), repeats=1)


@pytest.mark.parametrize(
    ("scene", "id", "h", "status", "reason"),
    [
        (SCENE.id, "avf", 0.12, "skipped", "canonical"),
        ("lotka-volterra-t120", "explicit-euler", 0.03, "diverged", "outside H's domain"),  # log of what is below 0
        ("escape", "explicit-euler", 1.0, "diverged", "h"),
    ],
)
def test_failed_row_has_its_reason_and_no_error(monkeypatch, scene, id, h, status, reason):
    more = {"id": "escape", "problem": "henon-heiles:chaotic", "t_end": 100.0, "steps": (1.0,)}
    monkeypatch.setitem(sweep.BY_ID, "escape", replace(BY_ID["henon-heiles-box-t1"], **more))
    row = measured(scene, id, h)
    assert (row["status"], reason in row["reason"]) == (status, True)
    assert not {"global_error", "energy_drift", "seconds"} & row.keys()
    assert {"scene", "problem", "method", "h", "versions"} <= row.keys()


#: Explicit, splitting, implicit and chosen roots, on short and long scenes; of those that agree on every processor.
ROWS = [
    ("henon-heiles-chaotic-t1", "rk4", 0.01),
    ("henon-heiles-chaotic-t1", "implicit-midpoint", 0.01),
    ("pendulum-t1000", "stormer-verlet", 0.05),
    ("pendulum-t1000", "implicit-midpoint", 0.1),
    ("kepler-t1", "stormer-verlet", 0.01),
    ("kepler-t1", "rk4", 0.01),
    (SCENE.id, "rk4", 0.03),
    (OSCILLATOR.id, "stormer-verlet", OSCILLATOR.steps[2]),
]


@pytest.mark.processor
@pytest.mark.parametrize(("scene", "id", "h"), ROWS)
def test_a_row_is_measured_as_it_is_stored(scene, id, h):
    row = measured(scene, id, h)
    assert (row["status"], row["reason"], row["fallbacks"]) == ("ok", "", 0)
    assert row["seconds"] > 0
    assert f"numpy {np.__version__}" in row["versions"]
    stored = table_of(scene)
    assert (stored["method"].eq(row["method"]) & stored["h"].eq(h)).any()
    assert regressions([row], stored, BY_ID[scene]) == []


# -- peers in a sweep --------------------------------------------------------------------------------------------------


def exactly(made, t, q, p):
    """Error of the doubles q, p at time t against an independent run in quadruple precision."""
    _, quad = taylor.extended_types()
    (row,) = taylor.states(made.system, quad, made.q0, made.p0, [t])
    return max(abs(float(quad(float(x)) - y)) for x, y in zip((*q, *p), row, strict=True))


ALIKE = {
    *("scene", "problem", "purpose", "method", "h", "t_end", "status", "kind", "versions", "tier", "declared_order"),
    *("steps", "gradient", "iterations", "fallbacks", "global_error", "global_error_time", "reference_uncertainty"),
    *("reference_horizon", "energy_max", "energy_end", "energy_drift", "angular-momentum_max", "seconds", "reason"),
}


@pytest.mark.parametrize(
    ("id", "size"),
    [
        ("heyoka", {"h": None, "tol": 1e-9}),
        ("rebound-ias15", {"h": None, "tol": 1e-6}),  # output shortens its steps; the error is that of a bare run
        ("rebound-leapfrog", {"h": np.pi / 60}),
    ],
)
def test_row_of_a_peer_has_the_columns_of_a_method(id, size):
    scene = BY_ID["kepler-100-orbits"]
    row = sweep.measure(sweep.Task(scene.id, id, (), **size), repeats=1)
    assert set(row) >= ALIKE
    assert set(sweep.measure(sweep.Task(scene.id, "rk4", (), np.pi / 60), repeats=1)) >= ALIKE
    assert (row["status"], row["id"], row["kind"]) == ("ok", id, PEERS[id].package)
    assert f"{PEERS[id].package} {metadata.version(PEERS[id].package)}" in row["versions"]
    assert row["h"] == size["h"]
    assert row["tol"] == size.get("tol")
    bare = integrate_peer(problem(scene.problem), id, **size, t_end=scene.t_end, save_every=0)
    error = exactly(problem(scene.problem), scene.t_end, bare.q[-1], bare.p[-1])
    assert row["global_error"] == pytest.approx(error, rel=1e-9)
    assert error > 1e-13
    assert row["steps"] == bare.counts["steps"]
    assert 0 < row["energy_max"] < 0.1
    assert json.loads(json.dumps(row)) == row


def test_unsuitable_peer_has_one_row_with_the_reason(monkeypatch):
    for id, why in (("rebound-whfast", "Kepler"), ("heyoka", "pip install heyoka")):
        if id == "heyoka":
            monkeypatch.setattr("phasebench.benchmarks.measure.integrator.is_installed", lambda name: False)
        todo = sweep.tasks([BY_ID["pendulum-t2"]], only=lambda m, id=id: m.id == id)
        row, *_ = sweep.measure_rows(todo[:1], 1)["rows"]
        assert (row["status"], row["method"]) == ("skipped", id)
        assert why in row["reason"]
        assert "global_error" not in row


# -- orders ------------------------------------------------------------------------------------------------------------


def ladder(order=2, uncertainty=1e-20, **more):
    """Fabricated rows of a method at seven step sizes with the error h^order."""
    base = {"purpose": ORDER, "scene": "s", "method": "m", "problem": "x", "status": "ok", "declared_order": order}
    base |= {"reference_uncertainty": uncertainty}
    return [base | {"h": h, "global_error": h**order} | more for h in (0.1 / 2**k for k in range(7))]


def test_order_of_a_power_law_and_its_window():
    (found,) = orders(ladder(order=3))
    assert found["order"] == pytest.approx(3)
    assert (found["h_first"], found["h_last"], found["points"], found["declared"]) == (0.1, 0.1 / 64, 7, 3)
    (found,) = orders(ladder(uncertainty=1e-7))
    assert (found["points"], found["h_last"]) == (5, 0.1 / 16), "errors of less than 100 uncertainties are left out"
    rows = ladder()
    for k, status in enumerate(("diverged", "skipped")):
        rows[k] |= {"status": status} | ({"global_error": None} if k else {})
    (found,) = orders(rows)
    assert (found["order"], found["h_first"], found["points"]) == (pytest.approx(2), 0.025, 5)
    rows = ladder(order=2) + ladder(order=4, method="n", uncertainty=1e-30) + ladder(purpose=DRIFT, scene="long")
    assert {r["method"]: round(r["order"]) for r in orders(rows)} == {"m": 2, "n": 4}


# -- stored tables -----------------------------------------------------------------------------------------------------

ORIGIN = {"made": "here", "n": 3}


def frame() -> pd.DataFrame:
    rows = [
        ("scheme-i(lam=1/3)", 0.1, 1.23456789012345e-7, 3.0, "ok"),
        ("avf", 1 / 3, np.nan, 4.0, "diverged"),
        ('a "quoted", one', np.nan, np.inf, 5.0, ""),
    ]
    return pd.DataFrame(rows, columns=["method", "h", "error", "steps", "status"])


@pytest.fixture
def stored(tmp_path):
    return error_tables.save("t", frame(), ORIGIN, tmp_path)


def test_table_is_loaded_to_the_last_digit(stored, tmp_path):
    back, origin = error_tables.load("t", tmp_path)
    pd.testing.assert_frame_equal(back, frame(), check_dtype=False, check_exact=True)
    assert origin == ORIGIN
    stored.write_bytes(stored.read_bytes().replace(b"\n", b"\r\n"))
    pd.testing.assert_frame_equal(error_tables.load("t", tmp_path)[0], frame(), check_dtype=False)
    texts = pd.DataFrame({"name": ["# made: 3", "nan", "NA", "d"], "status": [None, np.nan, "", "ok"]}, dtype=object)
    error_tables.save("t", texts, ORIGIN, tmp_path / "new" / "folder")
    back, _ = error_tables.load("t", tmp_path / "new" / "folder")
    assert back.to_numpy().tolist() == [["# made: 3", ""], ["nan", ""], ["NA", ""], ["d", "ok"]]


@pytest.mark.parametrize(
    ("ending", "change", "words"),
    [
        ("csv", lambda s: s.replace("1.23456789012345e-07", "1.23456789012346e-07"), "checksum"),
        ("csv", lambda s: "\x00", "checksum"),
        ("json", lambda s: "{", "its provenance beside it cannot be read"),
        ("json", lambda s: "[]", "its provenance beside it cannot be read"),
        ("json", lambda s: json.dumps(ORIGIN), "its provenance beside it cannot be read"),
    ],
    ids=["digit", "binary", "cut", "list", "no checksum"],
)
def test_table_that_was_edited_is_refused(stored, tmp_path, ending, change, words):
    path = stored.with_suffix(f".{ending}")
    text = path.read_text()
    assert change(text) != text
    path.write_text(change(text))
    with pytest.raises(error_tables.CorruptTable, match=words):
        error_tables.load("t", tmp_path)


def test_table_that_cannot_be_saved_leaves_the_old_one(stored, tmp_path, monkeypatch):
    before = stored.read_bytes()
    for name, origin in (("../t", {"a": 1}), ("t", {}), ("t", {"sha256": 1})):
        with pytest.raises(ValueError, match=r"name|provenance|sha256"):
            error_tables.save(name, frame(), origin, tmp_path)
    monkeypatch.setattr(files.os, "replace", lambda *a: (_ for _ in ()).throw(OSError("full")))
    with pytest.raises(OSError, match="full"):
        error_tables.save("t", frame().head(1), {"made": "there"}, tmp_path)
    assert stored.read_bytes() == before
    assert {p.name for p in tmp_path.iterdir()} == {"t.csv", "t.json"}


def test_provenance_follows_the_problem():
    def changed(made) -> list[str]:
        old, new = (error_tables.provenance(p, scene="x") for p in (problem("perturbed-kepler"), made))
        assert (old["scene"], old["numpy"]) == ("x", np.__version__)
        return [k for k in old if old[k] != new[k]]

    made = problem("perturbed-kepler")
    assert changed(made) == []
    assert "formulae" in changed(problem("perturbed-kepler", mu=0.0076))
    for other in (replace(made, orbits=(replace(made.start, p=(0.0, 2.5)),)), problem("perturbed-kepler", e=0.5)):
        assert "initial data" in changed(other)
        assert "formulae" not in changed(other)


# -- bands -------------------------------------------------------------------------------------------------------------


def regressions(measured, stored, scene=SCENE):
    rows = measured if isinstance(measured, list) else records(measured)
    return bench_errors.regressions(rows, stored, scene)


def table_of(scene):
    return error_tables.load(scene)[0]


def records(table):
    return table.astype(object).where(table.notna(), None).to_dict("records")


@pytest.mark.parametrize("column", ["global_error", "refinement_difference", "energy_max"])
def test_number_outside_its_band_is_reported(column):
    stored = table_of(SCENE.id)
    measured = stored.copy()
    measured["global_error"] *= 1 + 0.5 * SCENE.relative
    assert regressions(measured, stored) == [], "within its band"
    measured = stored.copy()
    row = measured.index[(measured["method"] == "rk4") & measured[column].notna()][-1]
    old = measured.loc[row, column]
    measured.loc[row, column] = new = old * 1.01
    (found,) = regressions(measured, stored)
    assert (*found.key, found.column) == ("rk4", str(measured.loc[row, "h"]), column)
    assert (found.measured, found.stored, found.ratio) == (new, old, pytest.approx(1.01))


def test_band_of_methods_that_choose_a_root():
    """A larger change of the trajectory's error than usual is accepted, but not of the energy error."""
    scene = BY_ID["kepler-t1"]
    stored = table_of(scene.id)
    row = stored.index[(stored["method"] == "scheme-iv") & (stored["global_error"] > 1e-6)][0]
    stored.loc[row, "energy_max"] = 1e-6
    for column, factor, found in (("global_error", 1.3, 0), ("global_error", 1.7, 1), ("energy_max", 1.3, 1)):
        measured = stored.copy()
        measured.loc[row, column] *= factor
        assert [d.column for d in regressions(measured, stored, scene)] == [column] * found


def test_new_table_keeps_unmeasured_methods():
    stored = table_of(SCENE.id)
    some = [r | {"global_error": 7.0} for r in records(stored) if r["method"] == "rk4"]
    gone = pd.concat([stored, stored[stored["method"] == "rk4"].assign(method="nobody")])
    for new in (bench_errors.record(some, stored, SCENE), bench_errors.record(some, gone, SCENE)):
        assert new["method"].tolist() == stored["method"].tolist()
        others = new["method"] != "rk4"
        assert (new[~others]["global_error"] == 7.0).all()
        assert (new[others]["global_error"].dropna() == stored[others]["global_error"].dropna()).all()
