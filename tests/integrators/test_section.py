"""Poincare sections: points of the flow on the plane, each crossing once."""

import numpy as np
import pytest

from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian
from phasebench.integrators.driver import DIVERGED, OK, integrate
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.section import section

OSCILLATOR = Hamiltonian(q="x", p="v", H="v**2/2 + x**2/2")


def test_the_crossings_of_the_oscillator_are_known():
    r = np.array([1.0, 2.0])
    found = section(OSCILLATOR, "gauss-4", [[1.0], [0.0]], [[0.0], [2.0]], of="x", at=0.5, h=0.1, t_end=20.0)
    assert found.counts().tolist() == [3, 4]
    np.testing.assert_array_equal(found.q[:, 0], 0.5)
    np.testing.assert_allclose(found.p[:, 0], np.sqrt(r[found.orbit] ** 2 - 0.25), rtol=1e-9)
    turn = 2 * np.pi * np.array([1, 2, 3, 0, 1, 2, 3])
    np.testing.assert_allclose(found.t, turn + np.array([-np.pi / 3] * 3 + [np.arcsin(0.25)] * 4), rtol=1e-9)


def test_falling_crossings_are_the_others():
    options = {"of": "x", "h": 0.1, "t_end": 20.0}
    rising, falling = (
        section(OSCILLATOR, "gauss-4", [[1.0]], [[0.0]], rising=rising, **options) for rising in (True, False)
    )
    np.testing.assert_allclose(rising.t, np.pi * (2 * np.arange(3) + 1.5), rtol=1e-9)
    np.testing.assert_allclose(falling.t, np.pi * (2 * np.arange(3) + 0.5), rtol=1e-9)
    momentum = section(OSCILLATOR, "gauss-4", [[1.0]], [[0.0]], **options | {"of": "v"})
    np.testing.assert_allclose(momentum.t, np.pi * (2 * np.arange(3) + 1), rtol=1e-9)


def test_a_point_is_where_the_orbit_is_at_its_time():
    made = problem("henon-heiles:box")
    found = section(made, "kahan-li-8", [made.q0], [made.p0], of="q1", h=0.1, t_end=50.0, every=2)
    assert len(found.t) > 5
    for t, q, p in zip(found.t, found.q, found.p, strict=True):
        end = integrate(made, "gauss-8", t_end=t, steps=int(10 * t), save_every=0)
        np.testing.assert_allclose([*end.q[-1], *end.p[-1]], [*q, *p], rtol=0, atol=2e-9)
        assert q[0] == 0
        assert p[0] > 0


def test_an_orbit_that_stops_keeps_its_crossings():
    made = problem("henon-heiles:box")
    Q, P = np.array([made.q0, (0.0, 1.5)]), np.array([made.p0, (0.5, 0.1)])
    found = section(made, "stormer-verlet", Q, P, of="q1", h=0.01, t_end=50.0)
    assert found.status.tolist() == [OK, DIVERGED]
    assert np.isfinite(found.q).all()


@pytest.mark.parametrize(
    ("changed", "message"), [({"of": "z"}, "no coordinate"), ({"every": 0}, "every"), ({"save_every": 1}, "every")]
)
def test_what_cannot_be_used_is_refused(changed, message):
    with pytest.raises(InvalidInput, match=message):
        section(OSCILLATOR, "gauss-4", [[1.0]], [[0.0]], **{"of": "x", "h": 0.1, "steps": 1} | changed)
