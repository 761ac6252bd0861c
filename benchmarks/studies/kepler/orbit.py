r"""Errors of a Kepler orbit, with the Schwarzschild term or without, in energy, angular momentum, phase and perihelion.

H = |p|^2/2 - 1/r - mu/(3 r^3) is integrable.  With u = 1/r, k = 2 mu/3 and the energy E its radial momentum is
:math:`p_r^2 = 2E + 2u - L^2u^2 + ku^3`, between pericentre and apocentre
:math:`p_r^2 = g(u)^2\,(w^2 - (u - m)^2)` with :math:`g(u)^2 = L^2 - k(2m + u)` and
:math:`2mL^2 - 3km^2 - kw^2 = 2`.  A true anomaly :math:`\chi`, :math:`u = m + w\cos\chi`, and an eccentric one
:math:`\eta`, :math:`r = a(1 - \epsilon\cos\eta)`, :math:`\epsilon = w/m`, :math:`a = m/(m^2 - w^2)`, turn angle and
time into integrals of smooth functions (Kepler's own for mu = 0),

.. math::
    \varphi = \int_0^\chi\frac{L}{g}\,d\chi, \qquad t = a\sqrt{1-\epsilon^2}\int_0^\eta\frac rg\,d\eta .

A radial period T advances the pericentre by Delta = phi(2 pi) - 2 pi.  The angle variables of the problem are the mean
anomaly M = 2 pi t/T and, for a state at the polar angle theta, the perihelion
:math:`\varpi = \theta - \varphi(\chi) + \Delta M/2\pi`; both grow linearly in time along an exact solution, as does
the mean longitude :math:`M + \varpi`, which is defined on a circle too.  Osculating Kepler elements, on the contrary,
oscillate in each orbit by O(mu).

With the roots u1 < u2 < u3 of :math:`p_r^2` the advance is an elliptic integral, to first order that of perturbation
theory,

.. math::
    \Delta = 2\int_{r_-}^{r_+}\frac{L\,dr}{r^2p_r} - 2\pi
           = \frac{4L}{\sqrt{k(u_3-u_1)}}\,K\Bigl(\frac{u_2-u_1}{u_3-u_1}\Bigr) - 2\pi
           = \frac{2\pi\mu}{L^4} + O(\mu^2) .

Sources: H. Goldstein, C. Poole, J. Safko, Classical Mechanics (2002), 3.6-3.9, 10.8, 12.3; S. Chandrasekhar, The
Mathematical Theory of Black Holes (1983), section 19, for the cubic and its elliptic integral; D. Brouwer, Astron. J.
46 (1937) 149-153, for the growth of round-off.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from phasebench.integrators.errors import InvalidInput

if TYPE_CHECKING:
    from types import SimpleNamespace

    import mpmath
    from numpy.typing import ArrayLike

    from phasebench.benchmarks.problems.base import Problem

#: Nodes of the quadratures of phi and t from pericentre; a test of the elements doubles them.
NODES = 40
#: Newton steps for m; the start 1/L^2 is exact without the perturbation.
NEWTON = 30
#: Below this eccentricity the perihelion counts as undefined: it would be round-off divided by the eccentricity.
ROUND = 1e-10
#: Digits of the exact advance and period.
DIGITS = 40
#: Times and rates are integers in units of 2^-TICK, which hold any double h exactly: n h modulo a period is exact.
TICK = 200


class Elements(NamedTuple):
    """Eccentricity, mean anomaly, direction of the perihelion (NaN on a circle) and mean longitude, in radians.

    They are arrays (n,), NaN for an unbound state; the longitude is perihelion + anomaly, and defined on a circle too.
    """

    eccentricity: np.ndarray
    anomaly: np.ndarray
    perihelion: np.ndarray
    longitude: np.ndarray


def elements(q: ArrayLike, p: ArrayLike, mu: float = 0.0, nodes: int = NODES) -> Elements:
    """The elements of states q, p, arrays (n, 2), of the (perturbed) Kepler problem of strength ``mu``."""
    q, p = np.atleast_2d(np.asarray(q, float)), np.atleast_2d(np.asarray(p, float))
    k = 2 * mu / 3
    with np.errstate(all="ignore"):
        r = np.hypot(q[:, 0], q[:, 1])
        u, radial = 1 / r, (q * p).sum(1) / r
        L = q[:, 0] * p[:, 1] - q[:, 1] * p[:, 0]
        size = L**2
        m = 1 / size
        for _ in range(NEWTON if k else 0):
            g2 = size - k * (2 * m + u)
            value = 2 * m * size - 3 * k * m**2 - k * ((u - m) ** 2 + radial**2 / g2) - 2
            m = m - value / (2 * size - 6 * k * m + 2 * k * (u - m) - 2 * (k * radial / g2) ** 2)
        sine, cosine = radial / np.sqrt(size - k * (2 * m + u)), u - m
        w = np.hypot(sine, cosine)
        e = w / m
        bound = np.isfinite(e) & (e < 1) & (m > 0)
        m, w, e = (np.where(bound, x, np.nan) for x in (m, w, e))
        root = np.sqrt(1 - e**2)
        chi = np.arctan2(sine, cosine)
        eta = np.arctan2(root * np.sin(chi), e + np.cos(chi))
        x, weights = np.polynomial.legendre.leggauss(nodes)

        def integral(f: Callable[[np.ndarray], np.ndarray], end: np.ndarray) -> np.ndarray:
            return (f(np.outer(end / 2, x + 1)) * weights).sum(1) * end / 2

        def over_g(u: np.ndarray) -> np.ndarray:
            return 1 / np.sqrt(size[:, None] - k * (2 * m[:, None] + u))

        def angle(y: np.ndarray) -> np.ndarray:
            return np.abs(L)[:, None] * over_g(m[:, None] + w[:, None] * np.cos(y))

        def time(y: np.ndarray) -> np.ndarray:
            r = (m / (m**2 - w**2))[:, None] * (1 - e[:, None] * np.cos(y))
            return r * over_g(1 / r)

        whole = np.full(len(m), np.pi)
        half = integral(time, whole)
        advance = 2 * integral(angle, whole) - 2 * np.pi if k else np.where(bound, 0.0, np.nan)
        anomaly = np.pi * integral(time, eta) / half
        passed = integral(angle, chi) if k else chi
        turn = np.sign(L)
        perihelion = np.arctan2(q[:, 1], q[:, 0]) - turn * (passed - advance * anomaly / (2 * np.pi))
        longitude = perihelion + turn * anomaly
    return Elements(e, anomaly, np.where(e > ROUND, perihelion, np.nan), longitude)


def first_order_advance(L: float, mu: float) -> float:
    """The advance of the perihelion per radial period, in radians, to first order in mu."""
    return 2 * np.pi * mu / L**4


def exact_orbit(
    q: Sequence[float] | np.ndarray, p: Sequence[float] | np.ndarray, mu: float = 0.0, digits: int = DIGITS
) -> tuple[mpmath.mpf, mpmath.mpf]:
    """(Advance of the perihelion per radial period, radial period) of the orbit through doubles q, p, arrays (2,).

    Raises InvalidInput where that orbit is not bound or falls into the centre.
    """
    import mpmath

    with mpmath.workdps(digits + 15):
        (x, y), (v, w) = ([mpmath.mpf(float(c)) for c in s] for s in (q, p))
        k, r, L = 2 * mpmath.mpf(float(mu)) / 3, mpmath.hypot(x, y), x * w - y * v
        E = (v**2 + w**2) / 2 - 1 / r - k / (2 * r**3)
        roots = mpmath.polyroots(([k] if k else []) + [-(L**2), 2, 2 * E], maxsteps=500, extraprec=300)
        # A double root (a circle) comes out as a pair with imaginary parts of half the precision.
        real = sorted(mpmath.re(z) for z in roots if abs(mpmath.im(z)) < mpmath.mpf(10) ** (-digits // 3))
        if E >= 0 or len(real) != len(roots) or not real[0] > 0:
            raise InvalidInput(f"q = {list(q)}, p = {list(p)} is on no bound orbit that keeps away from the centre")
        low, high = real[:2]
        m, half = (low + high) / 2, (high - low) / 2
        e = half / m
        a = m / (m**2 - half**2)

        def time(eta: mpmath.mpf) -> mpmath.mpf:
            r = a * (1 - e * mpmath.cos(eta))
            return r / mpmath.sqrt(L**2 - k * (2 * m + 1 / r))

        period = 2 * a * mpmath.sqrt(1 - e**2) * mpmath.quad(time, [0, mpmath.pi / 2, mpmath.pi])
        advance = mpmath.mpf(0)
        if k:
            top = real[2] - low
            advance = 4 * abs(L) / mpmath.sqrt(k * top) * mpmath.ellipk((high - low) / top) - 2 * mpmath.pi
        return +advance, +period


@dataclass(frozen=True)
class Truth:
    """The exact orbit through one state: its invariants, elements at the start, advance and period as `exact_orbit`.

    ``anomaly`` and ``perihelion`` are the rates of these angles, integers in units of 2^-`TICK` turns per unit of time,
    so that angles at late times lose no digits.
    """

    mu: float
    H: np.longdouble
    L: np.longdouble
    start: Elements
    advance: float
    period: float
    anomaly: int
    perihelion: int


def invariants(q: ArrayLike, p: ArrayLike, mu: float) -> tuple[np.ndarray, np.ndarray]:
    """Energy and angular momentum, arrays (n,), of states q, p (n, 2) in long double."""
    q, p = np.asarray(q, np.longdouble), np.asarray(p, np.longdouble)
    r = np.sqrt((q**2).sum(-1))
    H = (p**2).sum(-1) / 2 - 1 / r - np.longdouble(mu) / (3 * r**3)
    return H, q[..., 0] * p[..., 1] - q[..., 1] * p[..., 0]


def truth(problem: Problem | SimpleNamespace) -> Truth:
    """The exact solution of a ``kepler`` or ``perturbed-kepler`` problem."""
    import mpmath

    mu = problem.parameters.get("mu", 0.0)
    q, p = np.array(problem.q0), np.array(problem.p0)
    advance, period = exact_orbit(q, p, mu)
    with mpmath.workdps(DIGITS + 15):
        rates = [1 / period, advance / (2 * mpmath.pi) / period]
        anomaly, perihelion = (int(x * 2**TICK) for x in rates)
    H, L = invariants(q, p, mu)
    return Truth(mu, H, L, elements(q, p, mu), float(advance), float(period), anomaly, perihelion)


def times(h: float, index: Sequence[int], exactly: bool = True) -> list[int]:
    """The times of the step numbers ``index`` with step h, as integers in units of 2^-`TICK`.

    They are n h without rounding or, as an adaptive integrator is asked for them, rounded to double.
    """
    step = int(Fraction(h) * 2**TICK)
    return [step * int(n) if exactly else int(Fraction(h * int(n)) * 2**TICK) for n in index]


def _angle(rate: int, when: Sequence[int]) -> np.ndarray:
    """Angles in [0, 2 pi) after each of the times ``when`` at a constant rate, array (n,)."""
    return np.array([(rate * t >> TICK) % 2**TICK / 2**TICK for t in when]) * 2 * np.pi


class Errors(NamedTuple):
    """Signed errors of n states, arrays (n,): relative ones of invariants, unwrapped ones of angles in radians.

    All are NaN from the first state on that is on no bound orbit; ``perihelion`` and ``anomaly`` are NaN everywhere if
    the exact orbit is a circle.  ``phase`` is the error of the mean longitude.
    """

    energy: np.ndarray
    momentum: np.ndarray
    phase: np.ndarray
    perihelion: np.ndarray
    anomaly: np.ndarray


def errors(exact: Truth, when: Sequence[int], q: np.ndarray, p: np.ndarray) -> Errors:
    """The errors of states q, p, arrays (n, 2), at times ``when`` (from `times`).

    Angles are unwrapped from row to row: rows must be so dense that an error grows by less than pi between them.
    """
    H, L = invariants(q, p, exact.mu)
    found = elements(q, p, exact.mu)
    anomaly, perihelion = _angle(exact.anomaly, when), _angle(exact.perihelion, when)
    turn = float(np.sign(exact.L))

    def away(value: np.ndarray, expected: np.ndarray) -> np.ndarray:
        return np.unwrap(np.concatenate([[0.0], np.remainder(value - expected + np.pi, 2 * np.pi) - np.pi]))[1:]

    M = away(found.anomaly, exact.start.anomaly + anomaly)
    varpi = away(found.perihelion, exact.start.perihelion + turn * perihelion)
    phase = away(found.longitude, exact.start.longitude + turn * (anomaly + perihelion))
    if np.isnan(exact.start.perihelion).any():
        M, varpi = np.full_like(M, np.nan), np.full_like(varpi, np.nan)
    relative = [((x - y) / abs(y)).astype(float) for x, y in ((H, exact.H), (L, exact.L))]
    return Errors(*relative, phase, varpi, M)


def advances(exact: Truth, when: Sequence[int], found: Errors, row: int) -> dict[str, float]:
    """The mean advance of the perihelion a radial period up to a row of the errors at times ``when``, and its error.

    Empty without the Schwarzschild term.
    """
    if not exact.mu:
        return {}
    turns = (exact.anomaly * when[row] >> TICK) / 2**TICK
    angle = exact.advance * turns + float(np.sign(exact.L)) * found.perihelion[row]
    measured = angle / (turns + found.anomaly[row] / (2 * np.pi))
    return {"advance": measured, "advance error": measured - exact.advance}
