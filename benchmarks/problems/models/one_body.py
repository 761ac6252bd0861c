r"""Models of one body: the pendulum with sin q expanded, Kepler's orbit without or with an averaged Schwarzschild term.

From rest at A the pendulum's frequency is :math:`1 - A^2/16 + O(A^4)` (Lindstedt).
"""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt

import numpy as np
import sympy as sp

from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.base import Problem

from .ladder import Lift, Rung, model_problem, with_start


def pendulum_models(amplitude: float) -> tuple[Rung, ...]:
    """Return the models of the pendulum released at rest at ``amplitude`` (radians): harmonic, sin q expanded, full."""
    q, p = sp.symbols("q p", real=True)
    start = (amplitude,), (0.0,)

    def polynomial(terms: int) -> Callable[[], Problem]:
        V = sum((-1) ** (k + 1) * q ** (2 * k) / sp.factorial(2 * k) for k in range(1, terms + 1))
        return lambda: model_problem(f"pendulum-{terms}", [q], [p], p**2 / 2 + V, start)

    shifted = 1 - amplitude**2 / 16
    return (
        Rung("harmonic", lambda: with_start(problem("harmonic-oscillator"), *start)),
        Rung(
            "harmonic, Lindstedt's frequency",
            lambda: with_start(problem("harmonic-oscillator", omega=shifted), *start),
        ),
        Rung("sin q to q^3", polynomial(2)),
        Rung("sin q to q^5", polynomial(3)),
        Rung("pendulum", lambda: _pendulum(*start)),
    )


def _pendulum(q: tuple[float, ...], p: tuple[float, ...]) -> Problem:
    """The pendulum from (q, p); the registered orbit, which has certified states, if that is its start."""
    swinging = problem("pendulum:swinging")
    return swinging if (swinging.q0, swinging.p0) == (q, p) else with_start(swinging, q, p)


def rotation(rate: float) -> Lift:
    """Make a map of a model's rows (q, p) at times t to the full problem's: the rotation in the plane by ``rate`` t."""

    def lift(full: Problem, t: np.ndarray, q: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        c, s = np.cos(rate * t), np.sin(rate * t)
        return tuple(np.stack([c * z[:, 0] - s * z[:, 1], s * z[:, 0] + c * z[:, 1]], axis=1) for z in (q, p))

    return lift


def mean_semi_axis(e: float, mu: float) -> float:
    r"""Return the mean semi-major axis :math:`L^2` of the orbit from the pericentre 1 - e with the Schwarzschild term.

    With :math:`G = \sqrt{1 - e^2}` conserved, L is such that the averaged energy :math:`-1/(2L^2) - \mu/(3L^3G^3)`
    equals the energy (to first order in mu).
    """
    G = sqrt(1 - e**2)
    energy = -0.5 - mu / (3 * (1 - e) ** 3)
    L = 1.0
    for _ in range(50):
        f = -0.5 / L**2 - mu / (3 * (L * G) ** 3) - energy
        L -= f / (1 / L**3 + mu / (L**4 * G**3))
    return L**2


def kepler_models(e: float, mu: float) -> tuple[Rung, ...]:
    r"""Return the models of the Kepler problem with the Schwarzschild term :math:`-\mu/(3r^3)`, at eccentricity e.

    The term is left out, replaced by its average :math:`F = -\mu/(3L^3G^3)` in Delaunay's elements :math:`L = \sqrt a`,
    :math:`G = \sqrt{a(1 - e^2)}`, or kept.  With the average the pericentre turns at the rate
    :math:`\partial F/\partial G = \mu/(L^3G^4)`, and the rate of the mean anomaly is larger by
    :math:`\partial F/\partial L = \mu/(L^4G^3)`.  The model "Kepler, mean precession" only turns the Kepler orbit, with
    the L of the start; "averaged, mean elements" has both rates, with the mean L (`mean_semi_axis`).
    """
    G, a = sqrt(1 - e**2), mean_semi_axis(e, mu)
    L = sqrt(a)
    near = a * (1 - sqrt(1 - G**2 / a))
    return (
        Rung("Kepler", lambda: problem("kepler", e=e)),
        Rung("Kepler, mean precession", lambda: problem("kepler", e=e), rotation(mu / G**4)),
        Rung(
            "averaged, mean elements",
            lambda: with_start(problem("kepler", e=e), (near, 0.0), (0.0, G / near)),
            rotation(mu / (L**3 * G**4)),
            rate=1 + mu / (L * G**3),
        ),
        Rung("the term itself", lambda: problem("perturbed-kepler", e=e, mu=mu)),
    )
