"""Flow-composed implicit Runge-Kutta methods beside a plain implementation; orders, structure, and equal costs.

``python test_fcirk.py`` prints what a process with NUMBA_DISABLE_JIT=1 measures.
"""

from __future__ import annotations

import json
from dataclasses import replace
from fractions import Fraction
from math import log

import mpmath
import numpy as np
import pytest

from phasebench.benchmarks.measure import multiprecision
from phasebench.benchmarks.problems import problem
from phasebench.integrators import driver, integrate, prepare, trajectory
from phasebench.integrators.compile.codegen import DOUBLE, MULTIPRECISION, precision, to_number
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.families import fcirk
from phasebench.integrators.registry import method
from phasebench.integrators.stepping import kepler_flow, kepler_tangent
from phasebench.integrators.stepping.kernel import array
from phasebench.integrators.systems.hamiltonian import Hamiltonian
from support.solutions import distance

DIGITS, H = 30, Fraction(1, 10)
MADE = problem("perturbed-kepler")
PLANETS = "outer-solar-system"


def record(stages: int):
    return method("fcirk", stages=stages)


# -- a plain implementation: Kepler's equation in the eccentric anomaly, derivatives by differences --------------------


def kepler(y, t):
    """The flow of |p|^2/2 - 1/|q| on an ellipse, y = (q1, q2, p1, p2)."""
    q, v = y[:2], y[2:]
    r = mpmath.sqrt(q[0] ** 2 + q[1] ** 2)
    a = 1 / (2 / r - v[0] ** 2 - v[1] ** 2)
    n, c, s = a ** mpmath.mpf(-1.5), 1 - r / a, (q[0] * v[0] + q[1] * v[1]) / mpmath.sqrt(a)
    x = n * t
    for _ in range(100):
        dx = (x - c * mpmath.sin(x) + s * (1 - mpmath.cos(x)) - n * t) / (1 - c * mpmath.cos(x) + s * mpmath.sin(x))
        x -= dx
        if abs(dx) < mpmath.mpf(10) ** (-mpmath.mp.dps // 2 - 5):
            break
    sin, cos = mpmath.sin(x), mpmath.cos(x)
    end = a * (1 - c * cos + s * sin)
    f, g = 1 - a / r * (1 - cos), t - (x - sin) / n
    df, dg = -mpmath.sqrt(a) / (end * r) * sin, 1 - a / end * (1 - cos)
    return [f * q[i] + g * v[i] for i in (0, 1)] + [df * q[i] + dg * v[i] for i in (0, 1)]


def slow_field(k, w, t):
    """D phi_-t (phi_t(w)) J grad B, B = -k / r^3, the derivative by central differences."""
    y = kepler(w, t)
    r = mpmath.sqrt(y[0] ** 2 + y[1] ** 2)
    kick = [-3 * k * y[i] / r**5 for i in (0, 1)]
    d = mpmath.mpf(10) ** (-mpmath.mp.dps // 3)
    there = [y[0], y[1], y[2] + d * kick[0], y[3] + d * kick[1]]
    back = [y[0], y[1], y[2] - d * kick[0], y[3] - d * kick[1]]
    return [(a - b) / (2 * d) for a, b in zip(kepler(there, -t), kepler(back, -t), strict=True)]


def gauss(s):
    """Nodes, matrix and weights of Gauss's methods of 1 and 2 stages, as in textbooks."""
    half, third = mpmath.mpf(1) / 2, mpmath.sqrt(3) / 6
    if s == 1:
        return [half], [[half]], [mpmath.mpf(1)]
    quarter = mpmath.mpf(1) / 4
    return [half - third, half + third], [[quarter, quarter - third], [quarter + third, quarter]], [half, half]


def plain(stages: int, steps: int, shift=0):
    """(q, p) after some steps; ``shift`` moves the times of the stages, a control."""
    c, A, b = gauss(stages)
    h = mpmath.mpf(H.numerator) / H.denominator
    r = MADE.system.q[0]
    strength = -MADE.system.H.subs({MADE.system.q[1]: 0, **dict.fromkeys(MADE.system.p, 0)}).subs(r, 1) - 1
    k = mpmath.mpf(strength.p) / strength.q
    y = [mpmath.mpf(x) for x in (*MADE.q0, *MADE.p0)]
    for _ in range(steps):
        w = kepler(y, h / 2)
        W = [w] * stages
        for _ in range(100):
            F = [slow_field(k, x, (t + shift - mpmath.mpf(1) / 2) * h) for x, t in zip(W, c, strict=True)]
            new = [[x + h * sum(a * f[i] for a, f in zip(row, F, strict=True)) for i, x in enumerate(w)] for row in A]
            moved = max(abs(a - b) for r, s in zip(W, new, strict=True) for a, b in zip(r, s, strict=True))
            W = new
            if moved < mpmath.mpf(10) ** (-DIGITS - 4):
                break
        y = kepler([x + h * sum(a * f[i] for a, f in zip(b, F, strict=True)) for i, x in enumerate(w)], h / 2)
    return y


# -- without round-off -------------------------------------------------------------------------------------------------


def differences() -> dict:
    """{stages: distances from the plain implementation after 1 and 50 steps}, and after one of moved times."""
    found: dict = {}
    with precision(DIGITS):
        for stages in (1, 2):
            chosen, start = record(stages), {"q0": MADE.q0, "p0": MADE.p0, "arithmetic": MULTIPRECISION}
            ends = [integrate(MADE.system, chosen, h=H, steps=n, **start) for n in (1, 50)]
            with mpmath.workdps(3 * DIGITS):
                found[stages] = [distance(s, plain(stages, n)) for s, n in zip(ends, (1, 50), strict=True)]
                found[f"{stages}, other times"] = distance(ends[0], plain(stages, 1, mpmath.mpf("0.01")))
    return found


def orders() -> dict:
    """{stages: observed orders on perturbed Kepler}."""
    found = {}
    with precision(90):
        system, y, end, _ = multiprecision.reference("perturbed-kepler")
        for stages in (1, 2, 3, 5):
            errors = [
                max(abs(multiprecision.advance(system, record(stages), y, multiprecision.SPAN / n, n) - end))
                for n in (1, 2, 3)
            ]
            found[stages] = [float(log(errors[i] / errors[i + 1]) / log((i + 2) / (i + 1))) for i in (0, 1)]
    return found


def defects() -> dict:
    """{label: (symplecticity, symmetry) of a step}; of wrong coefficients, too."""
    found = {}
    with precision(40):
        found["right"] = _defects()
        right = fcirk.prepare
        for name in ("A", "times"):

            def wrong(*arguments, name=name):
                made = right(*arguments)
                x = np.array(getattr(made.step, name))
                x.flat[0] = x.flat[0] * (1 + to_number(Fraction(1, 1000), MULTIPRECISION))
                return replace(made, step=made.step._replace(**{name: x}))

            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(fcirk, "prepare", wrong)
                found[name] = _defects()
    return found


def _defects() -> list[float]:
    chosen, name = record(3), "perturbed-kepler"
    return [multiprecision.defect(chosen, name), multiprecision.distance(chosen, name)]


@pytest.fixture(scope="module")
def there(uncompiled):
    """Results of this module without compilation."""
    return uncompiled("integrators/test_fcirk.py")


@pytest.mark.parametrize("stages", ["1", "2"])
def test_steps_are_those_of_a_plain_implementation(there, stages):
    one, fifty = there["differences"][stages]
    assert one < 1e-28
    assert fifty < 1e-25
    assert there["differences"][f"{stages}, other times"] > 1e-9


def test_compiled_steps_are_those_of_a_plain_implementation():
    s = integrate(MADE, record(2), h=float(H), steps=50)
    with mpmath.workdps(2 * DIGITS):
        assert distance(s, plain(2, 50)) < 2e-13


@pytest.mark.parametrize("stages", ["1", "2", "3", "5"])
def test_the_order_is_twice_the_stages(there, stages):
    assert max(abs(o - 2 * int(stages)) for o in there["orders"][stages]) < 0.1


def test_a_step_is_symplectic_and_symmetric(there):
    symplecticity, symmetry = there["defects"]["right"]
    assert symplecticity < 1e-22
    assert symmetry < 1e-36
    assert there["defects"]["A"][0] > 1e-18
    assert there["defects"]["times"][1] > 1e-15  # other times: symplectic, not symmetric
    assert there["defects"]["times"][0] < 1e-22


# -- the derivative of Kepler's flow -----------------------------------------------------------------------------------


#: The speed of a parabola from the start below, where v^2 = 2 / r; the velocity is this times (0.1, 1, 0.05).
PARABOLIC = (2 / 1.05**0.5 / 1.0125) ** 0.5


@pytest.mark.parametrize(
    ("speed", "h"),
    [
        (1.0, 0.3),
        (1.1, -0.7),
        (1.0, 9.0),
        (0.9, 40.0),
        (0.9, -40.0),
        (2.0**0.5, 0.8),
        (PARABOLIC, 0.8),
        (1.9, 1.3),
        (1.9, -3.0),
    ],
)
def test_a_kick_is_transported_back_as_differences_say(speed, h):
    """Ellipses, over several periods, a parabola, and hyperbolas; against central differences of the flow."""
    table = array(kepler_flow.constants(DOUBLE), DOUBLE)
    X, spans = np.zeros((4, 3)), np.zeros(3)
    X[0], X[1] = (1.0, 0.1, -0.2), (0.1 * 0.3, speed * 0.3, 0.05 * 0.3)
    mass, eps, kick, there = 0.3, 2.0**-52, np.array([0.02, -0.03, 0.01]), X.copy()
    kepler_tangent.move(X, 0, 3, mass, 1.0, h, eps, table, spans, 0, 1)
    kepler_flow.advance(there, 0, 3, mass, 1.0, h, eps, table)
    assert np.abs(X[:2] - there[:2]).max() < 1e-12
    kepler_tangent.kick_back(X, 0, 3, mass, 1.0, h, eps, table, spans, 0, 1, kick, 2)
    ends, d = [], 1e-4
    for sign in (2, 1, -1, -2):
        Y = np.zeros((4, 3))
        Y[:2] = X[:2]
        Y[1] += sign * d * kick
        kepler_flow.advance(Y, 0, 3, mass, 1.0, -h, eps, table)
        ends.append(Y[:2].copy())
    expected = (8 * (ends[1] - ends[2]) - (ends[0] - ends[3])) / (12 * d)
    assert np.abs(X[2:4] - expected).max() < 1e-9 * np.abs(expected).max()
    assert np.abs(X[2:4]).max() > 1e-2


# -- runs --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["perturbed-kepler", PLANETS])
def test_states_do_not_depend_on_rows_or_pieces(name, monkeypatch):
    made, h = problem(name), {"perturbed-kepler": 0.1, PLANETS: 200.0}[name]
    every = integrate(made, "fcirk", h=h, steps=30)
    some = integrate(made, "fcirk", h=h, steps=30, save_every=7)
    assert np.array_equal(some.q[:-1], every.q[:-1:7])
    for module in (driver, trajectory):
        monkeypatch.setattr(module, "PIECE", 4)
    pieces = integrate(made, "fcirk", h=h, steps=30, save_every=0)
    run = prepare(made, "fcirk")
    run(0.9 * h, 5)
    q, p, status = run(h, 30)
    for end in (some, pieces):
        assert (end.q[-1] == every.q[-1]).all()
        assert (end.p[-1] == every.p[-1]).all()
    assert (q == every.q[-1]).all()
    assert (p == every.p[-1]).all()
    assert status == every.status == "ok"


def test_kepler_is_solved_exactly():
    made = problem("kepler", e=0.6)
    one, many = (integrate(made, "fcirk", h=30.0 / n, steps=n) for n in (7, 200))
    assert np.abs(one.q[-1] - many.q[-1]).max() < 1e-12
    assert one.counts["gradient"] <= 2 * 8 * 7


def error_and_cost(made, exact, id: str, h: float, T: float) -> tuple[float, int]:
    """(largest error of q at the time T, evaluations of the gradient) of a method with steps h."""
    s = integrate(made, id, h=h, t_end=T, save_every=0)
    return float(np.abs(s.q[-1] - exact.q[-1]).max()), s.counts["gradient"]


def test_an_eccentric_orbit_at_equal_steps_and_at_equal_costs():
    """What Kepler's flow takes from Gauss's method, at e = 0.6; Wisdom and Holman's splitting has as many gradients."""
    exact = integrate(MADE, "gauss-8", h=0.02, t_end=20.0, save_every=0)
    mine, costs = error_and_cost(MADE, exact, "fcirk", 0.2, 20.0)
    gauss, more = error_and_cost(MADE, exact, "gauss-8", 0.2, 20.0)
    split, as_many = error_and_cost(MADE, exact, "wisdom-holman", 0.2 / 40, 20.0)
    assert mine < 1e-10
    assert gauss > 5 * mine
    assert more > costs
    assert split > 1e4 * mine
    assert as_many > 0.9 * costs


@pytest.mark.thorough
def test_the_planets_at_equal_costs():
    """Over 400 years, at nearly circular orbits: Gauss's quadrature of the interaction makes the error of both.

    So fcirk has the error of Gauss's method with the same steps, for fewer gradients; a splitting for near-integrable
    systems has a smaller one for as many.
    """
    made, T = problem(PLANETS), 146000.0
    exact = integrate(made, "gauss-8", h=150.0, t_end=T, save_every=0)
    mine, costs = error_and_cost(made, exact, "fcirk", 1000.0, T)
    gauss, more = error_and_cost(made, exact, "gauss-8", 1000.0, T)
    split, as_many = error_and_cost(made, exact, "wisdom-holman", 20.0, T)
    near, fewer = error_and_cost(made, exact, "wisdom-holman-aba-10-6-4", 200.0, T)
    assert gauss / mine == pytest.approx(1, abs=0.2)
    assert more > 1.8 * costs
    assert split > 10 * mine
    assert as_many > costs
    assert near < 1e-3 * mine
    assert fewer < costs


def test_energy_and_angular_momentum_do_not_drift():
    s = integrate(MADE, record(3), h=0.1, steps=20_000, save_every=10)
    E, L = s.energy(), s.q[:, 0] * s.p[:, 1] - s.q[:, 1] * s.p[:, 0]
    assert np.abs(L - L[0]).max() < 1e-13
    assert abs(np.polyfit(s.t, E, 1)[0]) * s.t[-1] < 0.2 * np.ptp(E)
    assert np.ptp(E) < 1e-6


@pytest.mark.parametrize("stages", [0, 13, -1])
def test_other_numbers_of_stages_are_refused(stages):
    with pytest.raises(InvalidInput, match="1 to 12"):
        method("fcirk", stages=stages)


def test_a_system_without_a_kepler_part_is_refused():
    with pytest.raises(InvalidInput, match="Kepler part"):
        integrate(Hamiltonian(q="q", p="p", H="p**2/2 + q**4"), "fcirk", h=0.1, steps=3, q0=[0.1], p0=[0.2])


if __name__ == "__main__":
    print(json.dumps({"result": {"differences": differences(), "orders": orders(), "defects": defects()}}))
