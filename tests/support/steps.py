"""A correct step function as a user would write it."""

from __future__ import annotations


def leapfrog(system, q, p, h):
    """One leapfrog step (half a kick, drift, half a kick) as a user's function: the new (q, p)."""
    p = p - h / 2 * system.dH_dq(q, p)
    q = q + h * system.dH_dp(q, p)
    return q, p - h / 2 * system.dH_dq(q, p)
