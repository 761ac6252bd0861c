"""A faulty leapfrog: it damps the momenta, by h / 100 of them, in each step at whose end one is larger than 3.

`phasebench validate` must find the fault.
"""

CLAIMS = {"order": 2, "symplectic": True, "energy": "bounded"}
REQUIRES = ("separable",)


def step(system, q, p, h):
    p = p - h / 2 * system.dH_dq(q, p)
    q = q + h * system.dH_dp(q, p)
    p = p - h / 2 * system.dH_dq(q, p)
    return (q, p * (1 - h / 100)) if abs(p).max() > 3 else (q, p)
