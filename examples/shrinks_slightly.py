"""A leapfrog that shrinks the momenta by 5e-11 h^3 in each step: not symplectic, by little."""

CLAIMS = {"order": 2, "symplectic": True}
REQUIRES = ("separable",)


def step(system, q, p, h):
    p = p - h / 2 * system.dH_dq(q, p)
    q = q + h * system.dH_dp(q, p)
    p = p - h / 2 * system.dH_dq(q, p)
    return q, p * (1 - 5e-11 * h**3)
