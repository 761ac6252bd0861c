"""The peers of heyoka: equal lanes, cached integrators, compact mode, heyoka's own models."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.problems import problem
from phasebench.integrators import InvalidInput
from phasebench.reference.peers import BY_ID, heyoka_forms, integrate_peer
from phasebench.reference.peers import heyoka as peers
from phasebench.reference.peers.prepared import prepare_peer

hy = pytest.importorskip("heyoka")

IDS = [p.id for p in peers.PEERS]
MADE = problem("henon-heiles:box")


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


def test_lanes_equal_a_single_orbit_and_one_that_deviates_is_a_failure(monkeypatch):
    one, lanes = (integrate_peer(MADE, id, h=0.5, t_end=10.0) for id in ("heyoka", "heyoka-batch"))
    assert lanes.counts == one.counts
    assert np.abs(lanes.q - one.q).max() < 1e-11
    kept = peers._batch(MADE.system, peers.EPS)
    assert kept.batch_size == hy.recommended_simd_size() == kept.state.shape[1]
    for row in (1, 3):
        monkeypatch.setattr(peers, "_batch", lambda *_, row=row: Differing(kept, row))
        wrong = integrate_peer(MADE, "heyoka-batch", t_end=1.0, steps=3)
        assert (wrong.status, len(wrong.t)) == ("diverged", 1)
        assert "lanes, which started alike, differ" in wrong.reason


def test_the_seconds_of_lanes_are_those_of_the_batch(monkeypatch):
    """The mocked clock ticks once per call: lanes take the time of the batch, not a share of it."""
    ticks = iter(range(100))
    monkeypatch.setattr(peers.time, "perf_counter", lambda: float(next(ticks)))
    assert hy.recommended_simd_size() > 1
    assert [integrate_peer(MADE, id, t_end=1.0).seconds for id in IDS] == [1.0, 1.0, 1.0]


@pytest.fixture
def built(monkeypatch):
    """The heyoka integrators that runs use; `is_compact` forgets what it has decided, before and after."""
    found, scalar = [], peers._scalar

    def seen(*arguments):
        made = scalar(*arguments)
        found.append(made[0])
        return made

    monkeypatch.setattr(peers, "_scalar", seen)
    peers.is_compact.cache_clear()
    yield found
    peers.is_compact.cache_clear()


def test_the_settings_of_each_peer(built):
    """(high_accuracy, compact_mode) and the tolerance, as heyoka reports them."""
    wanted = {
        BY_ID["heyoka"]: (False, False),
        BY_ID["heyoka-high-accuracy"]: (True, False),
        peers.compact(False): (False, True),
        peers.compact(True): (True, True),
    }
    for p, (accurate, compact) in wanted.items():
        for tol in (None, 1e-9):
            assert integrate_peer(MADE, p, t_end=1.0, tol=tol).status == "ok"
            ta = built[-1]
            assert (ta.high_accuracy, ta.compact_mode, ta.tol) == (accurate, compact, tol or 2.0**-52)
    lanes = peers._batch(MADE.system, 1e-9)
    assert (lanes.high_accuracy, lanes.compact_mode, lanes.tol) == (False, False, 1e-9)
    with pytest.raises(InvalidInput, match="none below"):
        integrate_peer(MADE, peers.compact(False), t_end=0.1, tol=2.0**-54)


def test_large_systems_run_in_compact_mode_and_can_run_without(monkeypatch, built):
    made, operations = problem("toda:cnoidal", N=6), 30  # six exponentials, their arguments, and six differences
    monkeypatch.setattr(peers, "UNROLLED", operations // 2)
    other = peers.compact(True, on=False)
    assert "'heyoka-high-accuracy' is the same" in peers.compact(True).lacks(made, made.system)
    assert other.lacks(made, made.system) is None
    ends = [integrate_peer(made, p, t_end=0.1, tol=1e-12).q[-1] for p in ("heyoka", other)]
    assert [(ta.high_accuracy, ta.compact_mode) for ta in built] == [(False, True), (True, False)]
    assert np.abs(ends[0] - ends[1]).max() < 1e-11
    monkeypatch.setattr(peers, "UNROLLED", 2 * operations)
    peers.is_compact.cache_clear()
    assert "the same" in other.lacks(made, made.system)


MODELLED = {"kepler": "fixed_centres", "figure-eight": "nbody", "outer-solar-system": "nbody"}


@pytest.mark.parametrize("name", [*MODELLED, "perturbed-kepler", "henon-heiles:box"])
def test_heyokas_models_are_the_same_motion(name):
    """The package's model is used only for problems it describes, and reaches the state of the translated H."""
    made, model = problem(name), MODELLED.get(name)
    named = [n for n in heyoka_forms.NAMES if peers.compact(False, True, n).lacks(made, made.system) is None]
    assert [n for n in named if n != heyoka_forms.TRANSLATED] == ([model] if model else [])
    if model:
        t_end = made.pace.step * 30
        modelled = peers.compact(False, True, model)
        one, other = (integrate_peer(made, p, t_end=t_end, tol=1e-14) for p in ("heyoka", modelled))
        q, p, _ = prepare_peer(made, modelled, tol=1e-14)(t_end)
        assert (*q, *p) == (*other.q[-1], *other.p[-1])
        moved = integrate_peer(made, "heyoka", t_end=t_end, tol=1e-14, q0=np.array(made.q0) * (1 + 1e-9))
        for x in ("q", "p"):
            a, b, c = (getattr(s, x)[-1] for s in (one, other, moved))
            assert np.abs(a - b).max() < 1e-11 * np.abs(a).max() < np.abs(a - c).max()


@pytest.mark.parametrize("id", IDS)
def test_integrators_are_cached_and_restarted(id):
    """A run is not affected by one before it with another orbit, tolerance or a divergence."""
    for size in ({"h": 0.5}, {}):  # with rows and without
        first = integrate_peer(MADE, id, t_end=10.0, **size)
        compilations = peers._scalar.cache_info().misses
        integrate_peer(MADE, id, h=0.5, t_end=3.0, q0=[0.0, 50.0], p0=[0.0, 50.0])
        again = integrate_peer(MADE, id, t_end=10.0, **size)
        assert (again.q == first.q).all()
        assert (again.p == first.p).all()
        assert peers._scalar.cache_info().misses == compilations
    integrate_peer(MADE, id, t_end=0.1, tol=2e-4)
    assert peers._scalar.cache_info().misses <= compilations + 1
