"""Checks of the talks: each a number that is small if a statement holds, and a control.

The control is the same number for a case in which the statement must fail.

Scheme I(lambda) is Q = q + h H_p, P = p - h H_q at (lambda q + (1 - lambda) Q, lambda P + (1 - lambda) p).
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np
import sympy as sp

from phasebench.benchmarks.measure import metrics, step_map, variants
from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian, integrate
from phasebench.integrators.systems import generating

Pair = tuple[float, float]
#: A state of Henon-Heiles (q1, q2, p1, p2), and one of the pendulum (q, p).
POINT, SWINGING = np.array([0.1, 0.2, 0.3, -0.25]), np.array([1.0, 0.3])
STEP = 0.1
#: The values of lambda in the talk's figures.
LAMBDAS = tuple(map(Fraction, variants.LAMBDAS))
#: Parameters of all the generating functions, classical ones last; and parameters from far below 0 to far above 1.
ALL = (*LAMBDAS, Fraction(0), Fraction(1), Fraction(1, 2))
MANY = (-10, -3, -1, 0, Fraction(1, 3), Fraction(1, 2), Fraction(3, 2), 2, Fraction(15, 2))
HH, PK, LV, ONE = ("henon-heiles",), ("perturbed-kepler",), ("lotka-volterra",), ("scheme-i",)
EULERS = ("symplectic-euler-p", "symplectic-euler-q", "implicit-midpoint")


class Probe(NamedTuple):
    """A check: ``measure`` returns (number, control), which ``what`` and ``against`` describe.

    It runs the methods and problems with these ids.
    """

    what: str
    against: str
    measure: Callable[[], Pair]
    methods: tuple[str, ...]
    problems: tuple[str, ...]


#: Id -> check.
PROBES: dict[str, Probe] = {}


def check(id: str, what: str, against: str, methods: tuple[str, ...] = (), problems: tuple[str, ...] = ()) -> Callable:
    """Decorator: enter a function that returns (number, control) into `PROBES`."""

    def enter(measure: Callable) -> Callable:
        PROBES[id] = Probe(what, against, measure, methods, problems)
        return measure

    return enter


def _random(*shape: int) -> np.ndarray:
    return np.random.default_rng(7).normal(size=shape)


def _rates(name: str, q: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The problem's (dq/dt, dp/dt), arrays (n, d), at states q, p (n, d)."""
    system = problem(name).system
    return tuple(np.stack([system.observe(e, q, p) for e in part], axis=1) for part in (system.dq, system.dp))


def _flow(field: Callable, t: float, steps: int = 400) -> Callable:
    """The flow map y -> y(t) of y' = field(y), by the classical Runge-Kutta method."""
    h = t / steps

    def advance(y: np.ndarray) -> np.ndarray:
        for _ in range(steps):
            a = field(y)
            b = field(y + h / 2 * a)
            c = field(y + h / 2 * b)
            y = y + h / 6 * (a + 2 * b + 2 * c + field(y + h * c))
        return y

    return advance


def _henon_heiles(y: np.ndarray) -> np.ndarray:
    q1, q2, p1, p2 = y
    return np.array([p1, p2, -q1 - 2 * q1 * q2, -q2 - q1 * q1 + q2 * q2])


def _pendulum(y: np.ndarray, friction: float = 0.0) -> np.ndarray:
    return np.array([y[1], -np.sin(y[0]) - friction * y[1]])


_damped = partial(_pendulum, friction=0.1)


def _defect(step: Callable, y: np.ndarray) -> float:
    """The symplecticity defect of a step map at y = (q, p)."""
    return step_map.symplecticity_defect(step_map.jacobian(step, y))


def _J(d: int) -> np.ndarray:
    return np.kron([[0.0, 1.0], [-1.0, 0.0]], np.eye(d))


@check("lagrange", "difference of Hamilton's and Lagrange's equations, double pendulum", "with gravity 10 % off",
       problems=("double-pendulum",))  # fmt: skip
def _lagrange() -> Pair:
    """L = u^2 + v^2 / 2 + u v cos(a - b) + g (2 cos a + cos b), u = a', v = b'."""
    a, b, u, v = 0.4, -0.7, 0.3, 0.9
    c, s = np.cos(a - b), np.sin(a - b)
    dq, dp = _rates("double-pendulum", np.array([[a, b]]), np.array([[2 * u + v * c, v + u * c]]))

    def off(gravity: float) -> float:
        forces = [-u * v * s - 2 * gravity * np.sin(a), u * v * s - gravity * np.sin(b)]
        return np.abs(dp[0] - forces).max()

    return max(np.abs(dq[0] - [u, v]).max(), off(1)), off(1.1)


@check("pendulum", "difference to p' = −sin q", "to p' = −q", problems=("pendulum",))
def _pendulum_equations() -> Pair:
    q, p = _random(2, 20, 1)
    _, dp = _rates("pendulum", q, p)
    return np.abs(dp + np.sin(q)).max(), np.abs(dp + q).max()


@check("first-integral", "change of H along the pendulum's flow to t = 10", "with friction")
def _first_integral() -> Pair:
    def change(field: Callable) -> float:
        y = _flow(field, 10.0, 4000)(SWINGING)
        return abs((y[1] ** 2 - SWINGING[1] ** 2) / 2 - np.cos(y[0]) + np.cos(SWINGING[0]))

    return change(_pendulum), change(_damped)


@check("oriented-areas", "ξᵀJη less the sum of areas, d = 3", "with the other sign of J")
def _oriented_areas() -> Pair:
    xi, eta = _random(2, 6)
    areas = sum(xi[i] * eta[3 + i] - xi[3 + i] * eta[i] for i in range(3))
    return abs(xi @ _J(3) @ eta - areas), abs(xi @ _J(3).T @ eta - areas)


@check("linear-maps", "defects of both conditions for a product of shears", "the smaller one, off by 1e-3")
def _linear_maps() -> Pair:
    S = _random(3, 3)
    one, zero = np.eye(3), np.zeros((3, 3))
    A = np.block([[one, S + S.T], [zero, one]]) @ np.block([[one, zero], [S @ S.T, one]])
    xi, eta = _random(2, 6)

    def off(A: np.ndarray) -> Pair:
        form = abs((A @ xi) @ _J(3) @ (A @ eta) - xi @ _J(3) @ eta)
        return np.abs(A.T @ _J(3) @ A - _J(3)).max(), form

    return max(off(A)), min(off(A + 1e-3 * np.eye(6)))


@check("poincare", "defect of the Hénon–Heiles flow, t = 1", "of the damped pendulum's")
def _poincare() -> Pair:
    return _defect(_flow(_henon_heiles, 1.0), POINT), _defect(_flow(_damped, 1.0), SWINGING)


@check("group", "φ₀.₇φ₀.₃ less φ₁", "less φ₁.₁")
def _group() -> Pair:
    y = _flow(_henon_heiles, 0.7)(_flow(_henon_heiles, 0.3)(POINT))
    return tuple(np.abs(y - _flow(_henon_heiles, t)(POINT)).max() for t in (1.0, 1.1))


@check("locally-hamiltonian", "asymmetry of (J f)' and defect of the flow, Hénon–Heiles", "of the damped pendulum")
def _locally_hamiltonian() -> Pair:
    def both(field: Callable, y: np.ndarray) -> Pair:
        M = _J(len(y) // 2) @ step_map.jacobian(field, y)
        return np.abs(M - M.T).max(), _defect(_flow(field, 0.5), y)

    return max(both(_henon_heiles, POINT)), min(both(_damped, SWINGING))


@check("integrability", "integral of a symmetric field along a closed curve", "of one that is not symmetric")
def _integrability() -> Pair:
    angle = 2 * np.pi * np.arange(64) / 64
    x, y = 0.3 + np.cos(angle), 0.2 + np.sin(angle)

    def around(sign: int) -> float:
        fx, fy = x + 2 * x * y, y + sign * x**2 - y**2
        return abs(np.mean(fy * np.cos(angle) - fx * np.sin(angle)) * 2 * np.pi)

    return around(1), around(-1)


@check("lotka-volterra", "difference to u(v − 2), v(1 − u)", "to another coefficient", problems=LV)
def _lotka_volterra() -> Pair:
    u, v = np.random.default_rng(7).uniform(0.5, 4, (2, 20, 1))
    du, dv = _rates("lotka-volterra", u, v)
    right, wrong = (np.abs(dv - v * (1 - c * u)).max() for c in (1, 1.1))
    return max(np.abs(du - u * (v - 2)).max(), right), wrong


@check("level-curves", "rate of I along the field", "with 1.9 for 2")
def _level_curves() -> Pair:
    u, v = np.random.default_rng(7).uniform(0.5, 4, (2, 20))
    return tuple(np.abs((1 / u - 1) * u * (v - 2) + (two / v - 1) * v * (1 - u)).max() for two in (2, 1.9))


@check("species", "growth rate of u for one v more", "of v for one u more")
def _species() -> Pair:
    def growth(u: float, v: float) -> np.ndarray:
        return np.array([v - 2, 1 - u])

    return (growth(1.5, 2.5) - growth(1.5, 1.5))[0], (growth(2.5, 1.5) - growth(1.5, 1.5))[1]


@cache
def _growth(id: str, orbit: str, early: int, steps: int) -> float:
    """The growth of the largest change of the Lotka-Volterra invariant from ``early`` to all ``steps``, less 1."""
    made = problem(f"lotka-volterra:{orbit}")
    s = integrate(made, id, h=0.12, steps=steps)
    values = made.system.observe(made.system.H, s.q, s.p)
    return metrics.invariant_error(values).max / metrics.invariant_error(values[: early + 1]).max - 1


def _closed(id: str) -> Pair:
    return _growth(id, "4-2", 120, 12000), _growth("implicit-euler", "4-8", 12, 120)


for _name, _id in (("midpoint", "implicit-midpoint"), ("euler", "symplectic-euler-q")):
    check(f"closed-{_name}", "growth of max |I − I₀| from 120 to 12000 steps, less 1", "implicit Euler, 12 to 120",
          (_id, "implicit-euler"), LV)(partial(_closed, _id))  # fmt: skip


@check("damps", "largest energy factor of a step, h = 0.1, 1, 10", "of explicit Euler",
       ("explicit-euler", "implicit-euler"), ("harmonic-oscillator",))  # fmt: skip
def _damps() -> Pair:
    made = problem("harmonic-oscillator")

    def factor(id: str) -> float:
        energies = [integrate(made, id, h=h, steps=4).energy() for h in (0.1, 1.0, 10.0)]
        return max((E[1:] / E[:-1]).max() for E in energies)

    return factor("implicit-euler"), factor("explicit-euler")


@cache
def _system(sign: int = 1) -> Hamiltonian:
    """The Henon-Heiles system; for ``sign`` = -1 that of -H, whose step h is a step -h of the original."""
    made = problem("henon-heiles").system
    return made if sign == 1 else Hamiltonian(q=made.q, p=made.p, H=-made.H)


def _step(id: str, h: float = STEP, **parameters: Any) -> Callable:
    """The step map y -> Y of the method ``id`` on Henon-Heiles, y = (q1, q2, p1, p2); h may be negative."""

    def advance(y: np.ndarray) -> np.ndarray:
        system = _system(1 if h > 0 else -1)
        s = integrate(system, id, h=abs(h), steps=1, q0=y[:2], p0=y[2:], parameters=parameters)
        return np.hstack([s.q[-1], s.p[-1]])

    return advance


@check("special-values", "Scheme I at λ = 0, 1, 1/2 less Euler and midpoint", "at λ = 1/3", (*ONE, *EULERS), HH)
def _special_values() -> Pair:
    def apart(lam: Fraction, id: str) -> float:
        return np.abs(_step("scheme-i", lam=lam)(POINT) - _step(id)(POINT)).max()

    same = max(map(apart, (Fraction(1), Fraction(0), Fraction(1, 2)), EULERS))
    return same, min(apart(Fraction(1, 3), id) for id in EULERS)


@check("adjoint", "step of 1 − λ undone by λ with −h", "of λ undone by itself", ONE, HH)
def _adjoint() -> Pair:
    def back(first: Fraction, lam: Fraction) -> float:
        return np.abs(_step("scheme-i", -STEP, lam=lam)(_step("scheme-i", lam=first)(POINT)) - POINT).max()

    return max(back(1 - lam, lam) for lam in LAMBDAS), min(back(lam, lam) for lam in LAMBDAS)


@check("any-parameter", "largest defect of Scheme I, λ from −10 to 15/2", "the Runge–Kutta method's",
       (*ONE, "rk4"), HH)  # fmt: skip
def _any_parameter() -> Pair:
    return max(_defect(_step("scheme-i", 0.02, lam=lam), POINT) for lam in MANY), _defect(_step("rk4"), POINT)


def _form(lam: Fraction) -> Pair:
    Y = _step("scheme-i", lam=lam)(POINT)

    def residual(lam: float) -> float:
        q, p, Q, P = POINT[:2], POINT[2:], Y[:2], Y[2:]
        middle = np.hstack([lam * q + (1 - lam) * Q, lam * P + (1 - lam) * p])
        return np.abs(Y - POINT - STEP * _henon_heiles(middle)).max()

    return residual(float(lam)), residual(float(lam + Fraction(1, 10)))


for _name, _lam in zip(("minus-one", "third", "three-halves", "two"), LAMBDAS, strict=True):
    check(f"form-{_name}", f"residual of the printed equations, λ = {_lam}", "with λ + 1/10", ONE, HH)(
        partial(_form, _lam)
    )


@check("nystrom", "Nyström form less Scheme I", "without a factor 1 − λ", ONE, HH)
def _nystrom() -> Pair:
    def advance(lam: float, inner: float) -> np.ndarray:
        q, v, k = POINT[:2], POINT[2:], np.zeros(2)
        for _ in range(200):
            k = _henon_heiles(np.hstack([q + (1 - lam) * STEP * v + inner * STEP**2 * k, v]))[2:]
        return np.hstack([q + STEP * v + lam * STEP**2 * k, v + STEP * k])

    ends = [(_step("scheme-i", lam=lam)(POINT), float(lam)) for lam in LAMBDAS]
    good, bad = (max(np.abs(advance(x, f(x)) - Y).max() for Y, x in ends) for f in (lambda x: x * (1 - x), lambda x: x))
    return good, bad


def _form_of(M: np.ndarray, lam: float) -> np.ndarray:
    """The matrix d(Q - q, -(P - p)) / d(u, v) of a map (q, p) -> (Q, P) with Jacobian M, array (2 d, 2 d)."""
    d = len(M) // 2
    (Qq, Qp), (Pq, Pp) = ((row[:, :d], row[:, d:]) for row in (M[:d], M[d:]))
    one = np.eye(d)
    change = np.block([[Qq - one, Qp], [-Pq, one - Pp]])
    middle = np.block([[lam * Pq, lam * Pp + (1 - lam) * one], [lam * one + (1 - lam) * Qq, (1 - lam) * Qp]])
    return change @ np.linalg.inv(middle)


@check("exact-form", "asymmetry of d(Q − q, p − P)/d(u, v)", "of a Runge–Kutta step", ("rk4",), HH)
def _exact_form() -> Pair:
    def asymmetry(moved: Callable) -> float:
        M = step_map.jacobian(moved, POINT)
        return max(np.abs(W - W.T).max() for W in (_form_of(M, float(lam)) for lam in ALL))

    return asymmetry(_flow(_henon_heiles, STEP)), asymmetry(_step("rk4", 5 * STEP))


@check("hamilton-jacobi", "residual of the equation for S, oscillator", "with λ and 1 − λ exchanged")
def _hamilton_jacobi() -> Pair:
    """Of S_t = H(u - (1 - lambda) S_v, v + lambda S_u)."""
    t, delta, y = 0.3, 1e-3, np.array([0.7, -0.4])

    def rotation(t: float) -> np.ndarray:
        return np.array([[np.cos(t), np.sin(t)], [-np.sin(t), np.cos(t)]])

    def off(lam: float, used: float) -> float:
        Q, P = rotation(t) @ y
        s = np.array([lam * P + (1 - lam) * y[1], lam * y[0] + (1 - lam) * Q])
        W = {k: _form_of(rotation(t + k * delta), lam) for k in (-2, -1, 0, 1, 2)}
        rate = (8 * (W[1] - W[-1]) - W[2] + W[-2]) / (12 * delta)
        S_u, S_v = W[0] @ s
        return abs(s @ rate @ s / 2 - ((s[0] - (1 - used) * S_v) ** 2 + (s[1] + used * S_u) ** 2) / 2)

    return max(off(float(x), float(x)) for x in ALL), min(off(float(x), float(1 - x)) for x in LAMBDAS)


@check("coefficients", "K₂, K₃ of the recursion less the printed", "K₃ with 1/3 for 1/6")
def _coefficients() -> Pair:
    u, v = sp.symbols("p1 p2"), sp.symbols("q1 q2")
    H = (u[0] ** 2 + u[1] ** 2) / 2 + v[0] ** 2 * v[1] + u[0] * v[1] ** 2 + u[0] ** 2 * v[0]
    lam = sp.Rational(5, 7)
    _, K2, K3 = generating.coefficients(H, v, u, 3, lam)
    Hu, Hv = (sp.Matrix([sp.diff(H, x) for x in s]) for s in (u, v))
    Huv = sp.Matrix(2, 2, lambda i, j: sp.diff(H, u[i], v[j]))
    first = (Hu.T * sp.hessian(H, v) * Hu + Hv.T * sp.hessian(H, u) * Hv)[0]

    def off(sixth: sp.Expr) -> sp.Expr:
        mixed = (lam**2 - lam + sixth) * (Hv.T * Huv * Hu)[0]
        return K3 - (lam**2 - lam + sp.Rational(1, 3)) / 2 * first - mixed

    at = dict(zip((*u, *v), (sp.Rational(k, 3) for k in (1, 2, -1, 4)), strict=True))
    differences = (K2 - (lam - sp.Rational(1, 2)) * (Hu.T * Hv)[0], off(sp.Rational(1, 6)), off(sp.Rational(1, 3)))
    second, third, other = (float(abs(e.subs(at))) for e in differences)
    return max(second, third), other


def _change(name: str, invariant: str, id: str, h: float, steps: int, values: dict, **parameters: Any) -> float:
    """The largest change of an invariant of a problem, with these ``values`` of its parameters, under a method."""
    made = problem(name, **values)
    s = integrate(made, id, h=h, steps=steps, parameters=parameters)
    return metrics.invariant_error(made.system.observe(made.invariants[invariant], s.q, s.p)).max


@check("mass", "change of NLS mass, Scheme I at λ = 1/3", "at λ = 1/2", ONE, ("nls",))
def _mass() -> Pair:
    mass = partial(_change, "nls", "mass", "scheme-i", 0.05, 400, {"N": 3, "L": 5.0})
    return mass(lam=Fraction(1, 3)), mass(lam=Fraction(1, 2))


@check("momentum", "change of L, Scheme I at four λ", "of AVF", (*ONE, "avf"), PK)
def _momentum() -> Pair:
    change = partial(_change, "perturbed-kepler", "angular-momentum", h=0.02, steps=1000, values={})
    return max(change("scheme-i", lam=lam) for lam in LAMBDAS), change("avf")


@check("singular", "least singular value of the joint matrix at h = 0", "of its block for p and q")
def _singular() -> Pair:
    gradient = -_J(2) @ _henon_heiles(POINT)
    joint = np.block([[np.eye(4), np.zeros((4, 1))], [gradient[None], np.zeros((1, 1))]])
    return tuple(np.linalg.svd(M, compute_uv=False)[-1] for M in (joint, joint[:4, :4]))


def _exponent(y: np.ndarray) -> Pair:
    """(Exponent of h in |lambda(h) - 1/2|, that distance at the smallest h) for steps of Scheme IV from y."""
    h = 0.1 / 2.0 ** np.arange(5)
    runs = [integrate(_system(), "scheme-iv", h=x, steps=1, q0=y[:2], p0=y[2:]) for x in h]
    apart = np.abs([s.parameter[0] - 0.5 for s in runs])
    return metrics.power(h[1:], apart[1:]).value, apart[-1]


@check("solvable", "exponent of |λ(h) − 1/2| less 1", "energy error with λ = 1/2", (*ONE, "scheme-iv"), HH)
def _solvable() -> Pair:
    y = np.stack([POINT, _step("scheme-i", lam=Fraction(1, 2))(POINT)])
    change = np.diff(_system().observe(_system().H, y[:, :2], y[:, 2:]))
    return abs(_exponent(POINT)[0] - 1), abs(change[0])


@check("degenerate", "exponent less 1 where the rate is 0", "|λ − 1/2| left at the smallest h", ("scheme-iv",), HH)
def _degenerate() -> Pair:
    """At a state where d/dt (H_p.H_q) = 0."""

    def rate(t: float) -> float:
        y = _flow(_henon_heiles, t)(POINT)
        change, field = step_map.jacobian(_henon_heiles, y) @ _henon_heiles(y), _henon_heiles(y)
        return -change[:2] @ field[2:] - field[:2] @ change[2:]

    low, high = 1.5, 1.7
    for _ in range(50):
        middle = (low + high) / 2
        low, high = (middle, high) if rate(middle) * rate(low) > 0 else (low, middle)
    slope, left = _exponent(_flow(_henon_heiles, low)(POINT))
    return abs(slope - 1), left


def _start(name: str, invariant: str = "") -> float:
    """The energy, or another invariant, of a problem's initial state."""
    made = problem(name)
    return float(
        made.system.observe(made.invariants[invariant] if invariant else made.system.H, [made.q0], [made.p0])[0]
    )


@check("henon-heiles-data", "H of the printed orbits less 0.02 and 1/6", "of the box less 1/6", problems=HH)
def _henon_heiles_data() -> Pair:
    box, chaotic = _start("henon-heiles:box"), _start("henon-heiles:chaotic")
    return max(abs(box - 0.02), abs(chaotic - 1 / 6)), abs(box - 1 / 6)


@check("henon-heiles", "registered H less (27), (28)", "with 1/3 for 2/3", problems=HH)
def _henon_heiles_potential() -> Pair:
    q, p = _random(2, 20, 2)
    values = _system().observe(_system().H, q, p)

    def off(cubic: float) -> float:
        U = (q[:, 0] ** 2 + q[:, 1] ** 2 + 2 * q[:, 0] ** 2 * q[:, 1] - cubic * q[:, 1] ** 3) / 2
        return np.abs(values - (p**2).sum(1) / 2 - U).max()

    return off(2 / 3), off(1 / 3)


@check("kepler-data", "H₀ + 0.5391 and L₀ − 0.8", "H₀ of pure Kepler", problems=PK)
def _kepler_data() -> Pair:
    H, L = _start("perturbed-kepler"), _start("perturbed-kepler", "angular-momentum")
    return max(abs(H + 0.5391), abs(L - 0.8)), abs(H + 0.5)


@check("kepler-momentum", "rate of q₁p₂ − q₂p₁", "of q₁p₂ + q₂p₁", problems=PK)
def _kepler_momentum() -> Pair:
    q, p = _random(2, 20, 2)
    dq, dp = _rates("perturbed-kepler", q, p)

    def rate(sign: int) -> float:
        return np.abs(dq[:, 0] * p[:, 1] + q[:, 0] * dp[:, 1] + sign * (dq[:, 1] * p[:, 0] + q[:, 1] * dp[:, 0])).max()

    return rate(-1), rate(1)
