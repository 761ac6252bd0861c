"""H(q, p, t): the rows are of q and p, and the numbers those of the system with the time as a coordinate."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import mathieu_a, mathieu_cem

import phasebench as pb
from support.commands import integrate_json

SWING = "p**2/2 - cos(q)*(1 + sin(13*t/10)/10)"
DRIVEN = pb.Hamiltonian(q="q", p="p", H=SWING)
#: The same with the time as a coordinate by hand.
HAND = pb.Hamiltonian(q="q s", p="p ps", H=f"{SWING.replace('t)', 's)').replace('*t/', '*s/')} + ps")
START = {"q0": [1.0], "p0": [0.5]}


def end(found):
    return np.array([*found.q[-1], *found.p[-1]])


@pytest.mark.parametrize("method", ["stormer-verlet", "rk4", "gauss-4", "scheme-v", "generating-function"])
def test_it_is_the_extension_made_by_hand_to_the_last_bit(method):
    extended = pb.integrate(HAND, method, h=0.1, t_end=20.0, q0=[1.0, 0.0], p0=[0.5, 0.0])
    found = pb.integrate(DRIVEN, method, h=0.1, t_end=20.0, **START)
    assert found.q.shape == found.p.shape == (201, 1)
    np.testing.assert_array_equal(found.q[:, 0], extended.q[:, 0])
    np.testing.assert_array_equal(found.p[:, 0], extended.p[:, 0])
    kept = found.invariants()["H + p_t"]
    np.testing.assert_array_equal(kept, extended.energy())
    assert np.ptp(found.energy()) > 100 * np.ptp(kept)


@pytest.mark.parametrize("t0", [0.0, 3.0])
@pytest.mark.parametrize("method", ["gauss-8", "kahan-li-8", "heyoka", "heyoka-batch"])
def test_the_time_counts_from_t0(method, t0):
    exact = solve_ivp(
        lambda t, y: [y[1], -np.sin(y[0]) * (1 + np.sin(1.3 * t) / 10)],
        *((t0, 20.0), [1.0, 0.5]),
        **{"rtol": 1e-12, "atol": 1e-13, "method": "DOP853"},
    )
    more = {} if method.startswith("heyoka") else {"h": 0.02}
    found = pb.integrate(DRIVEN, method, t0=t0, t_end=20.0, **START, **more)
    np.testing.assert_allclose(end(found), exact.y[:, -1], rtol=0, atol=1e-9)
    assert found.error().error < 1e-9
    assert np.abs(end(pb.integrate(DRIVEN, method, t0=t0 + 1.0, t_end=21.0, **START, **more)) - end(found)).max() > 0.01


def test_heyokas_tolerance_is_of_the_state_and_not_of_the_time():
    exact = end(pb.integrate(DRIVEN, "heyoka", t_end=1000.0, **START))
    extended = pb.integrate(HAND, "heyoka", tol=1e-8, t_end=1000.0, q0=[1.0, 0.0], p0=[0.5, 0.0])
    rows = pb.integrate(DRIVEN, "heyoka", tol=1e-8, t0=0.0, t_end=1000.0, t_eval=[400.0, 1000.0], **START)
    q, p, _ = pb.prepare(DRIVEN, "heyoka", tol=1e-8, q0=[1.0, 0.0], p0=[0.5, 0.0])(1000.0)
    assert q[1] == 1000.0
    error, control = (np.abs(x - exact).max() for x in (np.array([q[0], p[0]]), end(extended)[[0, 2]]))
    assert error < control / 20
    assert np.abs(end(rows) - exact).max() < control / 20
    assert np.ptp(rows.invariants()["H + p_t"]) < 1e-7


@pytest.mark.parametrize(
    "method", ["blanes-moan-srkn6b", "okunbor-skeel-6", "chin-4a", "omelyan-6-5f5g-v", "hessian-free-adada"]
)
def test_methods_for_a_quadratic_kinetic_energy_keep_their_order(method):
    exact = end(pb.integrate(DRIVEN, "heyoka", t_end=4.0, **START))
    errors = [
        np.abs(end(pb.integrate(DRIVEN, method, h=h, t_end=4.0, **START)) - exact).max() for h in (0.1, 0.05, 0.025)
    ]
    order = pb.method(method).order
    slopes = np.log2(errors[:-1]) - np.log2(errors[1:])
    assert slopes == pytest.approx([order, order], abs=0.5)
    frozen = pb.Hamiltonian(q="q", p="p", H="p**2/2 - cos(q)")
    assert np.abs(end(pb.integrate(frozen, method, h=0.025, t_end=4.0, **START)) - exact).max() > 1e-3


@pytest.mark.parametrize("m", [1, 2])
def test_mathieu_functions(m):
    """y'' + (a - 2 k cos 2t) y = 0 has the even function ce_m for a = a_m(k) (Abramowitz and Stegun, 20.2)."""
    k = 1.5
    system = pb.Hamiltonian(q="y", p="v", H=f"v**2/2 + ({float(mathieu_a(m, k))!r} - 2*{k}*cos(2*t))*y**2/2")
    times = np.linspace(0, 3, 7)
    found = pb.integrate(system, "gauss-8", h=0.05, t_end=3.0, q0=[1.0], p0=[0.0], t_eval=times)
    exact = [mathieu_cem(m, k, np.degrees(t)) for t in (0.0, *times)]
    np.testing.assert_allclose(found.q[:, 0], [x[0] / exact[0][0] for x in exact[1:]], rtol=0, atol=1e-10)


def test_a_rotating_bar_keeps_its_jacobi_integral():
    turned = "(x*cos(t/4) + y*sin(t/4))**2 + 2*(y*cos(t/4) - x*sin(t/4))**2"
    bar = pb.Hamiltonian(q="x y", p="u v", H=f"(u**2 + v**2)/2 + log(1 + {turned})/2")
    found = pb.integrate(bar, "gauss-8", h=0.05, t_end=50.0, q0=[1.0, 0.2], p0=[0.1, 0.9])
    (x, y), (u, v) = found.q.T, found.p.T
    assert np.ptp(found.energy() - (x * v - y * u) / 4) < 1e-13
    assert np.ptp(found.energy()) > 0.01


def test_ensembles_events_and_prepared_runs():
    alone = pb.integrate(DRIVEN, "stormer-verlet", h=0.1, t_end=10.0, **START)
    many = pb.integrate_ensemble(DRIVEN, "stormer-verlet", [[1.0], [2.0]], [[0.5], [0.0]], h=0.1, t_end=10.0)
    np.testing.assert_allclose(many.to_frame().loc[0, ["q", "p"]].astype(float), end(alone), rtol=1e-13)
    q, p, status = pb.prepare(DRIVEN, "stormer-verlet", **START)(0.1, 100)
    np.testing.assert_allclose([q[0], p[0]], end(alone), rtol=1e-13)
    assert status == "ok"
    stopped = pb.integrate(DRIVEN, "gauss-8", h=0.1, t_end=10.0, events={"down": "q"}, stop="down", **START)
    assert stopped.q[-1] == pytest.approx(0.0, abs=1e-12)


def test_the_exponent_of_an_unstable_oscillator_is_floquets():
    """That of the trace of the matrix over a period of q'' = -(1 + cos 2t) q, which is pi."""
    unstable = pb.Hamiltonian(q="q", p="p", H="p**2/2 + (1 + cos(2*t))*q**2/2")
    ends = [end(pb.integrate(unstable, "heyoka", t_end=np.pi, q0=[1 - k], p0=[k])) for k in (0.0, 1.0)]
    exact = np.arccosh(abs(np.trace(ends)) / 2) / np.pi
    found = pb.lyapunov(unstable, "gauss-8", h=np.pi / 40, steps=8000, q0=[1e-100], p0=[0.0])
    assert found.exponent[0] == pytest.approx(exact, rel=1e-3)
    assert exact > 0.1


def leapfrog(system, q, p, h, t):
    p = p - h / 2 * system.dH_dq(q, p, t)
    q = q + h * system.dH_dp(q, p, t)
    return q, p - h / 2 * system.dH_dq(q, p, t + h)


@pytest.mark.parametrize("t0", [0.0, 3.0])
def test_a_step_of_ones_own_is_called_with_the_time(t0):
    own, same = (pb.integrate(DRIVEN, m, h=0.02, t0=t0, t_end=20.0, **START) for m in (leapfrog, "stormer-verlet"))
    assert own.q.shape == (len(own.t), 1)
    np.testing.assert_allclose(own.q, same.q, rtol=0, atol=1e-12)
    spread = [np.ptp(x.invariants()["H + p_t"]) for x in (own, same)]
    assert spread[0] == pytest.approx(spread[1], rel=0.2)
    assert own.counts["gradient"] == 2 * own.counts["steps"]
    late = pb.integrate(DRIVEN, lambda s, q, p, h, t: leapfrog(s, q, p, h, t + 1), h=0.02, t0=t0, t_end=20.0, **START)
    assert np.abs(late.q - same.q).max() > 0.01


def test_the_time_is_that_of_the_run_where_h_does_not_depend_on_it():
    seen = []

    def step(system, q, p, h, t):
        seen.append(t)
        return q + h * system.dH_dp(q, p, t), p

    pb.integrate("pendulum", step, h=0.5, t0=2.0, steps=3)
    assert seen == [2.0, 2.5, 3.0]
    with pytest.raises(pb.InvalidInput, match=r"q of shape \(2,\); it must be \(1,\)"):
        pb.integrate(DRIVEN, lambda s, q, p, h, t: (np.append(q, t), p), h=0.1, steps=1, **START)


def test_orbits_have_their_own_values_of_parameters():
    text = "p**2/2 - w**2*cos(q)"
    swing = pb.Hamiltonian(q="q", p="p", H=text, parameters={"w": 2})
    values, start = [1.0, 3.0, 1.0, 2.0], [[1.0], [0.5], [0.2], [1.0]]
    run, told = {"h": 0.1, "t_end": 2.0}, []
    given = {"w": values, "lam": [0, 0, 1, 0]}
    many = pb.integrate_ensemble(swing, "scheme-i", start, [[0.0]] * 4, **run, parameters=given, progress=told.append)
    assert told[-1] == 4
    for k, w in enumerate(values):
        one = pb.Hamiltonian(q="q", p="p", H=text, parameters={"w": w})
        alone = pb.integrate(one, "scheme-i", **run, q0=start[k], p0=[0.0], parameters={"lam": given["lam"][k]})
        np.testing.assert_allclose([many.q[k], many.p[k]], [alone.q[-1], alone.p[-1]], rtol=1e-13)
    planets = pb.integrate_ensemble(
        "perturbed-kepler", "rk4", [[0.5, 0.0]] * 2, [[0.0, 1.7]] * 2, h=0.01, steps=9, parameters={"mu": [0.0, 0.5]}
    )
    assert planets.q[0, 0] > planets.q[1, 0] + 1e-3
    for wrong in ({"w": [1.0, 2.0]}, {"v": 1.0}, {"w": ["1", 2, 3, 4]}):
        with pytest.raises(pb.InvalidInput, match=next(iter(wrong))):
            pb.integrate_ensemble(swing, "rk4", start, [[0.0]] * 4, **run, parameters=wrong)
    with pytest.raises(pb.InvalidInput, match="the problem is 3; give a system"):
        pb.integrate_ensemble(3, "scheme-i", start, [[0.0]] * 4, **run, parameters={"lam": 1})
    with pytest.raises(pb.InvalidInput, match="the parameter v is in none of the formulas"):
        pb.Hamiltonian(q="q", p="p", H=text, parameters={"w": 1, "v": 2})


@pytest.mark.parametrize("usual", [0.0, 0.1])
def test_a_value_that_takes_the_time_out_of_H(usual):
    H, run, a = SWING.replace("/10)", "*a)"), {"h": 0.02, "t_end": 20.0}, [0.2, 0.0, 0.1]
    swing = pb.Hamiltonian(q="q", p="p", H=H, parameters={"a": usual})
    start = [[[1.0, 3.0], [1.0, 4.0], [0.5, 3.0]], [[0.5, 0.25]] * 3]
    if not usual:
        start = [np.array(x)[:, :1] for x in start]
    many = pb.integrate_ensemble(swing, "rk4", *start, **run, parameters={"a": a}, save_every=500)
    assert many.names == ("q", "t", "p", "p_t")
    for k, value in enumerate(a):
        one = pb.Hamiltonian(q="q", p="p", H=H, parameters={"a": value})
        t0 = start[0][k][1] if usual else 0.0
        alone = pb.integrate(one, "rk4", h=0.02, t0=t0, t_end=t0 + 20, q0=start[0][k][:1], p0=[0.5])
        np.testing.assert_allclose([many.q[k, 0], many.p[k, 0]], end(alone), rtol=0, atol=1e-12)
        np.testing.assert_allclose(many.Q[k, :, 1], t0 + many.times[k])
    assert many.P[1, :, 1].tolist() == [0.25 if usual else 0.0] * 3
    assert abs(many.p[0, 1] - many.P[0, 0, 1]) > 1e-3
    if usual:
        none = pb.integrate_ensemble(swing, "rk4", *start, **run, parameters={"a": 0})
        np.testing.assert_array_equal(none.q[1], many.q[1])


def test_its_figure_is_a_phase_portrait():
    axes = pb.integrate(DRIVEN, "rk4", h=0.1, t_end=5.0, **START).plot().axes
    assert [x.get_ylabel() for x in axes] == ["H - H(0)", "p"]


@pytest.mark.parametrize("t0", [0, 2])
def test_command_line(t0):
    told = ["--hamiltonian", SWING, "--q", "1", "--p", "0.5", "--h", "0.1", "--t0", str(t0), "--t-end", "10", "--error"]
    found = integrate_json("gauss-8", *told, "--quantity", "trajectory")
    assert len(found["q"]) == len(found["p"]) == 1
    assert found["global_error"] < 1e-12
    assert found["quantity_error"]["error"] < 1e-12
    assert found["energy_error"]["max"] < 1e-14


@pytest.mark.parametrize("method", ["variational-midpoint", "quinlan-tremaine-8"])
def test_methods_that_take_the_momenta_for_velocities_are_refused(method):
    with pytest.raises(pb.InvalidInput, match="constant mass matrix"):
        pb.integrate(DRIVEN, method, h=0.1, t_end=1.0, **START)


def test_a_coordinate_may_be_called_t():
    assert pb.Hamiltonian(q="t", p="p", H="p**2/2 + t**2").d == 1
    assert "t" not in repr(DRIVEN).split("H=")[0].replace("Hamiltonian", "")
    with pytest.raises(pb.InvalidInput, match="has 2 components; the problem has d = 1"):
        pb.integrate(pb.Hamiltonian(q="t", p="p", H="p**2/2 + t**2"), "rk4", h=0.1, t_end=1.0, q0=[1.0, 2.0], p0=[0.0])
