"""Heun's method, which is of order 2 and claims order 3.

`phasebench validate` must contradict the claim.
"""

CLAIMS = {"order": 3}


def step(system, q, p, h):
    dq, dp = system.dH_dp(q, p), -system.dH_dq(q, p)
    q1, p1 = q + h * dq, p + h * dp
    return q + h / 2 * (dq + system.dH_dp(q1, p1)), p + h / 2 * (dp - system.dH_dq(q1, p1))
