"""Simplified models: reduced systems have their stated accuracy; the fastest one that suffices is chosen."""

from __future__ import annotations

from math import atan2, hypot, pi
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import sympy as sp
from scipy.integrate import solve_ivp

from phasebench.benchmarks.measure.quantities import END_STATE
from phasebench.benchmarks.problems import klein_gordon, problem
from phasebench.benchmarks.problems.models import one_body, planets, springs, waves
from phasebench.benchmarks.problems.models.ladders import LADDERS
from phasebench.benchmarks.studies.models import choice, envelope, measure
from phasebench.integrators.driver import integrate

A, B, C = "least", "middle", "full"


# -- the systems -------------------------------------------------------------------------------------------------------


def solve_with_scipy(made, t_end, **more):
    """SciPy's solution (DOP853, rtol 1e-12) of a problem to ``t_end``."""
    s = made.system
    f = sp.lambdify((*s.q, *s.p), [*s.dq, *s.dp], cse=True)
    y0 = [*made.q0, *made.p0]
    return solve_ivp(lambda t, y: f(*y), (0, t_end), y0, method="DOP853", rtol=1e-12, atol=1e-34, **more)


def end(made, t_end):
    return solve_with_scipy(made, t_end).y[: made.system.d, -1]


def test_every_ladder_ends_with_the_full_problem():
    for ladder in LADDERS:
        full = ladder.rungs[-1].make()
        assert full.system.H == problem(ladder.problem, **dict(ladder.parameters)).system.H
        assert measure.quantity_of(full, ladder.quantity).rows == 1
        assert len({r.name for r in ladder.rungs}) == len(ladder.rungs) > 1
    assert len({ladder.id for ladder in LADDERS}) == len(LADDERS) >= 6


def pericentre(e, mu):
    """(time, angle beyond 2 pi in radians) of the next pericentre of the full problem."""

    def turning(t, y):
        return y[0] * y[2] + y[1] * y[3] if t > 4 else -1.0  # after the apocentre

    turning.direction, turning.terminal = 1, True
    found = solve_with_scipy(problem("perturbed-kepler", e=e, mu=mu), 20.0, events=turning)
    x, y = found.y_events[0][0][:2]
    return found.t_events[0][0], atan2(y, x)


def test_averaged_model_is_first_order_in_mu():
    """The averaged model's radial period and advance are wrong by O(mu^2), the Kepler model's period by O(mu)."""
    wrong = {}
    for mu in (1e-3, 1e-4):
        averaged = one_body.kepler_models(0.3, mu)[2]
        a = one_body.mean_semi_axis(0.3, mu)
        period = 2 * pi * a**1.5 / averaged.rate
        one = np.array([[1.0, 0.0]])
        (x, y), _ = (z[0] for z in averaged.lift(None, np.array([period]), one, one))
        t, advance = pericentre(0.3, mu)
        wrong[mu] = abs(period - t), abs(atan2(y, x) - advance), abs(2 * pi - t)
        made = averaged.make()
        assert hypot(*made.q0) * hypot(*made.p0) == pytest.approx((1 - 0.3**2) ** 0.5, rel=1e-14)
    ratios = np.array(wrong[1e-3]) / np.array(wrong[1e-4])
    assert (ratios[:2] > 60).all()
    assert 8 < ratios[2] < 12


def test_soft_chain_is_accurate_to_its_order_in_omega():
    """The model's error times omega^2 falls with omega if the model has all terms of that order; else it stays."""
    far = {}
    for omega in (50.0, 150.0):
        true = end(problem("fpu", omega=omega), 2.0)[:3]
        far[omega] = [omega**2 * np.abs(end(springs.soft_chain(k, omega), 2.0) - true).max() for k in range(3)]
    ratios = np.array(far[50.0]) / np.array(far[150.0])
    assert ratios[2] > 2
    assert (abs(ratios[:2] - 1) < 0.3).all()


def test_spring_models_start_at_the_full_state():
    full = problem("fpu")
    slow = springs.soft_chain(0)
    q, p = springs.fpu_models()[0].lift(full, np.zeros(1), np.array([slow.q0]), np.array([slow.p0]))
    assert np.abs(q[0] - full.q0).max() < 1e-15
    assert np.abs(p[0] - full.p0).max() < 1e-15


def test_massless_planet_moves_about_a_fixed_sun():
    alone = end(planets.about_the_sun("jupiter")(), 1000.0)
    pair, massless = planets.bodies(("sun", "jupiter")), planets.bodies(("sun", "jupiter"), massless=("jupiter",))
    assert np.abs(end(massless(), 1000.0)[3:] - alone).max() < 1e-9
    assert np.abs(end(pair(), 1000.0)[3:] - alone).max() > 1e-4


def test_bodies_of_a_model_have_their_full_state():
    full = problem("outer-solar-system")
    made = planets.bodies(("sun", "saturn"))()
    q, p = planets.of_bodies("sun", "saturn")(full, np.zeros(1), np.array([made.q0]), np.array([made.p0]))
    for found, whole in ((q, full.q0), (p, full.p0)):
        np.testing.assert_array_equal(found[0, [0, 1, 2, 6, 7, 8]], np.array(whole)[[0, 1, 2, 6, 7, 8]])
        assert np.isnan(found[0, 3:6]).all()
        assert np.isnan(found[0, 9:]).all()


def test_interpolation_reproduces_trigonometric_polynomials():
    full = problem("klein-gordon")

    def sampled(n, k):
        x = 2 * pi * np.arange(n) / n
        field = (np.exp(1j * k * x) + 0.5) * (full.parameters["L"] / n) ** 0.5
        return np.hstack([field.real, field.imag])[None]

    for k, exact in ((3, True), (-7, True), (9, False)):
        q, _ = waves.interpolate(full, None, sampled(16, k), sampled(16, k))
        assert (np.abs(q - sampled(64, k)).max() < 1e-14) == exact


def test_linear_waves_lack_only_the_nonlinear_term():
    system = waves.linear_waves().system
    H = sp.lambdify((*system.q, *system.p), system.H)
    y = np.random.default_rng(1).standard_normal(4 * 64)
    loop = klein_gordon.energy(*map(float, system.constants))
    whole = klein_gordon.energy(*map(float, problem("klein-gordon").system.constants))
    assert H(*y) == pytest.approx(loop(y[:128], y[128:])[0], rel=1e-13)
    assert H(*(2 * y)) == pytest.approx(4 * H(*y), rel=1e-13)
    assert whole(y[:128], y[128:])[0] > 1.01 * H(*y)


def test_uncertainty_of_a_model_reference():
    """It is three times the difference of the two finest runs (here of error 1 / steps), at least some round-off."""
    model = SimpleNamespace(steps=[1, 2, 4], quantity=END_STATE, values=lambda id, steps: np.array([1 + 1 / steps]))
    values, uncertainty = measure.reference(model)
    assert list(values) == [1.125]
    assert uncertainty == pytest.approx(3 * 0.125, rel=1e-12, abs=0)
    model.values = lambda id, steps: np.array([2.0])
    assert measure.reference(model)[1] == 4 * 2.0**-52 * 2


def test_measured_errors_of_the_pendulum_models():
    """From 1/2: Lindstedt's frequency leaves an error of fifth order in the amplitude, the linear one of third."""
    tables = measure.models_of("pendulum-0.5")
    rows = tables[measure.MODELS]
    errors = [r["modelling error"] for r in rows]
    assert errors[0] == pytest.approx(0.5**3 / 16 * 10 * abs(np.sin(10)) * 1.7, rel=0.3)
    assert errors[1] < errors[0] / 20
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] == 0.0
    assert all(r["integration"] < 0.01 * r["modelling error"] for r in rows[:-1])
    assert rows[-1]["integration"] < 1e-9
    runs = pd.DataFrame(tables[measure.RUNS])
    assert (runs.groupby(["rung", "method"])["error"].min() < 1e-9).all()
    assert (runs["seconds"] > 0).all()


def test_models_of_several_sizes_in_one_process():
    """Prepared runs of models with different d, whose states are arrays, do not disturb each other."""
    (ladder,) = (x for x in LADDERS if x.id == "klein-gordon-points")
    full = ladder.rungs[-1].make()
    for rung in (*ladder.rungs[1::-1], ladder.rungs[-1]):
        model = measure.prepare_model(ladder, rung, full)
        run, n = model.runs[measure.METHODS[1]], 160
        q, p, code = run(model.h(n), n)
        assert code == run.SOLVED
        s = integrate(rung.make(), measure.METHODS[1], h=model.h(n), steps=n, save_every=0)
        assert (np.abs(q - s.q[-1]).max(), np.abs(p - s.p[-1]).max()) == (0.0, 0.0)


# -- the choice --------------------------------------------------------------------------------------------------------


def scene(name="s", errors=(1e-2, 1e-5), integration=1e-14, scale=(1.0, 2.0, 10.0), full_off=1e-13):
    """(models, runs): fabricated tables of two or more models of one problem.

    ``errors`` are modelling errors of the simplified models; a run of a model with error 10^-n takes ``scale`` times n
    seconds.
    """
    names = (A, B, C)[: len(errors)] + (C,)
    rows = [
        {"scene": name, "rung": k, "model": m, "full": m == C, "d": 1, "modelling error": e, "uncertainty": 1e-15}
        | {"integration": full_off if m == C else integration, "source": "certified"}
        for k, (m, e) in enumerate(zip(names, (*errors, 0.0), strict=True))
    ]
    runs = [
        {"scene": name, "rung": k, "method": "m", "steps": n, "error": 10.0**-n, "seconds": s * n}
        for k, s in enumerate(scale)
        for n in range(1, 13)
    ]
    return pd.DataFrame(rows), pd.DataFrame(runs)


def test_cheapest_sufficient_model_is_chosen():
    frames = scene()
    chosen = {a: choice.at(*frames, a) for a in (1e-1, 1e-3, 1e-6, 1e-14)}
    assert chosen[1e-1] == (A, 10 / 2, False)  # one finer step: less than 1e-1 is left to the integration
    assert chosen[1e-3] == (B, 30 / 8, False)
    assert chosen[1e-6] == (C, 1.0, True)
    assert chosen[1e-14][0] == "none"
    assert choice.at(*scene(scale=(1.0, 100.0, 10.0)), 1e-3)[0] == C  # a model more expensive than the full one


def test_gain_and_waste_at_the_models_own_accuracy():
    rungs = choice.rungs(*scene()).set_index("model")
    assert list(rungs.index) == [A, B]
    assert rungs.loc[A, "gain"] == 10 * 2 / 2
    assert rungs.loc[A, "wasted"] == 10 / 2
    assert rungs.loc[B, "wasted"] == 20 / 10
    # the full model may err by twice the modelling error, the reduced model's total
    assert choice.rungs(*scene(errors=(6e-3, 1e-5)))["gain"][0] == 10 * 2 / 3
    assert np.isnan(choice.rungs(*scene(errors=(1e-2, 1e-11))).set_index("model").loc[B, "wasted"])


def test_model_is_compared_at_twice_its_error():
    rungs = choice.rungs(*scene(errors=(4e-2, 1e-10))).set_index("model")
    assert rungs.loc[A, "gain"] == 20 / 2
    assert rungs.loc[A, "known to"] == pytest.approx(1.1e-14 / 4e-2, rel=1e-9, abs=0)
    assert np.isnan(rungs.loc[B, "wasted"])
    assert [round(float(np.log10(a)), 9) for a in choice.ACCURACIES] == [-1, -2, -3, -4, -6, -8, -10]


def test_curve_of_a_model_has_the_runs_that_no_faster_one_beats():
    dearer = pd.DataFrame({"seconds": [1.0, 2.0, 3.0], "error": [1e-3, 1e-2, 1e-4]})
    assert envelope(dearer, 0.0)[0].tolist() == [1.0, 3.0]
    assert envelope(dearer, 1.0)[1].tolist() == pytest.approx([1.001, 1.0001], abs=1e-12)
