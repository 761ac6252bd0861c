"""Checks of the introductory talk: flows, symplectic maps, Lagrange's equations, Lotka-Volterra, first integrals.

Each function without a leading underscore returns (number, control): a number that is small if a statement of the talk
holds, and the same number for a case in which the statement must fail.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import sympy as sp

from phasebench.benchmarks.measure import metrics, step_map
from phasebench.benchmarks.problems import problem
from phasebench.integrators import integrate


@dataclass(frozen=True)
class Probe:
    """A number that tests a statement, and a control, the same number for a case in which the statement must fail.

    Attributes
    ----------
    what, against : descriptions of the number and of the control
    measure : returns (number, control)
    methods, problems : ids of the methods and problems that it runs
    """

    id: str
    what: str
    against: str
    measure: Callable[[], tuple[float, float]]
    methods: tuple[str, ...] = ()
    problems: tuple[str, ...] = ()


def flow(field: Callable, t: float, steps: int = 400) -> Callable:
    """Return the flow map y -> y(t) of y' = field(y), computed by ``steps`` classical Runge-Kutta steps."""
    h = t / steps

    def advance(y: Sequence[float] | np.ndarray) -> np.ndarray:
        y = np.array(y, float)
        for _ in range(steps):
            a = field(y)
            b = field(y + h / 2 * a)
            c = field(y + h / 2 * b)
            y = y + h / 6 * (a + 2 * b + 2 * c + field(y + h * c))
        return y

    return advance


def henon_heiles(y: np.ndarray) -> np.ndarray:
    """Return the Henon-Heiles vector field at y = (q1, q2, p1, p2), array (4,)."""
    q1, q2, p1, p2 = y
    return np.array([p1, p2, -q1 - 2 * q1 * q2, -q2 - q1 * q1 + q2 * q2])


def damped_pendulum(y: np.ndarray) -> np.ndarray:
    """Return the vector field of the pendulum with friction, which is not Hamiltonian, at y = (q, p): array (2,)."""
    return np.array([y[1], -np.sin(y[0]) - 0.1 * y[1]])


def pendulum(y: np.ndarray) -> np.ndarray:
    """Return the pendulum's vector field at y = (q, p): array (2,)."""
    return np.array([y[1], -np.sin(y[0])])


def defect(step: Callable, y: Sequence[float] | np.ndarray) -> float:
    """Return the symplecticity defect max |M^T J M - J|, M the Jacobian of the map ``step`` at y = (q, p)."""
    return step_map.symplecticity_defect(step_map.jacobian(step, np.array(y, float)))


def J(d: int) -> np.ndarray:
    """Return the structure matrix (0 I; -I 0) for d degrees of freedom, array (2 d, 2 d)."""
    return np.kron([[0.0, 1.0], [-1.0, 0.0]], np.eye(d))


POINT = (0.1, 0.2, 0.3, -0.25)
SWINGING = (1.0, 0.3)


def _random(*shape: int) -> np.ndarray:
    return np.random.default_rng(7).normal(size=shape)


def lagrange() -> tuple[float, float]:
    """Compare Lagrange's with Hamilton's equations of the double pendulum: (number, control)."""
    a, b, u, v, p1, p2 = sp.symbols("q1 q2 u v p1 p2", real=True)
    T = u**2 + v**2 / 2 + u * v * sp.cos(a - b)
    momenta = [sp.diff(T, x) for x in (u, v)]
    known = problem("double-pendulum").system
    values = {a: 0.4, b: -0.7, u: 0.3, v: 0.9}
    at = {a: values[a], b: values[b]} | {p: m.subs(values) for p, m in zip((p1, p2), momenta, strict=True)}

    def numbers(expressions: Iterable[sp.Expr]) -> np.ndarray:
        return np.array([float(e.subs({s: at[next(k for k in at if k.name == s.name)] for s in e.free_symbols}))
                         for e in expressions])  # fmt: skip

    def forces(gravity: float) -> np.ndarray:
        L = T + gravity * (2 * sp.cos(a) + sp.cos(b))
        return np.array([float(sp.diff(L, x).subs(values)) for x in (a, b)])

    rates = np.abs(numbers(known.dq) - [values[u], values[v]]).max()
    found = numbers(known.dp)
    return max(rates, np.abs(found - forces(1)).max()), np.abs(found - forces(1.1)).max()


def pendulum_equations() -> tuple[float, float]:
    """The largest distance of this project's pendulum's dp/dt from -sin q, and from -q."""
    q, p = _random(2, 20, 1)
    system = problem("pendulum").system
    dp = system.observe(system.dp[0], q, p)
    return np.abs(dp + np.sin(q[:, 0])).max(), np.abs(dp + q[:, 0]).max()


def first_integral() -> tuple[float, float]:
    """The change of H along the pendulum's flow, and along the flow with friction."""

    def change(field: Callable) -> float:
        y = flow(field, 10.0, 4000)(SWINGING)
        return abs((y[1] ** 2 - SWINGING[1] ** 2) / 2 - np.cos(y[0]) + np.cos(SWINGING[0]))

    return change(pendulum), change(damped_pendulum)


def oriented_areas() -> tuple[float, float]:
    """The distance of xi^T J eta from the sum of oriented areas in the (p_i, q_i) planes."""
    xi, eta = _random(2, 6)
    areas = sum(xi[i] * eta[3 + i] - xi[3 + i] * eta[i] for i in range(3))
    return abs(xi @ J(3) @ eta - areas), abs(xi @ J(3).T @ eta - areas)


def linear_maps() -> tuple[float, float]:
    """Defects of A^T J A = J and omega(A xi, A eta) = omega(xi, eta) for a product of shears."""
    S = _random(3, 3)
    one, zero = np.eye(3), np.zeros((3, 3))
    A = np.block([[one, S + S.T], [zero, one]]) @ np.block([[one, zero], [S @ S.T, one]])
    xi, eta = _random(2, 6)

    def off(A: np.ndarray) -> tuple[float, float]:
        form = abs((A @ xi) @ J(3) @ (A @ eta) - xi @ J(3) @ eta)
        return np.abs(A.T @ J(3) @ A - J(3)).max(), form

    return max(off(A)), min(off(A + 1e-3 * np.eye(6)))


def poincare() -> tuple[float, float]:
    """The symplecticity defect of the Henon-Heiles flow, and of the damped pendulum's."""
    return defect(flow(henon_heiles, 1.0), POINT), defect(flow(damped_pendulum, 1.0), SWINGING)


def group() -> tuple[float, float]:
    """The distance of phi_0.7 after phi_0.3 from phi_1, and from phi_1.1, at one state."""
    y = flow(henon_heiles, 0.7)(flow(henon_heiles, 0.3)(POINT))
    return np.abs(y - flow(henon_heiles, 1.0)(POINT)).max(), np.abs(y - flow(henon_heiles, 1.1)(POINT)).max()


def _asymmetry(field: Callable, y: Sequence[float] | np.ndarray) -> float:
    """Max |M - M^T| for the Jacobian M of J f at y, which is zero iff the field f is locally Hamiltonian."""
    M = J(len(y) // 2) @ step_map.jacobian(field, np.array(y, float))
    return np.abs(M - M.T).max()


def locally_hamiltonian() -> tuple[float, float]:
    """(number, control) of the test that a field f is locally Hamiltonian iff its flow is symplectic."""
    both = [
        (_asymmetry(f, y), defect(flow(f, 0.5), y)) for f, y in ((henon_heiles, POINT), (damped_pendulum, SWINGING))
    ]
    return max(both[0]), min(both[1])


def integrability() -> tuple[float, float]:
    """The integral along a closed curve of a plane field with a symmetric Jacobian."""
    angle = 2 * np.pi * np.arange(64) / 64
    x, y = 0.3 + np.cos(angle), 0.2 + np.sin(angle)
    dx, dy = -np.sin(angle), np.cos(angle)

    def around(fx: np.ndarray, fy: np.ndarray) -> float:
        return abs(np.mean(fx * dx + fy * dy) * 2 * np.pi)

    return around(x + 2 * x * y, y + x**2 - y**2), around(x + 2 * x * y, y - x**2 - y**2)


def lotka_volterra() -> tuple[float, float]:
    """The distance of this project's Lotka-Volterra field from (u (v - 2), v (1 - u))."""
    u, v = np.random.default_rng(7).uniform(0.5, 4, (2, 20, 1))
    system = problem("lotka-volterra").system
    du, dv = (system.observe(e, u, v) for e in (system.dq[0], system.dp[0]))
    u, v = u[:, 0], v[:, 0]
    off = np.abs(du - u * (v - 2)).max()
    return max(off, np.abs(dv - v * (1 - u)).max()), np.abs(dv - v * (1 - 1.1 * u)).max()


def level_curves() -> tuple[float, float]:
    """The largest rate of I = ln u - u + 2 ln v - v along the Lotka-Volterra field."""
    u, v = np.random.default_rng(7).uniform(0.5, 4, (2, 20))

    def rate(two: float) -> float:
        return np.abs((1 / u - 1) * u * (v - 2) + (two / v - 1) * v * (1 - u)).max()

    return rate(2), rate(1.9)


def species() -> tuple[float, float]:
    """The changes of two growth rates in the Lotka-Volterra equations: of u's if v rises by 1, of v's if u does."""

    def growth(x: float, y: float) -> tuple[float, float]:
        return (y - 2), (1 - x)

    u, v = 1.5, 1.5
    return growth(u, v + 1)[0] - growth(u, v)[0], growth(u + 1, v)[1] - growth(u, v)[1]


@cache
def _invariant_changes(id: str, orbit: str, early: int, steps: int) -> tuple[float, float]:
    """The largest change of the Lotka-Volterra invariant over the first ``early`` steps, and over all ``steps``."""
    made = problem(f"lotka-volterra:{orbit}")
    s = integrate(made, id, h=0.12, steps=steps)
    values = made.system.observe(made.system.H, s.q, s.p)
    return metrics.invariant_error(values[: early + 1]).max, metrics.invariant_error(values).max


def invariant_growth(id: str, orbit: str) -> tuple[float, float]:
    """The growth of the largest change of the Lotka-Volterra invariant along a run."""
    early, all_of_it = _invariant_changes(id, orbit, 120, 12000)
    first, then = _invariant_changes("implicit-euler", "4-8", 12, 120)
    return all_of_it / early - 1, then / first - 1


def damps() -> tuple[float, float]:
    """The largest ratio of the oscillator's energies after and before an implicit Euler step."""

    def factor(id: str) -> float:
        made = problem("harmonic-oscillator")
        runs = [integrate(made, id, h=h, steps=4) for h in (0.1, 1.0, 10.0)]
        energies = [made.system.observe(made.system.H, s.q, s.p) for s in runs]
        return max((E[1:] / E[:-1]).max() for E in energies)

    return factor("implicit-euler"), factor("explicit-euler")


EULERS = ("implicit-euler",)
LV = ("lotka-volterra",)
CHECKS = (
    Probe("lagrange", "difference of Hamilton's and Lagrange's equations, double pendulum", "with gravity 10 % off",
          lagrange, problems=("double-pendulum",)),
    Probe("pendulum", "difference to p' = −sin q", "to p' = −q", pendulum_equations, problems=("pendulum",)),
    Probe("first-integral", "change of H along the pendulum's flow to t = 10", "with friction", first_integral),
    Probe("oriented-areas", "ξᵀJη less the sum of areas, d = 3", "with the other sign of J", oriented_areas),
    Probe("linear-maps", "defects of both conditions for a product of shears", "the smaller one, off by 1e-3",
          linear_maps),
    Probe("poincare", "defect of the Hénon–Heiles flow, t = 1", "of the damped pendulum's", poincare),
    Probe("group", "φ₀.₇φ₀.₃ less φ₁", "less φ₁.₁", group),
    Probe("locally-hamiltonian", "asymmetry of (J f)' and defect of the flow, Hénon–Heiles", "of the damped pendulum",
          locally_hamiltonian),
    Probe("integrability", "integral of a symmetric field along a closed curve", "of one that is not symmetric",
          integrability),
    Probe("lotka-volterra", "difference to u(v − 2), v(1 − u)", "to another coefficient", lotka_volterra, problems=LV),
    Probe("level-curves", "rate of I along the field", "with 1.9 for 2", level_curves),
    Probe("species", "growth rate of u for one v more", "of v for one u more", species),
    Probe("closed-midpoint", "growth of max |I − I₀| from 120 to 12000 steps, less 1", "implicit Euler, 12 to 120",
          lambda: invariant_growth("implicit-midpoint", "4-2"), ("implicit-midpoint", *EULERS), LV),
    Probe("closed-euler", "growth of max |I − I₀| from 120 to 12000 steps, less 1", "implicit Euler, 12 to 120",
          lambda: invariant_growth("symplectic-euler-q", "4-2"), ("symplectic-euler-q", *EULERS), LV),
    Probe("damps", "largest energy factor of a step, h = 0.1, 1, 10", "of explicit Euler", damps,
          ("explicit-euler", *EULERS), ("harmonic-oscillator",)),
)  # fmt: skip
