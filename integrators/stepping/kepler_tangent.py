r"""The derivative of Kepler's flow along a change of the velocity, in universal variables.

With the notation of `kepler_flow`, :math:`G_n = s^n c_n(\beta s^2)` and :math:`\partial_s G_n = G_{n-1}`,

.. math::
    \partial_\beta G_n = \tfrac12\,(n\,G_{n+2} - s\,G_{n+1}),\qquad
    \delta\eta = q\cdot\delta v,\qquad \delta\beta = -2 v\cdot\delta v,

and the change of s follows from that of Kepler's equation, :math:`r_0 G_1 + \eta G_2 + \mu G_3 = h - kP`, where k
periods P were left out:

.. math::
    r\,\delta s = -G_2\,\delta\eta
      - (r_0\,\partial_\beta G_1 + \eta\,\partial_\beta G_2 + \mu\,\partial_\beta G_3)\,\delta\beta
      + \tfrac32\,kP\,\delta\beta/\beta .

Sources: S. Mikkola, K. Innanen, Celest. Mech. Dyn. Astron. 74 (1999) 59-67 (the derivatives of G); the rest is derived
here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from phasebench.integrators.values.vector import jit

from .kepler_flow import NUMBERS, anomaly, stumpff

if TYPE_CHECKING:
    import numpy as np

    from phasebench.integrators.values.kinds import Number, Value

#: From this argument on the higher functions follow from the lower ones without cancellation.
LARGE = 0.5


@jit
def higher(x: Number, c2: Number, c3: Number, eps: Number) -> tuple[Number, Number]:
    """Stumpff's functions (c_4, c_5)(x), from (c_2, c_3)(x) or, if x is small, by their series to round-off ``eps``."""
    if abs(x) > LARGE:
        return (1 / (2 + 0 * x) - c2) / x, (1 / (6 + 0 * x) - c3) / x
    a = 1 / (24 + 0 * x)
    b = 1 / (120 + 0 * x)
    c4, c5, n = a, b, 4
    while abs(a) > eps * abs(c4) / 64:
        a = -a * x / ((n + 1) * (n + 2))
        b = -b * x / ((n + 2) * (n + 3))
        c4, c5, n = c4 + a, c5 + b, n + 2
    return c4, c5


@jit
def move(
    X: np.ndarray,
    first: int,
    dimension: int,
    mass: Number,
    mu: Number,
    h: Number,
    eps: Number,
    table: np.ndarray,
    spans: np.ndarray,
    body: int,
    bodies: int,
) -> None:
    """Move one body along its Kepler orbit over the time h in the rows q, p of X, without compensated summation.

    The body's components are the columns first, ..., first + dimension - 1 of X; p is ``mass`` times the velocity; with
    mu = 0 the motion is free.  Writes the universal anomaly s to ``spans[body]`` and the time of whole periods that
    were left out to ``spans[bodies + body]``, for `kick_back`.
    """
    spans[body], spans[bodies + body] = h * 0, h * 0
    if mu == 0:
        for k in range(first, first + dimension):
            X[0, k] += h * X[1, k] / mass
        return
    rr = vv = eta = h * 0
    for k in range(first, first + dimension):
        q, v = X[0, k], X[1, k] / mass
        rr, vv, eta = rr + q * q, vv + v * v, eta + q * v
    r0 = rr**0.5
    beta, t = 2 * mu / r0 - vv, h
    if beta > 0 and h * h * beta * beta * beta > 9 * mu * mu:  # about half a period
        period = 2 * table[NUMBERS, 0] * mu / (beta * beta**0.5)
        t = h % period
        if t > period / 2:
            t = t - period
        spans[bodies + body] = h - t
    if t == 0:
        return
    sign = 1 if t > 0 else -1
    G1, G2, G3, r, _ = anomaly(r0, sign * eta, beta, mu, sign * t, eps, table)
    spans[body] = sign * (G1 + beta * G3)
    f, g, df, dg = -mu * G2 / r0, t - sign * mu * G3, -sign * mu * G1 / (r0 * r), -mu * G2 / r
    for k in range(first, first + dimension):
        q, v = X[0, k], X[1, k] / mass
        X[0, k] = q + (f * q + g * v)
        X[1, k] = mass * (v + (df * q + dg * v))


@jit
def kick_back(
    X: np.ndarray,
    first: int,
    dimension: int,
    mass: Number,
    mu: Number,
    h: Number,
    eps: Number,
    table: np.ndarray,
    spans: np.ndarray,
    body: int,
    bodies: int,
    kick: Value,
    out: int,
) -> None:
    """Apply the derivative of Kepler's flow over the time -h, at the end of a `move` over h, to a change ``kick`` of p.

    The end (q, p) of the `move` is in the rows 0 and 1 of X; the changes of its start that lead to this change of
    its end are written to the rows ``out`` (of q) and ``out + 1`` (of p).  ``spans`` is what `move` wrote; the other
    arguments are those of `move`.
    """
    if mu == 0:
        for k in range(first, first + dimension):
            X[out, k], X[out + 1, k] = -h * kick[k] / mass, kick[k]
        return
    rr = vv = eta = d_eta = d_vv = h * 0
    for k in range(first, first + dimension):
        q, v, dv = X[0, k], X[1, k] / mass, kick[k] / mass
        rr, vv, eta = rr + q * q, vv + v * v, eta + q * v
        d_eta, d_vv = d_eta + q * dv, d_vv + v * dv
    r0, s = rr**0.5, -spans[body]
    beta, d_beta = 2 * mu / r0 - vv, -2 * d_vv
    x = beta * s * s
    c0, c1, c2, c3 = stumpff(x, table)
    c4, c5 = higher(x, c2, c3, eps)
    G1, G2, G3, G4, G5 = s * c1, s * s * c2, s**3 * c3, s**4 * c4, s**5 * c5
    r = r0 * c0 + eta * G1 + mu * G2
    b1, b2, b3 = (G3 - s * G2) / 2, (2 * G4 - s * G3) / 2, (3 * G5 - s * G4) / 2  # by beta
    change = (r0 * b1 + eta * b2 + mu * b3) * d_beta
    if spans[bodies + body] != 0:
        change = change + 3 * spans[bodies + body] * d_beta / (2 * beta)  # of the time -h: k P is of the other sign
    ds = -(G2 * d_eta + change) / r
    dG1, dG2 = c0 * ds + b1 * d_beta, G1 * ds + b2 * d_beta
    g, dg = r0 * G1 + eta * G2, r0 * dG1 + d_eta * G2 + eta * dG2
    dr = r0 * (-G2 * d_beta - beta * dG2) + d_eta * G1 + eta * dG1 + mu * dG2
    a, b = -mu / r0 * (dG1 / r - G1 * dr / (r * r)), -mu * (dG2 / r - G2 * dr / (r * r))
    for k in range(first, first + dimension):
        q, v, dv = X[0, k], X[1, k] / mass, kick[k] / mass
        X[out, k] = -mu * dG2 / r0 * q + dg * v + g * dv
        X[out + 1, k] = mass * (a * q + b * v + (1 - mu * G2 / r) * dv)
