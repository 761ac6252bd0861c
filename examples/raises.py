"""A faulty leapfrog: it raises an exception at its third step.

`phasebench validate` must find the fault.
"""

CLAIMS = {"order": 2, "symplectic": True}
REQUIRES = ("separable",)
taken = []


def step(system, q, p, h):
    taken.append(h)
    if len(taken) == 3:
        raise RuntimeError("out of memory, said the third step")
    p = p - h / 2 * system.dH_dq(q, p)
    q = q + h * system.dH_dp(q, p)
    return q, p - h / 2 * system.dH_dq(q, p)
