"""The accuracy columns of a result row, on fabricated certificates and solutions."""

from __future__ import annotations

from decimal import Decimal
from types import SimpleNamespace

import numpy as np
import pytest

from phasebench.benchmarks.measure import accuracy
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.scenes import SCENES

KEPLER = problem("kepler")
REGULAR, CHAOTIC = (next(s for s in SCENES if s.regular is regular) for regular in (True, False))


@pytest.fixture
def true(monkeypatch):
    """A function that fabricates a certificate and returns (time, source) of the scene's true state.

    Its arguments: the scene, the horizon and the stored times of the certificate.
    """

    def told(scene, horizon: float, *times: float) -> tuple[float, str]:
        ends = [SimpleNamespace(t=t, q_text=(f"{t}",), p_text=("0",), uncertainty=1e-20 * t) for t in times]
        certificate = SimpleNamespace(horizon=horizon, ends=ends) if times else None
        monkeypatch.setattr(accuracy.stored, "find", lambda problem: certificate)
        monkeypatch.setattr(
            accuracy, "_compute_truth", lambda problem, t: accuracy.Truth(t, (), 0.0, t, accuracy.COMPUTED)
        )
        found = accuracy.truth.__wrapped__(scene.id)
        if found.source == accuracy.STORED:
            assert (found.texts, found.uncertainty) == ((f"{found.t}", "0"), 1e-20 * found.t)
            assert found.horizon == min(horizon, scene.t_end)
        return found.t, found.source

    return told


def test_regular_scene_has_its_truth_at_its_end(true):
    end = REGULAR.t_end
    assert true(REGULAR, 2 * end, end / 2, end, 2 * end) == (end, accuracy.STORED)
    assert true(REGULAR, 2 * end, end / 2, 2 * end) == (end, accuracy.COMPUTED)
    assert true(REGULAR, end / 2, end / 4, end) == (end, accuracy.COMPUTED), "past the horizon it is not stored's"
    assert true(REGULAR, 2 * end) == (end, accuracy.COMPUTED)


def test_chaotic_scene_has_its_truth_before_its_horizon(true):
    end = CHAOTIC.t_end
    assert true(CHAOTIC, end / 2, end / 8, end / 4, end) == (end / 4, accuracy.STORED)
    assert true(CHAOTIC, end / 2, end / 2, end) == (end / 2, accuracy.STORED)
    assert true(CHAOTIC, 9 * end, end / 4, 2 * end) == (end / 4, accuracy.STORED), "nor past the scene's end"


def test_error_is_computed_without_round_off():
    true, tenth = accuracy.Truth(1.0, ("0.1", "-2"), 0.0, 1.0, accuracy.STORED), 0.1
    assert true.error([tenth, -2.0]) == float(abs(Decimal(tenth) - Decimal("0.1"))) > 0
    assert true.error([tenth, -2.5]) == 0.5


def test_trajectory_error_needs_a_row_within_the_horizon(monkeypatch):
    def measured(*times: float, horizon: float = 3.0) -> dict:
        told = accuracy.Truth(3.0, ("1", "0"), 1e-20, horizon, accuracy.STORED)
        monkeypatch.setattr(accuracy, "truth", lambda scene: told)
        rows = np.arange(len(times), dtype=float)
        return accuracy.trajectory_error(
            REGULAR, SimpleNamespace(t=np.array(times), q=rows[:, None], p=0 * rows[:, None])
        )

    found = measured(0.0, 1.0, 3.0 * (1 + 2e-16), 4.0)
    assert (found["global_error"], found["global_error_time"], found["reference_uncertainty"]) == (1.0, 3.0, 1e-20)
    assert "reference" not in found
    assert measured(0.0, 2.0, 2.9) == measured(0.0) == {"reference_horizon": 3.0}
    assert measured(0.0, 3.0, horizon=2.0) == {"reference_horizon": 2.0}


def standing(n: int, late: float = 1.0, last: float = 1.0) -> SimpleNamespace:
    """A stand-in for a Kepler solution: n equal rows, but p is multiplied by ``late`` after a tenth of them.

    In the last row it is multiplied by ``last`` as well.
    """
    scale = np.where(np.arange(n) < n // 10, 1.0, late)
    scale[-1] *= last
    q, p = np.tile(KEPLER.q0, (n, 1)), np.outer(scale, KEPLER.p0)
    return SimpleNamespace(t=np.linspace(0, 100.0, n), q=q, p=p, status="ok")


def test_invariant_errors_have_columns_by_name():
    found = accuracy.invariants(KEPLER, standing(400, late=1.01), 100.0)
    kinetic = np.dot(KEPLER.p0, KEPLER.p0) / 2
    assert found["energy_max"] == found["energy_end"] == pytest.approx(kinetic * (1.01**2 - 1))
    assert found["energy_max_early"] == 0.0, "of the first twentieth"
    L = KEPLER.q0[0] * KEPLER.p0[1] - KEPLER.q0[1] * KEPLER.p0[0]
    named = {name: found[f"{name}_max"] for name in KEPLER.invariants}
    assert named["angular-momentum"] == pytest.approx(0.01 * abs(L))


def test_drift_and_early_error_need_enough_rows():
    slope = {"energy_drift", "energy_drift_low", "energy_drift_high"}
    assert [slope <= accuracy.invariants(KEPLER, standing(n), 100.0).keys() for n in (47, 48)] == [False, True]
    early = [accuracy.invariants(KEPLER, standing(n), 100.0).get("energy_max_early") for n in (200, 201)]
    assert early == [None, 0.0], "ten steps in the first twentieth"
    diverged = standing(400)
    diverged.status = "diverged"
    assert not slope & accuracy.invariants(KEPLER, diverged, 100.0).keys()


def test_nonfinite_values_are_left_out():
    found = accuracy.invariants(KEPLER, standing(400, last=np.nan), 100.0)
    assert (found["energy_max"], found["energy_end"]) == (0.0, 0.0)


def test_row_begins_with_scene_problem_and_method():
    chosen = SimpleNamespace(label="rk4(x=1)", id="rk4", order=4)
    row = accuracy.head(REGULAR, KEPLER, chosen, "phasebench", "no-such-package")
    assert (row["scene"], row["problem"], row["t_end"]) == (REGULAR.id, KEPLER.label, REGULAR.t_end)
    assert (row["method"], row["id"], row["declared_order"], row["kind"]) == ("rk4(x=1)", "rk4", 4, "phasebench")
    assert row["versions"].endswith(", no-such-package absent")
    assert f"numpy {np.__version__}" in row["versions"]
