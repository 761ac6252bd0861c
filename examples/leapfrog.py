"""The leapfrog, kick-drift-kick, a correct step: everything that it claims holds.

`phasebench validate` must pass it.
"""

CLAIMS = {
    "order": 2,
    "symplectic": True,
    "symmetric": True,
    "reversible": True,
    "energy": "bounded",
    "bilinear": "preserved",
    "stability": 2.0,
}
REQUIRES = ("separable",)


def step(system, q, p, h):
    p = p - h / 2 * system.dH_dq(q, p)
    q = q + h * system.dH_dp(q, p)
    return q, p - h / 2 * system.dH_dq(q, p)
