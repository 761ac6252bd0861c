"""A correct step function of leapfrog, as a user of the package would write it."""

from __future__ import annotations


def leapfrog(system, q, p, h):
    """Take one leapfrog step h (half a kick, drift, half a kick) from (q, p); return the new (q, p).

    It is written as a user would write a step function.
    """
    p = p - h / 2 * system.dH_dq(q, p)
    q = q + h * system.dH_dp(q, p)
    return q, p - h / 2 * system.dH_dq(q, p)
