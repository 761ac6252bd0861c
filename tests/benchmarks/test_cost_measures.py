"""What only a hand-made case shows of the measures of costs: a step, an error, a first run, sizes, ensembles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from phasebench.benchmarks.measure import canary
from phasebench.benchmarks.studies.costs import large, start, step
from phasebench.benchmarks.studies.costs.systems import SYSTEMS
from phasebench.benchmarks.studies.ensembles import against, maps
from phasebench.integrators.compile.codegen import TUPLE_LIMIT
from phasebench.integrators.prepared import prepare


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


def test_second_start_with_one_cache_compiles_nothing(tmp_path):
    kept = []
    for _ in range(2):
        row = start.cold("explicit-euler", "pendulum", cache=str(tmp_path))
        assert (row["status"], row["family"], row["d"]) == ("ok", "runge_kutta", 1)
        kept.append({path: path.stat().st_ino for path in tmp_path.rglob("*") if path.is_file()})
    assert kept[0]
    assert kept[1] == kept[0]


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
