"""A faulty leapfrog: it reuses the last gradient, which is wrong when two orbits are stepped in turns.

`phasebench validate` must find the fault.
"""

CLAIMS = {"order": 2, "symplectic": True}
REQUIRES = ("separable",)
last = {}


def step(system, q, p, h):
    force = last.get(len(q))
    if force is None:
        force = -system.dH_dq(q, p)
    p = p + h / 2 * force
    q = q + h * system.dH_dp(q, p)
    last[len(q)] = force = -system.dH_dq(q, p)
    return q, p + h / 2 * force
