"""The peers of heyoka: accuracy, equal lanes, cached integrators, compact mode, models."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian, InvalidInput
from phasebench.integrators.record import ROUND_OFF
from phasebench.reference.peers import BY_ID, heyoka_forms, integrate_peer
from phasebench.reference.peers import heyoka as peers
from phasebench.reference.solvers import taylor
from support.references import error

hy = pytest.importorskip("heyoka")

IDS = [p.id for p in peers.PEERS]
T_END = 10.0


@pytest.mark.parametrize("id", IDS)
@pytest.mark.parametrize("name", ["henon-heiles:box", "lotka-volterra", "perturbed-kepler"])
def test_the_tolerance_bounds_the_error(id, name):
    made = problem(name)
    tight, loose = (integrate_peer(made, id, t_end=T_END, steps=7, tol=tol) for tol in (None, 1e-6))
    assert (tight.status, loose.status) == ("ok", "ok")
    assert error(tight, made) < 1e-11
    assert 1000 * error(tight, made) < error(loose, made) < 1e-2
    assert tight.counts["steps"] > 0
    other = made.start.p[0] + 1e-8
    assert error(integrate_peer(made, id, t_end=T_END, steps=7, p0=[other, *made.p0[1:]]), made) > 1e-10


def test_a_looser_tolerance_is_cheaper():
    """The order of the series falls with the tolerance; work is the number of steps times the order squared."""
    made = problem("henon-heiles:box")
    work = []
    for tol in (1e-15, 1e-9, 1e-4):
        steps = integrate_peer(made, "heyoka", t_end=100.0, tol=tol).counts["steps"]
        work.append(steps * peers._scalar(made.system, tol)[0].order ** 2)
    assert work[0] > 1.5 * work[1] > 2 * work[2]


@pytest.mark.parametrize("name", ["henon-heiles:chaotic", "fpu"])
def test_lanes_equal_a_single_orbit(name):
    made = problem(name)
    one, lanes = (integrate_peer(made, id, h=0.5, t_end=T_END) for id in ("heyoka", "heyoka-batch"))
    assert lanes.counts == one.counts
    assert np.abs(lanes.q - one.q).max() < 1e-11
    kept = peers._batch(made.system, peers.EPS)
    assert kept.batch_size == hy.recommended_simd_size() == kept.state.shape[1]
    assert (kept.state == kept.state[:, :1]).all()
    assert np.abs(kept.state[: made.system.d, 0] - lanes.q[-1]).max() < 1e-11


class Differing:
    """A heyoka integrator of several lanes, wrapped so that its last lane deviates by 1e-15 at one row."""

    def __init__(self, kept, row):
        self.kept, self.row = kept, row

    def __getattr__(self, name):
        return getattr(self.kept, name)

    def propagate_grid(self, grid, **options):
        steps, states = self.kept.propagate_grid(grid, **options)
        states[self.row, 0, -1] += 1e-15
        return steps, states


@pytest.mark.parametrize("row", [1, 3])
def test_a_deviating_lane_is_a_failure(row, monkeypatch):
    made = problem("henon-heiles:box")
    kept = Differing(peers._batch(made.system, peers.EPS), row)
    monkeypatch.setattr(peers, "_batch", lambda *_: kept)
    solution = integrate_peer(made, "heyoka-batch", t_end=1.0, steps=3)
    assert (solution.status, len(solution.t)) == ("diverged", 1)
    assert "lanes, which started alike, differ" in solution.reason


def test_the_seconds_of_lanes_are_those_of_the_batch(monkeypatch):
    """The mocked clock ticks once per call: lanes take the time of the batch, not a share of it."""
    ticks = iter(range(100))
    monkeypatch.setattr(peers.time, "perf_counter", lambda: float(next(ticks)))
    made = problem("kepler")
    assert hy.recommended_simd_size() > 1
    assert [integrate_peer(made, id, t_end=1.0).seconds for id in IDS] == [1.0, 1.0, 1.0]


SCALAR = {
    "heyoka": (False, False),
    "heyoka-high-accuracy": (True, False),
    "heyoka(compact_mode)": (False, True),
    "heyoka-high-accuracy(compact_mode)": (True, True),
}


@pytest.fixture
def built_integrators(monkeypatch):
    """List of the heyoka integrators that runs use."""
    found, scalar = [], peers._scalar

    def seen(*arguments):
        made = scalar(*arguments)
        found.append(made[0])
        return made

    monkeypatch.setattr(peers, "_scalar", seen)
    return found


@pytest.mark.parametrize("tol", [None, 1e-9])
def test_the_settings_of_each_peer(tol, built_integrators):
    """(high_accuracy, compact_mode) and the tolerance, as heyoka reports them."""
    made = problem("kepler")
    of_one_orbit = [p for p in peers.PEERS if p.id != "heyoka-batch"]
    for p in (*of_one_orbit, peers.compact(False), peers.compact(True)):
        assert integrate_peer(made, p, t_end=1.0, tol=tol).status == "ok"
        assert (built_integrators[-1].high_accuracy, built_integrators[-1].compact_mode) == SCALAR[p.id]
        assert built_integrators[-1].tol == (tol or np.finfo(float).eps)
    assert len(built_integrators) == len(SCALAR)
    lanes = peers._batch(made.system, tol or peers.EPS)
    assert (lanes.high_accuracy, lanes.compact_mode, lanes.tol) == (False, False, tol or np.finfo(float).eps)


@pytest.fixture
def no_system_kept():
    """`is_compact` forgets what it has decided, before and after."""
    peers.is_compact.cache_clear()
    yield
    peers.is_compact.cache_clear()


def test_large_systems_can_run_without_compact_mode(monkeypatch, built_integrators, no_system_kept):
    made, operations = problem("toda:cnoidal", N=6), 30  # six exponentials, their arguments, and six differences
    monkeypatch.setattr(peers, "UNROLLED", operations // 2)
    other = peers.compact(True, on=False)
    assert "'heyoka-high-accuracy' is the same" in peers.compact(True).lacks(made, made.system)
    assert peers.compact(True, on=False).lacks(made, made.system) is None
    ends = [integrate_peer(made, p, t_end=0.1, tol=1e-12).q[-1] for p in ("heyoka", other)]
    assert [(ta.high_accuracy, ta.compact_mode) for ta in built_integrators] == [(False, True), (True, False)]
    assert np.abs(ends[0] - ends[1]).max() < 1e-11
    monkeypatch.setattr(peers, "UNROLLED", 2 * operations)
    peers.is_compact.cache_clear()
    assert "the same" in other.lacks(made, made.system)


MODELLED = {"kepler": "fixed_centres", "figure-eight": "nbody", "outer-solar-system": "nbody"}


@pytest.mark.parametrize("name", [*MODELLED, "perturbed-kepler", "henon-heiles:box"])
def test_heyokas_models_are_the_same_motion(name):
    """The package's model is used only for problems it describes, and reaches the state of the translated H."""
    made = problem(name)
    model = MODELLED.get(name)
    named = [n for n in heyoka_forms.NAMES if peers.compact(False, True, n).lacks(made, made.system) is None]
    assert [n for n in named if n != heyoka_forms.TRANSLATED] == ([model] if model else [])
    if model:
        t_end = made.pace.step * 30
        ends = [integrate_peer(made, p, t_end=t_end, tol=1e-14) for p in ("heyoka", peers.compact(False, True, model))]
        for x in ("q", "p"):
            a, b = (getattr(s, x)[-1] for s in ends)
            assert np.abs(a - b).max() < 1e-11 * np.abs(a).max()
        moved = integrate_peer(made, "heyoka", t_end=t_end, tol=1e-14, q0=np.array(made.q0) * (1 + 1e-9))
        assert np.abs(moved.q[-1] - ends[0].q[-1]).max() > 1e-11 * np.abs(ends[0].q[-1]).max()


def test_the_variants_of_a_peer():
    one, other = ({p.id for p in peers.twins(BY_ID[id])} for id in ("heyoka", "heyoka-high-accuracy"))
    assert {"heyoka(compact_mode)", "heyoka(compact_mode=False)", "heyoka(model=nbody, compact_mode=False)"} <= one
    assert not one & other
    assert "heyoka" not in one
    assert peers.twins(BY_ID["rebound-ias15"]) == ()


@pytest.mark.parametrize("id", IDS)
def test_integrators_are_cached_and_restarted(id):
    """A run is not affected by one before it with another orbit, tolerance or a divergence."""
    made = problem("henon-heiles:box")
    first = integrate_peer(made, id, h=0.5, t_end=T_END)
    integrate_peer(made, id, h=0.5, t_end=3.0, q0=[0.0, 50.0], p0=[0.0, 50.0])
    integrate_peer(made, id, t_end=3.0, tol=1e-4)
    again = integrate_peer(made, id, h=0.5, t_end=T_END)
    assert (again.q == first.q).all()
    assert (again.p == first.p).all()
    how = (heyoka_forms.TRANSLATED, None, False)
    kept = peers._scalar(made.system, peers.EPS, *how)
    assert kept is peers._scalar(made.system, peers.EPS, *how)
    assert kept is not peers._scalar(made.system, 1e-4, *how)
    assert kept is not peers._scalar(problem("pendulum").system, peers.EPS, *how)
    compilations = peers._scalar.cache_info().misses
    integrate_peer(made, id, t_end=0.1)
    assert peers._scalar.cache_info().misses == compilations
    integrate_peer(made, id, t_end=0.1, tol=2e-4)
    assert peers._scalar.cache_info().misses == compilations + 1


@pytest.mark.parametrize("id", IDS)
def test_a_blow_up_keeps_the_rows_before_it(id):
    runaway = Hamiltonian(q="q", p="p", H="p**2/2 - q**4/4")
    solution = integrate_peer(runaway, id, t_end=5.0, steps=10, q0=[1.0], p0=[1.0])
    assert (solution.status, solution.t.tolist()) == ("diverged", [0.0, 0.5, 1.0])
    assert np.isfinite(solution.q).all()
    assert "no longer finite" in solution.reason
    assert "t = 1 of 5" in solution.reason


@pytest.mark.parametrize("id", IDS)
def test_a_run_of_too_many_steps_is_stopped(id, monkeypatch):
    monkeypatch.setattr(taylor, "STEP_LIMIT", 3)
    solution = integrate_peer(problem("kepler"), id, t_end=100.0)
    assert solution.status == "diverged"
    assert "3 steps" in solution.reason


@pytest.mark.lowest
@pytest.mark.parametrize("id", IDS)
def test_the_energy_is_kept_to_round_off_as_claimed(id):
    claims = BY_ID[id].claims
    assert claims.energy == ROUND_OFF
    assert claims.source.startswith("https://")
    made = problem("henon-heiles:box")
    H = [
        made.system.observe(made.system.H, s.q, s.p)
        for s in (integrate_peer(made, id, t_end=1000.0, steps=100, tol=tol) for tol in (None, 1e-6))
    ]
    claimed, control = (np.abs(h - h[0]).max() for h in H)
    assert claimed < 1e-14 < 1e-9 < control


def test_the_least_tolerance_of_a_variant_is_half_the_machine_epsilon():
    made, variant, least = problem("kepler"), peers.compact(False), 2.0**-53
    with pytest.raises(InvalidInput, match="none below"):
        integrate_peer(made, variant, t_end=0.1, tol=least * (1 - 1e-9))
    assert integrate_peer(made, variant, t_end=0.1, tol=least).status == "ok"
