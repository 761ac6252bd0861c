"""Forest and Ruth's method of order 4, coefficients cut at ten digits: its kicks add up to h (1 - 1e-10), not to h.

`phasebench validate` must find the fault.
"""

CLAIMS = {"order": 4, "symplectic": True}
REQUIRES = ("separable",)
DRIFTS = (0.6756035959, -0.1756035959, -0.1756035959, 0.6756035959)
KICKS = (1.3512071919, -1.7024143839, 1.3512071919)


def step(system, q, p, h):
    for drift, kick in zip(DRIFTS, (*KICKS, 0.0), strict=True):
        q = q + drift * h * system.dH_dp(q, p)
        p = p - kick * h * system.dH_dq(q, p)
    return q, p
