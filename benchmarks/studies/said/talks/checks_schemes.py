"""Checks of the talk on the general integrator: forms of Scheme I, generating functions, lambda that keeps the energy.

Most functions without a leading underscore return (number, control): a number that is small if a statement of the talk
holds, and the same number for a case in which the statement must fail.

Scheme I(lambda) is Q = q + h H_p, P = p - h H_q at (lambda q + (1 - lambda) Q, lambda P + (1 - lambda) p).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np
import sympy as sp

from phasebench.benchmarks.measure import metrics, step_map
from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian, integrate
from phasebench.integrators.systems import generating

from .checks_flows import J, Probe, defect, flow, henon_heiles
from .measure import LAMBDAS

POINT = np.array([0.1, 0.2, 0.3, -0.25])
STEP = 0.1
#: The parameters of the classical generating functions.
CLASSICAL = (Fraction(0), Fraction(1), Fraction(1, 2))
#: Parameters from far below 0 to far above 1.
MANY = (-10, -3, -1, 0, Fraction(1, 3), Fraction(1, 2), Fraction(3, 2), 2, Fraction(15, 2))


@cache
def _system(sign: int = 1) -> Hamiltonian:
    """The Henon-Heiles system; for ``sign`` = -1 that of -H, whose step h is a step -h of the original."""
    made = problem("henon-heiles").system
    return made if sign == 1 else Hamiltonian(q=made.q, p=made.p, H=-made.H)


def step(id: str, h: float = STEP, **parameters: Any) -> Callable:
    """The step map y -> Y of the method ``id`` on Henon-Heiles, y = (q1, q2, p1, p2); h may be negative."""

    def advance(y: Sequence[float] | np.ndarray) -> np.ndarray:
        y = np.asarray(y, float)
        system = _system(1 if h > 0 else -1)
        s = integrate(system, id, h=abs(h), steps=1, q0=y[:2], p0=y[2:], parameters=parameters)
        return np.hstack([s.q[-1], s.p[-1]])

    return advance


def _distance(a: Callable, b: Callable, y: np.ndarray = POINT) -> float:
    return np.abs(a(y) - b(y)).max()


def special_values() -> tuple[float, float]:
    """Distance of Scheme I at lambda 0, 1, 1/2 from symplectic Euler and midpoint steps."""
    pairs = {0: "symplectic-euler-q", 1: "symplectic-euler-p", Fraction(1, 2): "implicit-midpoint"}
    same = max(_distance(step("scheme-i", lam=lam), step(id)) for lam, id in pairs.items())
    return same, min(_distance(step("scheme-i", lam=Fraction(1, 3)), step(id)) for id in pairs.values())


def adjoint() -> tuple[float, float]:
    """The error of undoing a step h of Scheme I(1 - lambda) by a step -h of Scheme I(lambda)."""

    def back(first: Fraction, lam: Fraction) -> float:
        return np.abs(step("scheme-i", -STEP, lam=lam)(step("scheme-i", lam=first)(POINT)) - POINT).max()

    return max(back(1 - lam, lam) for lam in LAMBDAS), min(back(lam, lam) for lam in LAMBDAS)


def any_parameter() -> tuple[float, float]:
    """The largest symplecticity defect of Scheme I for lambda from -10 to 15/2."""
    return max(defect(step("scheme-i", 0.02, lam=lam), POINT) for lam in MANY), defect(step("rk4"), POINT)


def residual(lam: Fraction, y: np.ndarray, Y: np.ndarray, h: float) -> float:
    """The residual, in the maximum norm, of Scheme I's equations on Henon-Heiles for a step h from y to Y."""
    lam = float(lam)
    q, p, Q, P = y[:2], y[2:], Y[:2], Y[2:]
    middle = np.hstack([lam * q + (1 - lam) * Q, lam * P + (1 - lam) * p])
    return np.abs(Y - y - h * henon_heiles(middle)).max()


def form(lam: Fraction) -> tuple[float, float]:
    """The residual of Scheme I's equations as the talk prints them, at a computed step."""
    Y = step("scheme-i", lam=lam)(POINT)
    return residual(lam, POINT, Y, STEP), residual(lam + Fraction(1, 10), POINT, Y, STEP)


def nystrom() -> tuple[float, float]:
    """The distance of a step of Scheme I from its form as a one-stage Nystrom method."""

    def advance(lam: float, inner: float) -> np.ndarray:
        q, v, k = POINT[:2], POINT[2:], np.zeros(2)
        for _ in range(200):
            k = henon_heiles(np.hstack([q + (1 - lam) * STEP * v + inner * STEP**2 * k, v]))[2:]
        return np.hstack([q + STEP * v + lam * STEP**2 * k, v + STEP * k])

    ends = [(step("scheme-i", lam=lam)(POINT), float(lam)) for lam in LAMBDAS]
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


def exact_form() -> tuple[float, float]:
    """The asymmetry of d(Q - q, -(P - p)) / d(u, v) for the exact Henon-Heiles flow."""

    def asymmetry(moved: Callable) -> float:
        M = step_map.jacobian(moved, POINT)
        return max(np.abs(W - W.T).max() for W in (_form_of(M, float(lam)) for lam in (*LAMBDAS, *CLASSICAL)))

    return asymmetry(flow(henon_heiles, STEP)), asymmetry(step("rk4", 5 * STEP))


def hamilton_jacobi() -> tuple[float, float]:
    """The residual of S_t = H(u - (1 - lambda) S_v, v + lambda S_u) for the oscillator."""
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

    return max(off(float(x), float(x)) for x in (*LAMBDAS, *CLASSICAL)), min(
        off(float(x), float(1 - x)) for x in LAMBDAS
    )


def coefficients() -> tuple[float, float]:
    """The distance of K_2 and K_3, computed here, from the formulas that the talk prints."""
    u, v = sp.symbols("p1 p2"), sp.symbols("q1 q2")
    H = (u[0] ** 2 + u[1] ** 2) / 2 + v[0] ** 2 * v[1] + u[0] * v[1] ** 2 + u[0] ** 2 * v[0]
    lam = sp.Rational(5, 7)
    _, K2, K3 = generating.coefficients(H, v, u, 3, lam)
    Hu, Hv = (sp.Matrix([sp.diff(H, x) for x in s]) for s in (u, v))
    Huu, Hvv = (sp.hessian(H, s) for s in (u, v))
    Huv = sp.Matrix(2, 2, lambda i, j: sp.diff(H, u[i], v[j]))

    def printed_formula(sixth: sp.Expr) -> sp.Expr:
        first = (Hu.T * Hvv * Hu)[0] + (Hv.T * Huu * Hv)[0]
        return (lam**2 - lam + sp.Rational(1, 3)) / 2 * first + (lam**2 - lam + sixth) * (Hv.T * Huv * Hu)[0]

    at = dict(zip((*u, *v), (sp.Rational(k, 3) for k in (1, 2, -1, 4)), strict=True))
    second = abs((K2 - (lam - sp.Rational(1, 2)) * (Hu.T * Hv)[0]).subs(at))
    third, other = (abs((K3 - printed_formula(c)).subs(at)) for c in (sp.Rational(1, 6), sp.Rational(1, 3)))
    return float(max(second, third)), float(other)


def mass(lam: Fraction) -> float:
    """The largest change of the mass under Scheme I on the nonlinear Schroedinger equation, a grid of 3 points."""
    made = problem("nls", N=3, L=5.0)
    s = integrate(made, "scheme-i", h=0.05, steps=400, parameters={"lam": lam})
    return metrics.invariant_error(made.system.observe(made.invariants["mass"], s.q, s.p)).max


def momentum(id: str, **parameters: Any) -> float:
    """The largest change of the angular momentum of perturbed Kepler under the method ``id``."""
    made = problem("perturbed-kepler")
    s = integrate(made, id, h=0.02, steps=1000, parameters=parameters)
    return metrics.invariant_error(made.system.observe(made.invariants["angular-momentum"], s.q, s.p)).max


def mass_is_lost() -> tuple[float, float]:
    """The largest change of the Schroedinger equation's mass under Scheme I."""
    return mass(Fraction(1, 3)), mass(Fraction(1, 2))


def momentum_is_kept() -> tuple[float, float]:
    """The largest change of the angular momentum of perturbed Kepler under Scheme I."""
    return max(momentum("scheme-i", lam=lam) for lam in LAMBDAS), momentum("avf")


def singular() -> tuple[float, float]:
    """The least singular value of Scheme IV's Newton matrix for (q, p, lambda) at h = 0."""
    gradient = -J(2) @ henon_heiles(POINT)
    joint = np.block([[np.eye(4), np.zeros((4, 1))], [gradient[None], np.zeros((1, 1))]])
    return tuple(np.linalg.svd(M, compute_uv=False)[-1] for M in (joint, joint[:4, :4]))


def _exponent(y: np.ndarray) -> tuple[float, float]:
    """(exponent of h in |lambda(h) - 1/2|, that distance at the smallest h) for steps of Scheme IV from y."""
    h = 0.1 / 2.0 ** np.arange(5)
    runs = [integrate(_system(), "scheme-iv", h=x, steps=1, q0=y[:2], p0=y[2:]) for x in h]
    apart = np.abs([s.parameter[0] - 0.5 for s in runs])
    return metrics.power(h[1:], apart[1:]).value, apart[-1]


def _slope(y: np.ndarray) -> float:
    """The rate d/dt (H_p.H_q) along the Henon-Heiles flow at the state y, array (4,)."""
    change = step_map.jacobian(henon_heiles, y) @ henon_heiles(y)
    rate = henon_heiles(y)
    return -change[:2] @ rate[2:] - rate[:2] @ change[2:]


def degenerate() -> tuple[float, float]:
    """(number, control) at a state with d/dt (H_p.H_q) = 0: the distance of lambda's exponent from 1."""
    low, high = 1.5, 1.7
    for _ in range(50):
        middle = (low + high) / 2
        same = _slope(flow(henon_heiles, middle)(POINT)) * _slope(flow(henon_heiles, low)(POINT)) > 0
        low, high = (middle, high) if same else (low, middle)
    slope, left = _exponent(flow(henon_heiles, low)(POINT))
    return abs(slope - 1), left


def solvable() -> tuple[float, float]:
    """(number, control) at a state in general position: the distance of lambda's exponent from 1."""
    slope, _ = _exponent(POINT)
    made = _system()
    y = step("scheme-i", lam=Fraction(1, 2))(POINT)
    change = np.diff(made.observe(made.H, *(np.stack([POINT, y])[:, s] for s in (slice(2), slice(2, 4)))))
    return abs(slope - 1), abs(change[0])


def henon_heiles_data() -> tuple[float, float]:
    """(number, control) for the claim that H is 1/50 on the Henon-Heiles box orbit and 1/6 on the chaotic one."""
    H = {}
    for orbit in ("box", "chaotic"):
        made = problem(f"henon-heiles:{orbit}")
        H[orbit] = float(made.system.observe(made.system.H, [made.q0], [made.p0])[0])
    return max(abs(H["box"] - 0.02), abs(H["chaotic"] - 1 / 6)), abs(H["box"] - 1 / 6)


def henon_heiles_potential() -> tuple[float, float]:
    """The distance of this project's Henon-Heiles H from the talk's equations (27), (28)."""
    q, p = np.random.default_rng(7).normal(size=(2, 20, 2))
    system = problem("henon-heiles").system
    values = system.observe(system.H, q, p)

    def printed_formula(cubic: float) -> np.ndarray:
        U = (q[:, 0] ** 2 + q[:, 1] ** 2 + 2 * q[:, 0] ** 2 * q[:, 1] - cubic * q[:, 1] ** 3) / 2
        return (p**2).sum(1) / 2 + U

    return np.abs(values - printed_formula(2 / 3)).max(), np.abs(values - printed_formula(1 / 3)).max()


def kepler_data() -> tuple[float, float]:
    """The larger distance of perturbed Kepler's H0 from -0.5391 and of its L0 from 0.8."""
    made = problem("perturbed-kepler")
    H, L = (float(made.system.observe(e, [made.q0], [made.p0])[0])
            for e in (made.system.H, made.invariants["angular-momentum"]))  # fmt: skip
    return max(abs(H + 0.5391), abs(L - 0.8)), abs(H + 0.5)


def kepler_momentum() -> tuple[float, float]:
    """The largest rate of q1 p2 - q2 p1 on perturbed Kepler, and that of q1 p2 + q2 p1."""
    q, p = np.random.default_rng(7).normal(size=(2, 20, 2))
    system = problem("perturbed-kepler").system
    dq, dp = (np.stack([system.observe(e, q, p) for e in part], axis=1) for part in (system.dq, system.dp))

    def rate(sign: int) -> float:
        terms = dq[:, 0] * p[:, 1] + q[:, 0] * dp[:, 1], dq[:, 1] * p[:, 0] + q[:, 1] * dp[:, 0]
        return np.abs(terms[0] + sign * terms[1]).max()

    return rate(-1), rate(1)


HH, PK = ("henon-heiles",), ("perturbed-kepler",)
ONE = ("scheme-i",)
EULERS = ("symplectic-euler-p", "symplectic-euler-q", "implicit-midpoint")
CHECKS = (
    Probe("special-values", "Scheme I at λ = 0, 1, 1/2 less Euler and midpoint", "at λ = 1/3", special_values,
          (*ONE, *EULERS), HH),
    Probe("adjoint", "step of 1 − λ undone by λ with −h", "of λ undone by itself", adjoint, ONE, HH),
    Probe("any-parameter", "largest defect of Scheme I, λ from −10 to 15/2", "the Runge–Kutta method's", any_parameter,
          (*ONE, "rk4"), HH),
    *(Probe(f"form-{name}", f"residual of the printed equations, λ = {lam}", "with λ + 1/10",
            lambda lam=lam: form(lam), ONE, HH)
      for name, lam in zip(("minus-one", "third", "three-halves", "two"), LAMBDAS, strict=True)),
    Probe("nystrom", "Nyström form less Scheme I", "without a factor 1 − λ", nystrom, ONE, HH),
    Probe("exact-form", "asymmetry of d(Q − q, p − P)/d(u, v)", "of a Runge–Kutta step", exact_form, ("rk4",), HH),
    Probe("hamilton-jacobi", "residual of the equation for S, oscillator", "with λ and 1 − λ exchanged",
          hamilton_jacobi),
    Probe("coefficients", "K₂, K₃ of the recursion less the printed", "K₃ with 1/3 for 1/6", coefficients),
    Probe("mass", "change of NLS mass, Scheme I at λ = 1/3", "at λ = 1/2", mass_is_lost, ONE,
          ("nls",)),
    Probe("momentum", "change of L, Scheme I at four λ", "of AVF", momentum_is_kept,
          (*ONE, "avf"), PK),
    Probe("singular", "least singular value of the joint matrix at h = 0", "of its block for p and q", singular),
    Probe("solvable", "exponent of |λ(h) − 1/2| less 1", "energy error with λ = 1/2", solvable,
          (*ONE, "scheme-iv"), HH),
    Probe("degenerate", "exponent less 1 where the rate is 0", "|λ − 1/2| left at the smallest h",
          degenerate, ("scheme-iv",), HH),
    Probe("henon-heiles-data", "H of the printed orbits less 0.02 and 1/6", "of the box less 1/6", henon_heiles_data,
          problems=HH),
    Probe("henon-heiles", "registered H less (27), (28)", "with 1/3 for 2/3", henon_heiles_potential, problems=HH),
    Probe("kepler-data", "H₀ + 0.5391 and L₀ − 0.8", "H₀ of pure Kepler", kepler_data, problems=PK),
    Probe("kepler-momentum", "rate of q₁p₂ − q₂p₁", "of q₁p₂ + q₂p₁", kepler_momentum, problems=PK),
)  # fmt: skip
