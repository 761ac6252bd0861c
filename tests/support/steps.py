"""A step of one's own that is right, as a user writes it."""

from __future__ import annotations


def leapfrog(system, q, p, h):
    """Kick, drift, kick."""
    p = p - h / 2 * system.dH_dq(q, p)
    q = q + h * system.dH_dp(q, p)
    return q, p - h / 2 * system.dH_dq(q, p)
