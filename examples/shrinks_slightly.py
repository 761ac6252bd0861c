"""A faulty leapfrog, off by a share 1e-10 of its distance from Heun's step, so it is slightly not symplectic.

`phasebench validate` does not judge the claim that it is symplectic: so small a defect may be round-off.
"""

CLAIMS = {"order": 2, "symplectic": True}
REQUIRES = ("separable",)


def step(system, q, p, h):
    a, b = system.dH_dp(q, p), -system.dH_dq(q, p)
    heun = q + h / 2 * (a + system.dH_dp(q + h * a, p + h * b)), p + h / 2 * (b - system.dH_dq(q + h * a, p + h * b))
    p = p + h / 2 * b
    q = q + h * system.dH_dp(q, p)
    p = p - h / 2 * system.dH_dq(q, p)
    return q - 1e-10 * (heun[0] - q), p - 1e-10 * (heun[1] - p)
