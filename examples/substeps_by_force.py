"""A faulty leapfrog: the number of its sub-steps grows with the force, and its map jumps where the number changes.

`phasebench validate` must find the fault.
"""

CLAIMS = {"order": 2, "symplectic": True}
REQUIRES = ("separable",)


def step(system, q, p, h):
    n = 1 + int(3 * max(abs(system.dH_dq(q, p))))
    for _ in range(n):
        p = p - h / n / 2 * system.dH_dq(q, p)
        q = q + h / n * system.dH_dp(q, p)
        p = p - h / n / 2 * system.dH_dq(q, p)
    return q, p
