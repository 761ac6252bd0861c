r"""The Fermi-Pasta-Ulam problem with stiff springs: m stiff linear springs between soft nonlinear ones.

With :math:`q_{0i}` the scaled displacement and :math:`q_{1i}` the expansion of the i-th stiff spring,

.. math::
    H = \tfrac12\sum_{i=1}^m (p_{0i}^2 + p_{1i}^2) + \tfrac{\omega^2}2 \sum_{i=1}^m q_{1i}^2
    + \tfrac14\Bigl((q_{01} - q_{11})^4 + \sum_{i=1}^{m-1} (q_{0,i+1} - q_{1,i+1} - q_{0i} - q_{1i})^4
    + (q_{0m} + q_{1m})^4\Bigr).

The motion is chaotic.  The stiff springs exchange energy over times of order omega, while the oscillatory energy
I = I_1 + ... + I_m, :math:`I_j = (p_{1j}^2 + \omega^2 q_{1j}^2)/2`, stays within O(1/omega) of its first value over
times exponentially long in omega: an adiabatic invariant, not an exact one (`oscillatory_energies`).

More than ten stiff springs run on hand-written loops instead of derived formulae.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any

import numpy as np
import sympy as sp

from phasebench.integrators.compile.codegen import value_kind
from phasebench.integrators.systems.hamiltonian import Hamiltonian
from phasebench.integrators.systems.hand import HandHamiltonian, unit_mass_field
from phasebench.integrators.values.kinds import Number

from .base import Orbit, Pace, Problem, check_positive, decades, whole

PARAMETERS = {"omega": 50.0, "m": 3}
#: The most stiff springs.
LARGEST = 5000


def grad_V(w2: Number, sign: int = 1) -> Callable[..., None]:
    """Make the function f(q, g) that writes ``sign`` times the gradient of the springs' V(q) to g; w2 = omega^2."""

    def f(q: np.ndarray, g: np.ndarray) -> None:
        m = len(q) // 2
        soft, stiff, g_soft, g_stiff = q[:m], q[m:], g[:m], g[m:]
        s = soft[0] - stiff[0]
        left = s * s * s
        for i in range(m - 1):
            s = soft[i + 1] - stiff[i + 1] - soft[i] - stiff[i]
            right = s * s * s
            g_soft[i] = sign * (left - right)
            g_stiff[i] = sign * (w2 * stiff[i] - left - right)
            left = right
        s = -soft[m - 1] - stiff[m - 1]
        right = s * s * s
        g_soft[m - 1] = sign * (left - right)
        g_stiff[m - 1] = sign * (w2 * stiff[m - 1] - left - right)

    return f


def grad_U(w2: Number) -> Callable[..., None]:
    """Make the function f(q, g) that writes the gradient of the soft springs' potential to g; w2 is not used."""
    return grad_V(0 * w2)


def field(w2: Number) -> Callable[..., None]:
    """Make the loop f(q, p, h, lam, dq, dp) of the vector field (p, -grad V), see `systems.hand`; w2 = omega^2."""
    return unit_mass_field(grad_V(w2, -1))


def energy(w2: Number) -> Callable[..., tuple[Number, Number]]:
    """Make the function f(q, p) -> (H, M) of the springs, w2 = omega^2; H's round-off is about M machine epsilons."""

    def f(q: np.ndarray, p: np.ndarray) -> tuple[Number, Number]:
        m = len(q) // 2
        s = q[0] - q[m]
        left = s * s * s
        H = left * s / 4
        M = left * s / 4
        for i in range(m):
            j = i + 1
            s = q[j] - q[m + j] - q[i] - q[m + i] if j < m else -q[i] - q[m + i]
            right = s * s * s
            v, stiff = p[i] * p[i] + p[m + i] * p[m + i], w2 * q[m + i]
            terms = (v + stiff * q[m + i]) / 2 + right * s / 4
            H += terms
            M += terms + v + abs(q[i] * (left - right)) + abs(q[m + i] * (stiff - left - right))
            left = right
        return H, M

    return f


def soft_springs(q0: Sequence[Any] | np.ndarray, q1: Sequence[Any] | np.ndarray) -> list:
    """Return the m + 1 expansions of the soft springs, from the left, of m displacements q0 and m expansions q1."""
    between = (q0[i + 1] - q1[i + 1] - q0[i] - q1[i] for i in range(len(q0) - 1))
    return [q0[0] - q1[0], *between, q0[-1] + q1[-1]]


def formula(omega: float, m: int) -> tuple[list[sp.Symbol], list[sp.Symbol], sp.Expr]:
    """Return (q, p, H) of m stiff springs of frequency omega; the m soft coordinates stand before the m stiff ones."""
    w = sp.Rational(omega)  # exactly the double
    q0, q1, p0, p1 = (
        sp.symbols([f"{name}{i}" for i in range(1, m + 1)], real=True) for name in ("q0", "q1", "p0", "p1")
    )
    soft = (s**4 / 4 for s in soft_springs(q0, q1))
    terms = [*(p**2 / 2 for p in (*p0, *p1)), *(w**2 * q**2 / 2 for q in q1), *soft]
    return [*q0, *q1], [*p0, *p1], sp.Add(*terms)


def make(omega: float, m: int) -> Problem:
    """Make the problem of ``m`` stiff springs of frequency ``omega`` > 0, started with the first of them excited."""
    check_positive("the stiff springs", omega=omega)
    m = whole("m of stiff springs", m, 1, LARGEST)
    q, p, H = formula(omega, m)
    rest = (0.0,) * (m - 1)
    frequencies = [0] * m + [sp.Rational(omega)] * m
    if value_kind(2 * m) == "tuple":
        system = Hamiltonian(q=q, p=p, H=H, frequencies=frequencies)
    else:
        loops = {"field": field, "grad_V": grad_V, "grad_U": grad_U, "energy": energy}
        of = {"constants": (Fraction(omega) ** 2,), "degree": 4, "frequencies": frequencies}
        system = HandHamiltonian(q=q, p=p, H=H, loops=loops, **of)
    start = Orbit(
        "one-spring",
        (1.0, *rest, 1.0 / omega, *rest),
        (1.0, *rest, 1.0, *rest),
        "energy in the first stiff spring",
        decades(200.0),
    )
    return Problem(
        id="fpu",
        name="Fermi-Pasta-Ulam with stiff springs",
        source="Hairer, Lubich & Wanner 2006, I.5.1; Galgani et al. 1992, Physica D 59, 334-348",
        cite=("hairer2006", "galgani1992"),
        system=system,
        orbits=(start,),
        parameters={"omega": omega, "m": m},
        pace=Pace(unit=0.05, step=0.004, span=0.2, later=0.05),
    )


def oscillatory_energies(made: Problem) -> tuple[sp.Expr, ...]:
    """Return the energies I_1, ..., I_m of the stiff springs of a problem, as expressions."""
    s = made.system
    fast = [(w, q, p) for w, q, p in zip(s.frequencies, s.q, s.p, strict=True) if w != 0]
    return tuple((p**2 + w**2 * q**2) / 2 for w, q, p in fast)
