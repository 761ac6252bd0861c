"""Rows of a sweep against the reference up to its horizon, and the rows of peers."""

from __future__ import annotations

import json
from importlib import metadata

import numpy as np
import pytest

from phasebench.benchmarks.ladder import sweep
from phasebench.benchmarks.measure import accuracy
from phasebench.benchmarks.measure.orders import orders
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.scenes import BY_ID, SCENES
from phasebench.integrators import integrate
from phasebench.reference.certificates import stored as certified
from phasebench.reference.peers import BY_ID as PEERS
from phasebench.reference.peers import integrate_peer
from phasebench.reference.solvers import taylor

SCENE = BY_ID["lotka-volterra-t1"]
CHAOTIC = next(s for s in SCENES if not s.regular)


def exactly(made, t, q, p):
    """Error of the doubles q, p at time t against an independent run in quadruple precision."""
    _, quad = taylor.extended_types()
    (row,) = taylor.states(made.system, quad, made.q0, made.p0, [t])
    return max(abs(float(quad(float(x)) - y)) for x, y in zip((*q, *p), row, strict=True))


def test_every_scene_has_a_stored_truth():
    for scene in SCENES:
        true, certificate = accuracy.truth(scene.id), certified.find(problem(scene.problem))
        assert (true.source, true.horizon) == (accuracy.STORED, min(certificate.horizon, scene.t_end))
        assert (true.t == scene.t_end) == scene.regular
        end = certificate.at(true.t)
        assert (true.texts, true.uncertainty) == ((*end.q_text, *end.p_text), end.uncertainty)


@pytest.mark.parametrize(("id", "size"), [("stormer-verlet", {"h": 0.05}), ("heyoka", {"h": None, "tol": 1e-15})])
def test_chaotic_scene_is_measured_before_its_horizon(id, size):
    """The error is measured at the last stored time before the horizon, where long double is accurate to 1e-13."""
    row = sweep.measure(sweep.Task(CHAOTIC.id, id, (), **size), repeats=1)
    assert row["status"] == "ok"
    assert row["energy_max_early"] <= row["energy_max"]
    made = problem(CHAOTIC.problem)
    certificate = certified.find(made)
    t = max(end.t for end in certificate.ends if end.t <= certificate.horizon)
    assert (row["global_error_time"], row["reference_horizon"]) == (t, certificate.horizon)
    assert t < CHAOTIC.t_end / 2
    if id == "heyoka":
        again = integrate_peer(made, id, tol=1e-15, t_end=t)
    else:
        again = integrate(made, id, h=0.05, t_end=t)
    assert row["global_error"] == exactly(made, t, again.q[-1], again.p[-1])
    assert 100 * row["reference_uncertainty"] < row["global_error"] < 1


def test_control_no_error_after_the_horizon(monkeypatch):
    """Without a certificate, the end of the chaotic scene is beyond the reach of long double."""
    monkeypatch.setattr(accuracy.stored, "find", lambda problem: None)
    late = accuracy.truth.__wrapped__(CHAOTIC.id)
    assert late.uncertainty > 1e-3
    monkeypatch.setattr(accuracy, "truth", lambda scene: late)
    solution = integrate(problem(CHAOTIC.problem), "stormer-verlet", h=0.05, t_end=CHAOTIC.t_end, save_every=0)
    assert set(accuracy.trajectory_error(CHAOTIC, solution)) == {"reference_horizon"}


# -- peers in a sweep --------------------------------------------------------------------------------------------------


ALIKE = {
    *("scene", "problem", "purpose", "method", "h", "t_end", "status", "kind", "versions", "tier", "declared_order"),
    *("steps", "gradient", "iterations", "fallbacks", "global_error", "global_error_time", "reference_uncertainty"),
    *("reference_horizon", "energy_max", "energy_end", "energy_drift", "angular-momentum_max", "seconds", "reason"),
}


SIZES = [
    ("heyoka", {"h": None, "tol": 1e-9}),
    ("rebound-ias15", {"h": None, "tol": 1e-6}),  # output shortens its steps; the error is that of a run without output
    ("rebound-leapfrog", {"h": np.pi / 60}),
]


@pytest.mark.parametrize(("id", "size"), SIZES)
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


def test_orders_exist_for_peers_with_fixed_steps(monkeypatch):
    chosen = ("heyoka", "rebound-leapfrog")
    rows = sweep.measure_rows(sweep.tasks([BY_ID["pendulum-t2"]], only=lambda m: m.id in chosen), 1)["rows"]
    assert {r["method"] for r in rows} == set(chosen)
    (found,) = orders(rows)
    assert (found["method"], found["kind"]) == ("rebound-leapfrog", "rebound")
    assert found["order"] == pytest.approx(2, abs=0.1)
