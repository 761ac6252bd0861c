"""A leapfrog whose last kick and drift are exchanged: half a drift where half a kick should be."""

CLAIMS = {"order": 2, "symplectic": True}
REQUIRES = ("separable",)


def step(system, q, p, h):
    p = p - h / 2 * system.dH_dq(q, p)
    q = q + h / 2 * system.dH_dp(q, p)
    p = p - h / 2 * system.dH_dq(q, p)
    return q + h / 2 * system.dH_dp(q, p), p
