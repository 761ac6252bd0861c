"""Measures of options: each where the answer is known."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.studies.options import arithmetic, ladders, lambdas, nodes, solvers
from phasebench.integrators.driver import integrate
from phasebench.integrators.registry import method
from phasebench.integrators.stepping.kernel import prepare
from phasebench.reference.certificates import stored


def test_errors_over_lambda_equal_single_runs():
    made, lams, h, steps = problem("pendulum:swinging"), [Fraction(0), Fraction(1, 3), Fraction(1, 2)], 0.1, 20
    fine = integrate(made, "gauss-6", h=h / 4, steps=4 * steps, save_every=40)
    true = np.hstack([fine.q, fine.p])[1:]
    found = lambdas.errors(made, "scheme-i", lams, h * steps, steps, true)
    for lam, (end, worst) in zip(lams, found, strict=True):
        alone = integrate(made, "scheme-i", parameters={"lam": lam}, h=h, steps=steps, save_every=10)
        apart = np.abs(np.hstack([alone.q, alone.p])[1:] - true).max(axis=1)
        assert (end, worst) == pytest.approx((apart[-1], apart.max()), rel=1e-9)
    assert found[2][1] < 0.2 * found[0][1], "of order 2 at 1/2 alone"


def test_largest_step_is_below_the_closed_form():
    """Scheme I on the oscillator is stable for h omega < 2 / |1 - 2 lambda|, at 1/2 for every h.

    Just below the limit its ellipse is so elongated that the energy error exceeds the tolerance.
    """
    made = problem("harmonic-oscillator")
    lams = [Fraction(-1), Fraction(0), Fraction(1, 2), Fraction(2)]
    found = lambdas.largest(made, "scheme-i", lams, 0.5)
    for lam, h in zip(lams, found, strict=True):
        limit = 2 / abs(1 - 2 * float(lam)) if lam != Fraction(1, 2) else np.inf
        assert h <= limit
        longer = [0.5 * x for x in lambdas.LENGTHS if 0.5 * x > h]
        assert lam == Fraction(1, 2) or longer[0] > limit * 0.5
    assert found[2] == 0.5 * lambdas.LENGTHS[-1]


def test_avf_with_one_node_is_the_midpoint_rule():
    made = problem("pendulum:swinging")
    one = nodes.Run(made, 1, 0.1)
    assert one()
    midpoint = integrate(made, "implicit-midpoint", h=0.1, steps=nodes.STEPS)
    assert np.abs(one.Q - midpoint.q[1:]).max() < 1e-10
    own = nodes.Run(made, nodes.CONFIRMED, 0.1)
    assert own()
    assert own.energy_error() < 1e-14 < 1e-4 < one.energy_error()
    five = nodes.with_nodes(prepare(method(nodes.METHOD), made.system), 5).step
    assert set(five.nodes) == {5}
    assert len(five.nodes) == five.rows[0] == len(five.b) == 2, "five nodes in two rows of four lanes"
    assert np.sum(five.b) == pytest.approx(1, abs=1e-15)
    three = nodes.Run(made, 3, 0.1)
    assert three()
    assert 1e-13 < three.energy_error() < 1e-10, "no rule that it confirms itself"


def test_plain_sums_equal_the_method_up_to_round_off():
    made = problem("henon-heiles:box")
    q, _ = arithmetic.starts(made)
    assert (q[0] == made.q0).all()
    assert np.abs(q - q[0]).max() <= arithmetic.SPREAD
    found = arithmetic.ends(made, 0.05, 100)
    exact = arithmetic.plain(made, 0.05, 100, np.longdouble)
    off = {name: np.abs(end - exact).max() for name, end in found.items()}
    assert 1e-8 < off[arithmetic.SINGLE] < 1e-4
    assert off[arithmetic.PLAIN] < 1e-13
    assert 0 < off[arithmetic.COMPENSATED] < 0.3 * off[arithmetic.PLAIN]
    assert exact.dtype == np.longdouble, "nothing on the way is rounded to a double"


@pytest.mark.parametrize("name", arithmetic.SCENES)
def test_scenes_of_the_plain_loop_have_unit_masses(name):
    system = problem(name).system
    assert system.unit_mass
    assert np.array(arithmetic.slope(system)(np.ones((system.d, 2), np.float32))).dtype == np.float32


def test_rungs_have_the_error_of_their_final_state(monkeypatch):
    key = ladders.COMPOSITION, "pendulum:swinging"
    monkeypatch.setitem(ladders.LADDERS, key, (1.0, 10, 3))
    monkeypatch.setattr(ladders, "ROUNDS", 1)
    few = {"2": method("stormer-verlet"), "4": method("suzuki-4")}
    monkeypatch.setitem(ladders.SETTINGS, ladders.COMPOSITION, few)
    rows = pd.DataFrame(ladders.ladders(*key))
    assert list(rows["steps"]) == [10, 14, 20] * 2
    for setting, part in rows.groupby("setting"):
        ratio = part["error"].iloc[0] / part["error"].iloc[2]
        assert np.log2(ratio) == pytest.approx(int(setting), abs=0.2)
    assert (rows["us"] > 0).all()


def test_every_setting_has_the_order_and_a_certified_end():
    for (option, scene), (t_end, *_) in ladders.LADDERS.items():
        made = problem(scene)
        assert stored.end(made, t_end) is not None
        assert all(record.lacks(made.system) is None for record in ladders.SETTINGS[option].values())
    assert {k: m.order for k, m in ladders.SETTINGS[ladders.COMPOSITION].items()} == {
        str(p): p for p in (2, 4, 6, 8, 10)
    }
    for name, record in ladders.SETTINGS[ladders.GENERATING].items():
        assert record.order == ladders.ORDERS[name][0] + name.endswith("1/2")
    assert {m.energy for m in ladders.SETTINGS[ladders.ENERGY].values()} == {"round-off"}


@pytest.mark.parametrize("start", [solvers.ZERO, solvers.POLYNOMIAL, solvers.FIVE])
@pytest.mark.parametrize("solver", [solvers.FIXED, solvers.SIMPLE, solvers.NEWTON])
def test_every_solver_and_start_gives_the_same_step(solver, start):
    made, h, steps = problem("henon-heiles:box"), 0.2, 10
    field = made.system.vector_field()
    loop = solvers.Loop(lambda y: field(0.0, y), np.array([*made.q0, *made.p0]), h, solver, start, solvers.ROUND_OFF)
    assert loop.run(steps)
    own = integrate(made, solvers.METHOD, h=h, steps=steps, save_every=0)
    assert np.abs(loop.y - np.concatenate([own.q[-1], own.p[-1]])).max() < 1e-14


def test_newton_solves_linear_equations_at_once():
    """On y' = w J y the first correction is exact; the fixed-point iteration needs h w < 2, about."""

    def loop(solver, w):
        return solvers.Loop(
            lambda y: w * np.array([y[1], -y[0]]), np.array([1.0, 0.0]), 1.0, solver, solvers.ZERO, 1e-5
        )

    newton, fast, slow = loop(solvers.SIMPLE, 20.0), loop(solvers.FIXED, 20.0), loop(solvers.FIXED, 0.5)
    assert newton.run(3)
    assert newton.iterations == 2 * 3, "and the second confirms it"
    assert newton.evaluations == 3 * (2 * solvers.STAGES + 3)
    assert np.hypot(*newton.y) == pytest.approx(1, abs=1e-4)
    assert not fast.run(3)
    assert slow.run(3)
    assert slow.evaluations == solvers.STAGES * slow.iterations


def test_solver_rows_on_the_oscillator(monkeypatch):
    """The step multiplies q + ip by the (3, 3) Pade approximation of exp at -ih."""
    h, steps = 0.5, 5
    monkeypatch.setitem(solvers.SCENES, "harmonic-oscillator", (h,))
    monkeypatch.setattr(solvers, "STEPS", steps)
    rows = pd.DataFrame(solvers.solvers("harmonic-oscillator"))
    assert len(rows) == len(solvers.SETTINGS) + 1
    assert set(rows["status"]) == {"ok"}
    made, z = problem("harmonic-oscillator"), -1j * h
    above, below = (1 + s * z / 2 + z**2 / 10 + s * z**3 / 120 for s in (1, -1))
    apart = (made.q0[0] + 1j * made.p0[0]) * ((above / below) ** steps - np.exp(z * steps))
    to_round_off = rows[rows["tol"] == solvers.ROUND_OFF]
    assert to_round_off["error"].to_numpy() == pytest.approx(max(abs(apart.real), abs(apart.imag)), rel=1e-6)
    loop = rows[rows["solver"] != solvers.ENGINE]
    fixed = loop[loop["solver"] == solvers.FIXED]
    assert fixed["evaluations"].to_numpy() == pytest.approx(solvers.STAGES * fixed["iterations"].to_numpy())
    assert loop["iterations"].between(1, solvers.MOST).all()
    assert loop["iterations"].max() > 2 * loop["iterations"].min()


@pytest.mark.parametrize("scene", solvers.SCENES)
def test_reference_of_a_solver_is_finer_than_its_error(scene):
    made, h, few = problem(scene), max(solvers.SCENES[scene]), 4

    def end(id, parts):
        run = integrate(made, id, h=h / parts, steps=few * parts, save_every=0)
        assert run.status == "ok"
        return np.concatenate([run.q[-1], run.p[-1]])

    own, fine, finer = end(solvers.METHOD, 1), end(solvers.FINE, 4), end(solvers.FINE, 8)
    assert np.abs(fine - finer).max() < 0.02 * np.abs(own - finer).max()


@pytest.mark.parametrize(("start", "degree", "steps"), [(solvers.POLYNOMIAL, 2, 1), (solvers.FIVE, 4, 5)])
def test_start_extrapolates_polynomials_of_its_degree(start, degree, steps):
    """y' = (1, y_0^k): the slopes are the k-th powers of the stages' times."""

    def distance(k: int) -> float:
        loop = solvers.Loop(lambda y: np.array([1.0, y[0] ** k]), np.zeros(2), 0.5, solvers.FIXED, start, 0.0)
        assert loop.run(steps)
        times = 0.5 * (steps + loop.c)
        return np.abs(loop.first() - np.array([np.ones_like(times), times**k]).T).max()

    assert distance(degree) < 1e-11
    assert distance(degree + 1) > 1e-3
