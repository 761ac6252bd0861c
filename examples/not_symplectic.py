"""The classical Runge-Kutta method of order 4, which claims to be symplectic and is not.

`phasebench validate` must contradict the claim.
"""

CLAIMS = {"order": 4, "symplectic": True}


def step(system, q, p, h):
    def slopes(q, p):
        return system.dH_dp(q, p), -system.dH_dq(q, p)

    q1, p1 = slopes(q, p)
    q2, p2 = slopes(q + h / 2 * q1, p + h / 2 * p1)
    q3, p3 = slopes(q + h / 2 * q2, p + h / 2 * p2)
    q4, p4 = slopes(q + h * q3, p + h * p3)
    return q + h / 6 * (q1 + 2 * q2 + 2 * q3 + q4), p + h / 6 * (p1 + 2 * p2 + 2 * p3 + p4)
