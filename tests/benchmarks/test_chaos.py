"""``lyapunov``: exponents that are known, heyoka's variational equations, regular orbits beside chaotic ones."""

from __future__ import annotations

import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.measure import chaos, lyapunov

#: An orbit of Henon and Heiles's system at H = 1/8, whose exponent is 0.047 (Ch. Skokos, J. Phys. A 34 (2001) 10029).
CHAOTIC = {"q0": [0.0, -0.016], "p0": [0.49974, 0.0]}
REGULAR = {"q0": [0.0, 0.55], "p0": [0.2417, 0.0]}


def test_a_saddle_grows_by_its_rate_and_an_oscillator_does_not():
    saddle = pb.Hamiltonian(q="q", p="p", H="p**2/2 - 0.04*q**2/2")
    found = pb.lyapunov(saddle, "gauss-2", h=0.05, t_end=200, q0=[0.0], p0=[0.0])
    assert found.exponent == pytest.approx(0.2, rel=1e-4)
    assert found.low <= found.exponent <= found.high
    rest = np.zeros((401, 1))
    assert lyapunov.exponent(saddle, np.linspace(0.0, 200.0, 401), rest, rest) == pytest.approx(0.2, rel=0.1)
    still = pb.lyapunov("harmonic-oscillator", "gauss-2", h=0.05, t_end=200)
    assert abs(still.exponent[0]) < 1e-3


def test_a_chaotic_orbit_has_its_published_exponent_and_a_regular_one_has_none():
    found = pb.lyapunov("henon-heiles", "gauss-4", h=0.2, t_end=100_000, **CHAOTIC)
    assert found.low[0] < 0.047 < found.high[0]
    assert found.high[0] - found.low[0] < 0.05
    both = [[CHAOTIC[name], REGULAR[name]] for name in ("q0", "p0")]
    rows = pb.lyapunov("henon-heiles", "gauss-4", h=0.2, t_end=5_000, q0=both[0], p0=both[1])
    assert rows.megno[0] > 20
    assert rows.megno[1] == pytest.approx(2.0, abs=0.2)
    assert rows.exponent[1] < 0.003
    assert list(rows.to_frame().columns) == ["exponent", "low", "high", "megno", "t_end", "status"]


def test_growth_is_that_of_heyokas_variational_equations():
    hy = pytest.importorskip("heyoka")
    x, y, u, v = hy.make_vars("x", "y", "u", "v")
    field = [(x, u), (y, v), (u, -x - 2 * x * y), (v, -y - x * x + y * y)]
    system = hy.var_ode_sys(field, hy.var_args.vars, order=1)
    adaptive = hy.taylor_adaptive(system, [*CHAOTIC["q0"], *CHAOTIC["p0"]], compact_mode=True)
    adaptive.propagate_until(100.0)
    delta = np.cos(np.arange(1, 5))
    there = adaptive.state[adaptive.get_vslice(order=1)].reshape(4, 4) @ (delta / np.linalg.norm(delta))
    s = pb.integrate("henon-heiles", "gauss-8", h=0.05, t_end=100.0, **CHAOTIC)
    kept = pb.problem("henon-heiles").system
    errors = [
        abs(chaos._growth(kept, s.t[::n], s.q[::n], s.p[::n]).sum() - np.log(np.linalg.norm(there))) for n in (1, 2, 4)
    ]
    assert errors[0] < 1e-4
    assert errors[2] > 100 * errors[0], "of order 4 in the time between rows"


def test_what_cannot_be_told_is_said():
    with pytest.raises(pb.InvalidInput, match="200"):
        pb.lyapunov("pendulum", "gauss-2", h=0.1, t_end=1)
    with pytest.raises(pb.InvalidInput, match="constraints"):
        pb.lyapunov("spherical-pendulum", "rattle", h=0.1, t_end=100)
    with pytest.raises(pb.InvalidInput, match="shapes"):
        pb.lyapunov("pendulum", "gauss-2", h=0.1, t_end=100, q0=[[1.0], [2.0]], p0=[[0.0]])
    lost = pb.lyapunov("henon-heiles", "stormer-verlet", h=0.1, t_end=100, q0=[0.0, 3.0], p0=[0.0, 0.0])
    assert lost.status[0] != "ok"
    assert np.isnan(lost.exponent[0])
