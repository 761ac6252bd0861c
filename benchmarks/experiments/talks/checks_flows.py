"""Checks of the introductory talk: flows, symplectic maps, Lagrange's equations, Lotka-Volterra, first integrals.

Each function without a leading underscore returns (number, control): a number that is small if a statement of the talk
holds, and the same number for a case in which the statement must fail.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import cache

import numpy as np
import sympy as sp

from phasebench.benchmarks.measure import metrics, step_map
from phasebench.benchmarks.problems import problem
from phasebench.integrators import integrate

from .checks_base import J, Probe, damped_pendulum, defect, flow, henon_heiles, pendulum

POINT = (0.1, 0.2, 0.3, -0.25)
SWINGING = (1.0, 0.3)


def _random(*shape: int) -> np.ndarray:
    return np.random.default_rng(7).normal(size=shape)


def lagrange() -> tuple[float, float]:
    """Compare Lagrange's with Hamilton's equations of the double pendulum: (number, control).

    The number is the largest difference in dq/dt and dp/dt between the two at one state; the control is that in dp/dt
    if Lagrange's equations have another gravity.
    """
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
    """Return (number, control): the largest distance of this project's pendulum's dp/dt from -sin q, and from -q."""
    q, p = _random(2, 20, 1)
    system = problem("pendulum").system
    dp = system.observe(system.dp[0], q, p)
    return np.abs(dp + np.sin(q[:, 0])).max(), np.abs(dp + q[:, 0]).max()


def first_integral() -> tuple[float, float]:
    """Return (number, control): the change of H along the pendulum's flow, and along the flow with friction."""

    def change(field: Callable) -> float:
        y = flow(field, 10.0, 4000)(SWINGING)
        return abs((y[1] ** 2 - SWINGING[1] ** 2) / 2 - np.cos(y[0]) + np.cos(SWINGING[0]))

    return change(pendulum), change(damped_pendulum)


def oriented_areas() -> tuple[float, float]:
    """Return (number, control): the distance of xi^T J eta from the sum of oriented areas in the (p_i, q_i) planes.

    xi and eta are random vectors; the control has J^T for J.
    """
    xi, eta = _random(2, 6)
    areas = sum(xi[i] * eta[3 + i] - xi[3 + i] * eta[i] for i in range(3))
    return abs(xi @ J(3) @ eta - areas), abs(xi @ J(3).T @ eta - areas)


def linear_maps() -> tuple[float, float]:
    """Return (number, control): defects of A^T J A = J and omega(A xi, A eta) = omega(xi, eta) for a product of shears.

    The number is the larger defect; the control is the smaller one after A is changed by 1e-3.
    """
    S = _random(3, 3)
    one, zero = np.eye(3), np.zeros((3, 3))
    A = np.block([[one, S + S.T], [zero, one]]) @ np.block([[one, zero], [S @ S.T, one]])
    xi, eta = _random(2, 6)

    def off(A: np.ndarray) -> tuple[float, float]:
        form = abs((A @ xi) @ J(3) @ (A @ eta) - xi @ J(3) @ eta)
        return np.abs(A.T @ J(3) @ A - J(3)).max(), form

    return max(off(A)), min(off(A + 1e-3 * np.eye(6)))


def poincare() -> tuple[float, float]:
    """Return (number, control): the symplecticity defect of the Henon-Heiles flow, and of the damped pendulum's."""
    return defect(flow(henon_heiles, 1.0), POINT), defect(flow(damped_pendulum, 1.0), SWINGING)


def group() -> tuple[float, float]:
    """Return (number, control): the distance of phi_0.7 after phi_0.3 from phi_1, and from phi_1.1, at one state.

    phi_t is the Henon-Heiles flow.
    """
    y = flow(henon_heiles, 0.7)(flow(henon_heiles, 0.3)(POINT))
    return np.abs(y - flow(henon_heiles, 1.0)(POINT)).max(), np.abs(y - flow(henon_heiles, 1.1)(POINT)).max()


def _asymmetry(field: Callable, y: Sequence[float] | np.ndarray) -> float:
    """Return max |M - M^T| for the Jacobian M of J f at y, which is zero iff the field f is locally Hamiltonian."""
    M = J(len(y) // 2) @ step_map.jacobian(field, np.array(y, float))
    return np.abs(M - M.T).max()


def locally_hamiltonian() -> tuple[float, float]:
    """Return (number, control) of the test that a field f is locally Hamiltonian iff its flow is symplectic.

    For Henon-Heiles the number is the larger of the asymmetry of (J f)' and the symplecticity defect of the flow, both
    of which should vanish.  The control is the smaller of the two for the damped pendulum.
    """
    both = [
        (_asymmetry(f, y), defect(flow(f, 0.5), y)) for f, y in ((henon_heiles, POINT), (damped_pendulum, SWINGING))
    ]
    return max(both[0]), min(both[1])


def integrability() -> tuple[float, float]:
    """Return (number, control): the integral along a closed curve of a plane field with a symmetric Jacobian.

    The control is the integral of a field whose Jacobian is not symmetric.
    """
    angle = 2 * np.pi * np.arange(64) / 64
    x, y = 0.3 + np.cos(angle), 0.2 + np.sin(angle)
    dx, dy = -np.sin(angle), np.cos(angle)

    def around(fx: np.ndarray, fy: np.ndarray) -> float:
        return abs(np.mean(fx * dx + fy * dy) * 2 * np.pi)

    return around(x + 2 * x * y, y + x**2 - y**2), around(x + 2 * x * y, y - x**2 - y**2)


def lotka_volterra() -> tuple[float, float]:
    """Return (number, control): the distance of this project's Lotka-Volterra field from (u (v - 2), v (1 - u)).

    The control has another coefficient in the second component.
    """
    u, v = np.random.default_rng(7).uniform(0.5, 4, (2, 20, 1))
    system = problem("lotka-volterra").system
    du, dv = (system.observe(e, u, v) for e in (system.dq[0], system.dp[0]))
    u, v = u[:, 0], v[:, 0]
    off = np.abs(du - u * (v - 2)).max()
    return max(off, np.abs(dv - v * (1 - u)).max()), np.abs(dv - v * (1 - 1.1 * u)).max()


def level_curves() -> tuple[float, float]:
    """Return (number, control): the largest rate of I = ln u - u + 2 ln v - v along the Lotka-Volterra field.

    The control has the coefficient 1.9 for 2 in I.
    """
    u, v = np.random.default_rng(7).uniform(0.5, 4, (2, 20))

    def rate(two: float) -> float:
        return np.abs((1 / u - 1) * u * (v - 2) + (two / v - 1) * v * (1 - u)).max()

    return rate(2), rate(1.9)


def species() -> tuple[float, float]:
    """Return the changes of two growth rates in the Lotka-Volterra equations: of u's if v rises by 1, of v's if u does.

    The signs tell which is the predator: a predator's growth rate rises with its prey.
    """

    def growth(x: float, y: float) -> tuple[float, float]:
        return (y - 2), (1 - x)

    u, v = 1.5, 1.5
    return growth(u, v + 1)[0] - growth(u, v)[0], growth(u + 1, v)[1] - growth(u, v)[1]


@cache
def _invariant_changes(id: str, orbit: str, early: int, steps: int) -> tuple[float, float]:
    """Return the largest change of the Lotka-Volterra invariant over the first ``early`` steps, and over all ``steps``.

    The step is h = 0.12; ``id`` is the method's, ``orbit`` names the initial values.
    """
    made = problem(f"lotka-volterra:{orbit}")
    s = integrate(made, id, h=0.12, steps=steps)
    values = made.system.observe(made.system.H, s.q, s.p)
    return metrics.invariant_error(values[: early + 1]).max, metrics.invariant_error(values).max


def invariant_growth(id: str, orbit: str) -> tuple[float, float]:
    """Return (number, control): the growth of the largest change of the Lotka-Volterra invariant along a run.

    The number is the largest change over 12000 steps of the method ``id``, divided by that over 120 steps, minus 1; the
    control is that of implicit Euler, from 12 to 120 steps.
    """
    early, all_of_it = _invariant_changes(id, orbit, 120, 12000)
    first, then = _invariant_changes("implicit-euler", "4-8", 12, 120)
    return all_of_it / early - 1, then / first - 1


def damps() -> tuple[float, float]:
    """Return (number, control): the largest ratio of the oscillator's energies after and before an implicit Euler step.

    The oscillator is harmonic, the steps are 0.1, 1 and 10; the control is the ratio by explicit Euler.
    """

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
