"""Rows of a sweep against the reference up to its horizon, and the rows of peers."""

from __future__ import annotations

import json
import re
import tomllib
from dataclasses import replace
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest

from phasebench.benchmarks.experiments.trade import bench_errors, peer_rows, sweep
from phasebench.benchmarks.measure import accuracy
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.scenes import BY_ID, ORDER, SCENES
from phasebench.integrators import integrate
from phasebench.reference.certificates import stored as certified
from phasebench.reference.peers import BY_ID as PEERS
from phasebench.reference.peers import Peer, integrate_peer
from phasebench.reference.solvers import taylor

SCENE = BY_ID["lotka-volterra-t1"]
CHAOTIC = next(s for s in SCENES if not s.regular)


def test_a_regular_scene_is_measured_at_its_end():
    assert all(accuracy.reference(s.id).horizon() == s.t_end for s in SCENES if s.regular and s.purpose == ORDER)
    row = sweep.measure(sweep.Task(SCENE.id, "rk4", (), 0.03), repeats=1)
    assert (row["reference_horizon"], row["global_error_time"]) == (SCENE.t_end, SCENE.t_end)
    truth = taylor.reference(SCENE.made(), [SCENE.t_end])
    assert row["reference_uncertainty"] == truth.uncertainty[-1]


@pytest.mark.parametrize(("id", "size"), [("stormer-verlet", {"h": 0.05}), ("heyoka", {"h": None, "tol": 1e-15})])
def test_a_chaotic_trajectory_is_measured_at_the_horizon_of_the_reference(id, size):
    """Not later: the uncertainty there is 1e-13 of the state, and the best of doubles are far above it."""
    row = sweep.measure(sweep.Task(CHAOTIC.id, id, (), **size), repeats=1)
    assert row["status"] == "ok"
    assert row["energy_max_early"] <= row["energy_max"]
    horizon, t = row["reference_horizon"], row["global_error_time"]
    spacing = size["h"] or CHAOTIC.t_end / peer_rows.ADAPTIVE
    assert horizon - spacing < t <= horizon < CHAOTIC.t_end / 2
    certificate = certified.find(CHAOTIC.made())
    assert abs(horizon - certificate.horizon) <= certificate.spacing + CHAOTIC.t_end / accuracy.GRID
    assert 100 * row["reference_uncertainty"] < row["global_error"]
    made = CHAOTIC.made()
    if id == "heyoka":
        again = integrate_peer(made, id, tol=1e-15, t_end=CHAOTIC.t_end, steps=peer_rows.ADAPTIVE)
    else:
        again = integrate(made, id, h=0.05, t_end=CHAOTIC.t_end)
    truth = taylor.reference(made, [t])
    (here,) = np.flatnonzero(again.t == t)
    error = np.abs(np.hstack([again.q[here] - truth.q[0], again.p[here] - truth.p[0]])).max()
    assert row["global_error"] == error


def test_control_past_the_horizon_the_reference_is_no_better_than_the_method():
    late = accuracy.reference(CHAOTIC.id)
    assert late.uncertainty[-1] > 1e-3
    first = late.t[np.argmax(late.uncertainty > 1e-13 * np.abs(np.hstack([late.q, late.p])).max(axis=1))]
    assert late.horizon() < first < late.horizon() + 1.5 * CHAOTIC.t_end / accuracy.GRID


def test_no_error_where_no_row_is_before_the_horizon():
    solution = integrate(CHAOTIC.made(), "stormer-verlet", h=0.05, t_end=CHAOTIC.t_end, save_every=0)
    assert set(accuracy.trajectory_error(CHAOTIC, solution)) == {"reference_horizon"}


# -- peers in a sweep --------------------------------------------------------------------------------------------------


def test_the_peers_of_a_sweep_are_of_the_packages_that_are_required():
    project = tomllib.loads((Path(sweep.__file__).parents[1] / "pyproject.toml").read_text())["project"]
    required = {re.split("[>=<;]", x)[0] for x in project["dependencies"]}
    swept = peer_rows.swept()
    assert {p.package for p in swept} == set(peer_rows.PACKAGES) <= required
    assert {p.id for p in PEERS.values() if p.package in required} == {p.id for p in swept}
    assert {p.id for p in peer_rows.swept(quick=True)} == set(peer_rows.QUICK)
    assert {*peer_rows.SLOW, *peer_rows.QUICK} <= {p.id for p in swept}
    assert "scipy-lsoda" not in peer_rows.QUICK  # by name it runs in the quick tier as well
    assert [t.tol for t in sweep.tasks([SCENE], True, lambda m: m.id == "scipy-lsoda")] == [1e-6]


def test_a_peer_runs_at_the_steps_or_over_tolerances():
    scene = BY_ID["kepler-t1"]

    def sizes(scene, id, quick=False):
        return [(t.h, t.tol) for t in sweep.tasks([scene], quick, lambda m: m.id == id)]

    assert sizes(scene, "rebound-leapfrog") == [(h, None) for h in scene.steps]
    assert sizes(scene, "rebound-leapfrog", True) == [(h, None) for h in scene.steps[: peer_rows.RUNGS]]
    assert sizes(scene, "heyoka") == [(None, tol) for tol in peer_rows.TOLERANCES]
    assert sizes(scene, "scipy-radau") == [(None, tol) for tol in peer_rows.TOLERANCES if tol > 1e-14]
    long = BY_ID["kepler-100-orbits"]
    assert len(sizes(long, "scipy-radau")) == len(sizes(long, "rebound-leapfrog-8")) == 1
    assert sizes(long, "rebound-leapfrog") == [(h, None) for h in long.steps[: peer_rows.SIZES]]
    assert sizes(long, "heyoka") == [(None, tol) for tol in peer_rows.TOLERANCES[: peer_rows.SIZES]]
    assert all(isinstance(t.made(), Peer) for t in sweep.tasks([scene], only=lambda m: m.id == "heyoka"))


ALIKE = {
    *("scene", "problem", "purpose", "method", "h", "t_end", "status", "kind", "versions", "tier", "declared_order"),
    *("steps", "gradient", "iterations", "fallbacks", "global_error", "global_error_time", "reference_uncertainty"),
    *("reference_horizon", "energy_max", "energy_end", "energy_drift", "angular-momentum_max", "seconds", "reason"),
}


SIZES = [
    ("heyoka", {"h": None, "tol": 1e-9}),
    ("rebound-ias15", {"h": None, "tol": 1e-6}),  # output ends its steps: the error is of a run without
    ("rebound-leapfrog", {"h": np.pi / 60}),
]


@pytest.mark.parametrize(("id", "size"), SIZES)
def test_a_row_of_a_peer_has_the_columns_of_a_method(id, size):
    scene = BY_ID["kepler-100-orbits"]
    row = sweep.measure(sweep.Task(scene.id, id, (), **size), repeats=1)
    assert set(row) >= ALIKE
    assert set(sweep.measure(sweep.Task(scene.id, "rk4", (), np.pi / 60), repeats=1)) >= ALIKE
    assert (row["status"], row["id"], row["kind"]) == ("ok", id, PEERS[id].package)
    assert f"{PEERS[id].package} {metadata.version(PEERS[id].package)}" in row["versions"]
    assert row["h"] == size["h"]
    assert row["tol"] == size.get("tol")
    bare = integrate_peer(scene.made(), id, **size, t_end=scene.t_end, save_every=0)
    truth = accuracy.reference(scene.id)
    error = np.abs(np.hstack([bare.q[-1] - truth.q[-1], bare.p[-1] - truth.p[-1]])).max()
    assert row["global_error"] == error > 1e-13
    assert row["steps"] == bare.counts["steps"]
    assert 0 < row["energy_max"] < 0.1
    assert json.loads(json.dumps(row)) == row


def test_a_peer_that_cannot_do_a_scene_has_one_row_that_says_why(monkeypatch):
    for id, why in (("rebound-whfast", "Kepler"), ("heyoka", "pip install heyoka")):
        if id == "heyoka":
            monkeypatch.setattr(peer_rows, "find_spec", lambda name: None)
        todo = sweep.tasks([BY_ID["pendulum-t2"]], only=lambda m, id=id: m.id == id)
        (row,) = sweep.run(todo, repeats=1)
        assert (row["status"], row["method"]) == ("skipped", id)
        assert why in row["reason"]
        assert "global_error" not in row


def test_a_peer_that_fails_has_its_reason_and_no_error(monkeypatch):
    scene = replace(SCENE, id="fall", problem="henon-heiles:chaotic", t_end=100.0, steps=(1.0,))
    monkeypatch.setitem(sweep.BY_ID, "fall", scene)
    made = replace(problem("henon-heiles:chaotic").start, q=(0.0, 3.0))
    monkeypatch.setattr(type(scene), "made", lambda s: replace(problem("henon-heiles"), orbits=(made,), orbit=""))
    row = sweep.measure(sweep.Task("fall", "heyoka", (), None, tol=1e-6))
    assert row["status"] == "diverged"
    assert "finite" in row["reason"]
    assert not {"global_error", "seconds"} & set(row)


def test_orders_are_of_fixed_steps_and_peers_have_them(monkeypatch):
    chosen = ("heyoka", "rebound-leapfrog")
    rows = sweep.run(sweep.tasks([BY_ID["pendulum-t2"]], only=lambda m: m.id in chosen), repeats=1)
    assert {r["method"] for r in rows} == set(chosen)
    (found,) = sweep.orders(rows)
    assert (found["method"], found["kind"]) == ("rebound-leapfrog", "rebound")
    assert found["order"] == pytest.approx(2, abs=0.1)


def test_rows_of_peers_are_not_in_the_stored_tables():
    mine = [sweep.measure(sweep.Task(SCENE.id, "rk4", (), SCENE.steps[0]), repeats=1)]
    other = {**mine[0], "method": "heyoka", "id": "heyoka", "kind": "heyoka", "h": None}
    table = bench_errors._table([*mine, other], SCENE)
    assert len(table) == len(mine)
    assert "heyoka" not in set(table["method"])
    assert "heyoka" in set(bench_errors._table([*mine, other | {"kind": sweep.KIND}], SCENE)["method"])
