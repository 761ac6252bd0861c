"""Poincare sections: every crossing of the plane is found once, at its place."""

import tracemalloc

import numpy as np
import pytest

from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian
from phasebench.integrators import section as sections
from phasebench.integrators.crossings import GROWTH
from phasebench.integrators.driver import COLLISION, DIVERGED, OK, integrate
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.section import section

OSCILLATOR = Hamiltonian(q="x", p="v", H="v**2/2 + x**2/2")


def test_a_row_on_the_plane_is_one_crossing():
    free = Hamiltonian(q="q", p="p", H="p**2/2")
    for q, p, rising, times in (
        (-2.0, 1.0, True, [2]),
        (2.0, -1.0, False, [2]),
        (2.0, -1.0, True, []),
        (0.0, 1.0, True, []),
    ):
        found = section(free, "rk4", [[q]], [[p]], of="q", h=1.0, steps=4, rising=rising)
        assert found.t.tolist() == pytest.approx(times)


def test_crossings_of_the_oscillator():
    r = np.array([1.0, 2.0])
    found = section(OSCILLATOR, "gauss-4", [[1.0], [0.0]], [[0.0], [2.0]], of="x", at=0.5, h=0.1, t_end=20.0)
    assert found.counts().tolist() == [3, 4]
    np.testing.assert_array_equal(found.q[:, 0], 0.5)
    np.testing.assert_allclose(found.p[:, 0], np.sqrt(r[found.orbit] ** 2 - 0.25), rtol=1e-9)
    turn = 2 * np.pi * np.array([1, 2, 3, 0, 1, 2, 3])
    np.testing.assert_allclose(found.t, turn + np.array([-np.pi / 3] * 3 + [np.arcsin(0.25)] * 4), rtol=1e-9)
    momentum = section(OSCILLATOR, "gauss-4", [[1.0]], [[0.0]], of="v", h=0.1, t_end=20.0)
    np.testing.assert_allclose(momentum.t, np.pi * (2 * np.arange(3) + 1), rtol=1e-9)


def test_a_crossing_lies_on_the_orbit():
    made = problem("henon-heiles:box")
    found = section(made, "kahan-li-8", [made.q0], [made.p0], of="q1", h=0.1, t_end=50.0, every=2)
    assert len(found.t) > 5
    for t, q, p in zip(found.t, found.q, found.p, strict=True):
        end = integrate(made, "gauss-8", t_end=t, steps=int(10 * t), save_every=0)
        np.testing.assert_allclose([*end.q[-1], *end.p[-1]], [*q, *p], rtol=0, atol=2e-9)
        assert q[0] == 0
        assert p[0] > 0


def test_a_stopped_orbit_keeps_its_crossings():
    made = problem("henon-heiles:box")
    Q, P = np.array([made.q0, (0.0, 1.5)]), np.array([made.p0, (0.5, 0.1)])
    found = section(made, "stormer-verlet", Q, P, of="q1", h=0.01, t_end=50.0)
    assert found.status.tolist() == [OK, DIVERGED]
    assert (found.counts() > 0).all()
    assert np.isfinite(found.q).all()


@pytest.mark.parametrize(("changed", "message"), [({"of": "z"}, "no coordinate"), ({"every": 0}, "every")])
def test_invalid_arguments_are_refused(changed, message):
    with pytest.raises(InvalidInput, match=message):
        section(OSCILLATOR, "gauss-4", [[1.0]], [[0.0]], **{"of": "x", "h": 0.1, "steps": 1} | changed)


def box(n, **options):
    """The section of n Henon-Heiles orbits."""
    Q = np.column_stack([np.zeros(n), np.linspace(-0.3, 0.3, n)])
    P = np.column_stack([np.full(n, 0.3), np.linspace(0.1, -0.1, n)])
    options = {"of": "q1", "h": 0.1, "t_end": 200.0} | options
    return section(problem("henon-heiles"), options.pop("method", "pefrl"), Q, P, **options)


@pytest.mark.parametrize("method", ["pefrl", "gauss-4", "scheme-v"])
def test_crossings_do_not_depend_on_lanes_threads_or_pieces(monkeypatch, method):
    """In lanes, one by one, by `integrate` (Scheme V), and in calls of two rows or of many."""
    found = [box(20, method=method, threads=k) for k in (1, 2)]
    monkeypatch.setattr(sections, "ROOM", 1)
    monkeypatch.setattr(sections.SectionOrbits, "group", 8)
    found += [box(20, method=method, lanes=False), box(20, method=method)]
    assert len(found[0]) > 500
    assert (np.diff(found[0].orbit) >= 0).all()
    assert (np.diff(found[0].t)[np.diff(found[0].orbit) == 0] > 0).all()
    for other in found[1:]:
        np.testing.assert_array_equal(other.orbit, found[0].orbit)
        np.testing.assert_allclose(other.t, found[0].t, rtol=0, atol=1e-9)
        np.testing.assert_allclose(np.hstack([other.q, other.p]), np.hstack([found[0].q, found[0].p]), atol=1e-9)


def test_a_section_takes_little_memory(monkeypatch):
    """8 (2 d + 2) bytes per crossing plus fixed buffers; storing the rows would take 50 times as much."""
    box(20, t_end=10.0)
    bound = 8 * (sections.ROOM + 40 * sections.LOOKS) + 8 * 6 * GROWTH
    tracemalloc.start()
    found = box(20, t_end=20000.0, threads=1)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    m, d = len(found), 2
    assert m > 50_000
    assert sum(x.nbytes for x in (found.orbit, found.t, found.q, found.p)) == 8 * (2 * d + 2) * m
    assert peak < 8 * (2 * d + 3) * m + 4 * bound
    rows = 20 * 200_000 * 8 * (2 * d + 1)
    assert rows > 10 * peak


@pytest.mark.parametrize("more", [{}, {"t_end": None, "steps": 1000, "lanes": True}])
def test_every_orbit_may_have_its_own_step(more):
    found = box(3, h=np.array([0.1, 0.05, 0.025]), **more)
    alike = [box(3, h=h, **more) for h in (0.1, 0.05, 0.025)]
    for i, other in enumerate(alike):
        np.testing.assert_array_equal(found.t[found.orbit == i], other.t[other.orbit == i])


def test_a_collision_between_stored_rows_is_seen():
    """A fall passes the centre within one step; only checking every step shows it."""
    fall = problem("kepler").system
    found = section(
        fall, "stormer-verlet", [[1.0, 0.0], [1.0, 0.0]], [[0.0, 0.0], [0.0, 1.0]], of="q2", h=0.01, t_end=10
    )
    assert found.status.tolist() == [COLLISION, OK]
    assert found.counts().tolist() == [0, 1]
