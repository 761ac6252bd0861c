"""Checks of the general integrator: Scheme I's forms, its generating function, the parameter that keeps the energy."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from functools import cache

import numpy as np
import sympy as sp

from phasebench.benchmarks.measure import metrics
from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian, integrate
from phasebench.integrators.systems import generating

from .checks_base import Check, J, defect, flow, henon_heiles
from .measure import LAMBDAS

POINT = np.array([0.1, 0.2, 0.3, -0.25])
STEP = 0.1
#: The parameters of the classical generating functions.
CLASSICAL = (Fraction(0), Fraction(1), Fraction(1, 2))
#: From far below 0 to far above 1.
MANY = (-10, -3, -1, 0, Fraction(1, 3), Fraction(1, 2), Fraction(3, 2), 2, Fraction(15, 2))


@cache
def _system(sign: int = 1) -> Hamiltonian:
    """Henon-Heiles, or with -H: its steps are those of -h."""
    made = problem("henon-heiles").system
    return made if sign == 1 else Hamiltonian(q=made.q, p=made.p, H=-made.H)


def step(id: str, h: float = STEP, **parameters) -> Callable:
    """y -> the step of a method of the suite."""

    def moved(y):
        y = np.asarray(y, float)
        system = _system(1 if h > 0 else -1)
        s = integrate(system, id, h=abs(h), steps=1, q0=y[:2], p0=y[2:], parameters=parameters)
        return np.hstack([s.q[-1], s.p[-1]])

    return moved


def _apart(a: Callable, b: Callable, y=POINT) -> float:
    return np.abs(a(y) - b(y)).max()


def special_values() -> tuple[float, float]:
    """Scheme I at 0, 1 and 1/2 against symplectic Euler and midpoint, and at 1/3 against the nearest of these."""
    pairs = {0: "symplectic-euler-q", 1: "symplectic-euler-p", Fraction(1, 2): "implicit-midpoint"}
    same = max(_apart(step("scheme-i", lam=lam), step(id)) for lam, id in pairs.items())
    return same, min(_apart(step("scheme-i", lam=Fraction(1, 3)), step(id)) for id in pairs.values())


def adjoint() -> tuple[float, float]:
    """A step of 1 - lambda undone by one of lambda with -h, and one of lambda by itself."""

    def back(first, lam):
        return np.abs(step("scheme-i", -STEP, lam=lam)(step("scheme-i", lam=first)(POINT)) - POINT).max()

    return max(back(1 - lam, lam) for lam in LAMBDAS), min(back(lam, lam) for lam in LAMBDAS)


def any_parameter() -> tuple[float, float]:
    """The largest defect of Scheme I for lambda from -10 to 15/2, and the classical Runge-Kutta method's."""
    return max(defect(step("scheme-i", 0.02, lam=lam), POINT) for lam in MANY), defect(step("rk4"), POINT)


def residual(lam, y, Y, h: float) -> float:
    """Of Scheme I's two equations for Henon-Heiles at a step from y to Y."""
    lam = float(lam)
    q, p, Q, P = y[:2], y[2:], Y[:2], Y[2:]
    middle = np.hstack([lam * q + (1 - lam) * Q, lam * P + (1 - lam) * p])
    return np.abs(Y - y - h * henon_heiles(middle)).max()


def form(lam) -> tuple[float, float]:
    """The residual of the printed equations at a step of the suite, and of those of lambda + 1/10."""
    Y = step("scheme-i", lam=lam)(POINT)
    return residual(lam, POINT, Y, STEP), residual(lam + Fraction(1, 10), POINT, Y, STEP)


def nystrom() -> tuple[float, float]:
    """The Nystrom form, solved by iteration, against Scheme I, and without the factor 1 - lambda of its stage."""

    def moved(lam, inner):
        q, v, k = POINT[:2], POINT[2:], np.zeros(2)
        for _ in range(200):
            k = henon_heiles(np.hstack([q + (1 - lam) * STEP * v + inner * STEP**2 * k, v]))[2:]
        return np.hstack([q + STEP * v + lam * STEP**2 * k, v + STEP * k])

    ends = [(step("scheme-i", lam=lam)(POINT), float(lam)) for lam in LAMBDAS]
    good, bad = (max(np.abs(moved(x, f(x)) - Y).max() for Y, x in ends) for f in (lambda x: x * (1 - x), lambda x: x))
    return good, bad


def _form_of(M, lam: float) -> np.ndarray:
    """d(Q - q, -(P - p)) / d(u, v) for a map with the Jacobian M, the order being (q, p): symmetric iff exact."""
    d = len(M) // 2
    (Qq, Qp), (Pq, Pp) = ((row[:, :d], row[:, d:]) for row in (M[:d], M[d:]))
    one = np.eye(d)
    change = np.block([[Qq - one, Qp], [-Pq, one - Pp]])
    middle = np.block([[lam * Pq, lam * Pp + (1 - lam) * one], [lam * one + (1 - lam) * Qq, (1 - lam) * Qp]])
    return change @ np.linalg.inv(middle)


def exact_form() -> tuple[float, float]:
    """The asymmetry of the form for the flow over seven parameters, and for a Runge-Kutta step."""

    def asymmetry(moved):
        M = metrics.jacobian(moved, POINT)
        return max(np.abs(W - W.T).max() for W in (_form_of(M, float(lam)) for lam in (*LAMBDAS, *CLASSICAL)))

    return asymmetry(flow(henon_heiles, STEP)), asymmetry(step("rk4", 5 * STEP))


def hamilton_jacobi() -> tuple[float, float]:
    """S_t = H(u - (1 - lambda) S_v, v + lambda S_u) of the oscillator; and with lambda, 1 - lambda exchanged."""
    t, delta, y = 0.3, 1e-3, np.array([0.7, -0.4])

    def rotation(t):
        return np.array([[np.cos(t), np.sin(t)], [-np.sin(t), np.cos(t)]])

    def off(lam, used):
        Q, P = rotation(t) @ y
        s = np.array([lam * P + (1 - lam) * y[1], lam * y[0] + (1 - lam) * Q])
        W = {k: _form_of(rotation(t + k * delta), lam) for k in (-2, -1, 0, 1, 2)}
        rate = (8 * (W[1] - W[-1]) - W[2] + W[-2]) / (12 * delta)
        S_u, S_v = W[0] @ s
        return abs(s @ rate @ s / 2 - ((s[0] - (1 - used) * S_v) ** 2 + (s[1] + used * S_u) ** 2) / 2)

    return max(off(float(x), float(x)) for x in (*LAMBDAS, *CLASSICAL)), min(
        off(float(x), float(1 - x)) for x in LAMBDAS
    )


def coefficients() -> tuple[float, float]:
    """K_2 and K_3 of the recursion against the printed formulae, on H that is not separable; K_3 with 1/3 for 1/6."""
    u, v = sp.symbols("p1 p2"), sp.symbols("q1 q2")
    H = (u[0] ** 2 + u[1] ** 2) / 2 + v[0] ** 2 * v[1] + u[0] * v[1] ** 2 + u[0] ** 2 * v[0]
    lam = sp.Rational(5, 7)
    _, K2, K3 = generating.coefficients(H, v, u, 3, lam)
    Hu, Hv = (sp.Matrix([sp.diff(H, x) for x in s]) for s in (u, v))
    Huu, Hvv = (sp.hessian(H, s) for s in (u, v))
    Huv = sp.Matrix(2, 2, lambda i, j: sp.diff(H, u[i], v[j]))

    def printed(sixth):
        first = (Hu.T * Hvv * Hu)[0] + (Hv.T * Huu * Hv)[0]
        return (lam**2 - lam + sp.Rational(1, 3)) / 2 * first + (lam**2 - lam + sixth) * (Hv.T * Huv * Hu)[0]

    at = dict(zip((*u, *v), (sp.Rational(k, 3) for k in (1, 2, -1, 4)), strict=True))
    second = abs((K2 - (lam - sp.Rational(1, 2)) * (Hu.T * Hv)[0]).subs(at))
    third, other = (abs((K3 - printed(c)).subs(at)) for c in (sp.Rational(1, 6), sp.Rational(1, 3)))
    return float(max(second, third)), float(other)


def mass(lam) -> float:
    """The largest change of the mass of the nonlinear Schroedinger equation on three points, Scheme I."""
    made = problem("nls", N=3, L=5.0)
    s = integrate(made, "scheme-i", h=0.05, steps=400, parameters={"lam": lam})
    return metrics.invariant_error(made.system.observe(made.invariants["mass"], s.q, s.p)).max


def momentum(id: str, **parameters) -> float:
    """The largest change of the angular momentum on perturbed Kepler."""
    made = problem("perturbed-kepler")
    s = integrate(made, id, h=0.02, steps=1000, parameters=parameters)
    return metrics.invariant_error(made.system.observe(made.invariants["angular-momentum"], s.q, s.p)).max


def mass_is_lost() -> tuple[float, float]:
    """The change of the mass at lambda = 1/3 and at 1/2."""
    return mass(Fraction(1, 3)), mass(Fraction(1, 2))


def momentum_is_kept() -> tuple[float, float]:
    """The largest change of q.D p over the parameters, and of AVF."""
    return max(momentum("scheme-i", lam=lam) for lam in LAMBDAS), momentum("avf")


def singular() -> tuple[float, float]:
    """The least singular value of the joint Newton matrix of Scheme IV at h = 0, and of its block without lambda."""
    gradient = -J(2) @ henon_heiles(POINT)
    joint = np.block([[np.eye(4), np.zeros((4, 1))], [gradient[None], np.zeros((1, 1))]])
    return tuple(np.linalg.svd(M, compute_uv=False)[-1] for M in (joint, joint[:4, :4]))


def _exponent(y) -> tuple[float, float]:
    """The exponent of h in |lambda(h) - 1/2| for a step of Scheme IV from y, and that distance at the smallest h."""
    h = 0.1 / 2.0 ** np.arange(5)
    runs = [integrate(_system(), "scheme-iv", h=x, steps=1, q0=y[:2], p0=y[2:]) for x in h]
    apart = np.abs([s.parameter[0] - 0.5 for s in runs])
    return metrics.power(h[1:], apart[1:]).value, apart[-1]


def _slope(y) -> float:
    """The rate of H_p.H_q along the flow: of the energy error of lambda - 1/2, over h^2."""
    change = metrics.jacobian(henon_heiles, y) @ henon_heiles(y)
    rate = henon_heiles(y)
    return -change[:2] @ rate[2:] - rate[:2] @ change[2:]


def degenerate() -> tuple[float, float]:
    """How far the exponent is from 1 where that rate is zero, on the point's orbit; the distance left at the end."""
    low, high = 1.5, 1.7
    for _ in range(50):
        middle = (low + high) / 2
        same = _slope(flow(henon_heiles, middle)(POINT)) * _slope(flow(henon_heiles, low)(POINT)) > 0
        low, high = (middle, high) if same else (low, middle)
    slope, left = _exponent(flow(henon_heiles, low)(POINT))
    return abs(slope - 1), left


def solvable() -> tuple[float, float]:
    """How far the exponent of |lambda(h) - 1/2| is from 1 at a point in general position; the energy error at 1/2."""
    slope, _ = _exponent(POINT)
    made = _system()
    y = step("scheme-i", lam=Fraction(1, 2))(POINT)
    change = np.diff(made.observe(made.H, *(np.stack([POINT, y])[:, s] for s in (slice(2), slice(2, 4)))))
    return abs(slope - 1), abs(change[0])


def henon_heiles_data() -> tuple[float, float]:
    """H of both printed orbits against 1/50 and 1/6, and of the box orbit against 1/6."""
    H = {}
    for orbit in ("box", "chaotic"):
        made = problem(f"henon-heiles:{orbit}")
        H[orbit] = float(made.system.observe(made.system.H, [made.q0], [made.p0])[0])
    return max(abs(H["box"] - 0.02), abs(H["chaotic"] - 1 / 6)), abs(H["box"] - 1 / 6)


def henon_heiles_potential() -> tuple[float, float]:
    """The registered H against (27) and (28), and with 1/3 for 2/3."""
    q, p = np.random.default_rng(7).normal(size=(2, 20, 2))
    system = problem("henon-heiles").system
    values = system.observe(system.H, q, p)

    def printed(cubic):
        U = (q[:, 0] ** 2 + q[:, 1] ** 2 + 2 * q[:, 0] ** 2 * q[:, 1] - cubic * q[:, 1] ** 3) / 2
        return (p**2).sum(1) / 2 + U

    return np.abs(values - printed(2 / 3)).max(), np.abs(values - printed(1 / 3)).max()


def kepler_data() -> tuple[float, float]:
    """H0 against the printed -0.5391 and L0 against 0.8, and H0 without the Schwarzschild term."""
    made = problem("perturbed-kepler")
    H, L = (float(made.system.observe(e, [made.q0], [made.p0])[0])
            for e in (made.system.H, made.invariants["angular-momentum"]))  # fmt: skip
    return max(abs(H + 0.5391), abs(L - 0.8)), abs(H + 0.5)


def kepler_momentum() -> tuple[float, float]:
    """The rate of q1 p2 - q2 p1 along the registered field, and of q1 p2 + q2 p1."""
    q, p = np.random.default_rng(7).normal(size=(2, 20, 2))
    system = problem("perturbed-kepler").system
    dq, dp = (np.stack([system.observe(e, q, p) for e in part], axis=1) for part in (system.dq, system.dp))

    def rate(sign):
        terms = dq[:, 0] * p[:, 1] + q[:, 0] * dp[:, 1], dq[:, 1] * p[:, 0] + q[:, 1] * dp[:, 0]
        return np.abs(terms[0] + sign * terms[1]).max()

    return rate(-1), rate(1)


HH, PK = ("henon-heiles",), ("perturbed-kepler",)
ONE = ("scheme-i",)
EULERS = ("symplectic-euler-p", "symplectic-euler-q", "implicit-midpoint")
CHECKS = (
    Check("special-values", "Scheme I at λ = 0, 1, 1/2 less Euler and midpoint", "at λ = 1/3", special_values,
          (*ONE, *EULERS), HH),
    Check("adjoint", "step of 1 − λ undone by λ with −h", "of λ undone by itself", adjoint, ONE, HH),
    Check("any-parameter", "largest defect of Scheme I, λ from −10 to 15/2", "the Runge–Kutta method's", any_parameter,
          (*ONE, "rk4"), HH),
    *(Check(f"form-{name}", f"residual of the printed equations, λ = {lam}", "with λ + 1/10",
            lambda lam=lam: form(lam), ONE, HH)
      for name, lam in zip(("minus-one", "third", "three-halves", "two"), LAMBDAS, strict=True)),
    Check("nystrom", "Nyström form less Scheme I", "without a factor 1 − λ", nystrom, ONE, HH),
    Check("exact-form", "asymmetry of d(Q − q, p − P)/d(u, v)", "of a Runge–Kutta step", exact_form, ("rk4",), HH),
    Check("hamilton-jacobi", "residual of the equation for S, oscillator", "with λ and 1 − λ exchanged",
          hamilton_jacobi),
    Check("coefficients", "K₂, K₃ of the recursion less the printed", "K₃ with 1/3 for 1/6", coefficients),
    Check("mass", "change of NLS mass, Scheme I at λ = 1/3", "at λ = 1/2", mass_is_lost, ONE,
          ("nls",)),
    Check("momentum", "change of L, Scheme I at four λ", "of AVF", momentum_is_kept,
          (*ONE, "avf"), PK),
    Check("singular", "least singular value of the joint matrix at h = 0", "of its block for p and q", singular),
    Check("solvable", "exponent of |λ(h) − 1/2| less 1", "energy error with λ = 1/2", solvable,
          (*ONE, "scheme-iv"), HH),
    Check("degenerate", "exponent less 1 where the rate is 0", "|λ − 1/2| left at the smallest h",
          degenerate, ("scheme-iv",), HH),
    Check("henon-heiles-data", "H of the printed orbits less 0.02 and 1/6", "of the box less 1/6", henon_heiles_data,
          problems=HH),
    Check("henon-heiles", "registered H less (27), (28)", "with 1/3 for 2/3", henon_heiles_potential, problems=HH),
    Check("kepler-data", "H₀ + 0.5391 and L₀ − 0.8", "H₀ of pure Kepler", kepler_data, problems=PK),
    Check("kepler-momentum", "rate of q₁p₂ − q₂p₁", "of q₁p₂ + q₂p₁", kepler_momentum, problems=PK),
)  # fmt: skip
