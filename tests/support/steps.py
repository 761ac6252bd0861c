"""Step functions, as a user of the package would write them."""

from __future__ import annotations


def leapfrog(system, q, p, h):
    """Half a kick, a drift, half a kick."""
    p = p - h / 2 * system.dH_dq(q, p)
    q = q + h * system.dH_dp(q, p)
    return q, p - h / 2 * system.dH_dq(q, p)


def euler(system, q, p, h):
    """The explicit Euler method."""
    return q + h * system.dH_dp(q, p), p - h * system.dH_dq(q, p)


def symplectic_euler(system, q, p, h):
    """A kick, then a drift."""
    p = p - h * system.dH_dq(q, p)
    return q + h * system.dH_dp(q, p), p
