"""Stability limits of h omega on the harmonic oscillator as others print them, or in closed form, with the source.

``digits`` is how many significant digits are printed: a measured limit agrees where it rounds to these.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

#: What is stable at every step.
UNLIMITED = math.inf
EXACT = 10

HLW = "Hairer, Lubich & Wanner 2006"
STIFF = "Hairer & Wanner 1996"


@dataclass(frozen=True)
class Limit:
    """A limit that is known.

    Attributes
    ----------
    method : an id, or the name of a step in `STEPS`
    value : `UNLIMITED`, or the limit
    source : who prints or proves it, and where
    parameters, digits : of the method; of the value as it is printed
    """

    method: str
    value: float
    source: str
    parameters: dict[str, str] = field(default_factory=dict)
    digits: int = EXACT


def _runge_kutta(rows, weights):
    """The step of an explicit Runge-Kutta method."""

    def step(system, q, p, h):
        slopes = []
        for row in (*rows, weights):
            at_q = q + h * sum((a * k for a, (k, _) in zip(row, slopes, strict=False)), 0 * q)
            at_p = p + h * sum((a * k for a, (_, k) in zip(row, slopes, strict=False)), 0 * p)
            slopes.append((system.dH_dp(at_q, at_p), -system.dH_dq(at_q, at_p)))
        return at_q, at_p

    return step


#: Methods that the registry lacks: Heun's of order 2 and Kutta's of order 3.
STEPS = {
    "heun-2": _runge_kutta(((), (1.0,)), (0.5, 0.5)),
    "kutta-3": _runge_kutta(((), (0.5,), (-1.0, 2.0)), (1 / 6, 2 / 3, 1 / 6)),
}

_CUBE = 2 ** (1 / 3)
_VERLET = f"{HLW}, XIII.1: h omega < 2"
_A_STABLE = f"{STIFF}, IV.3: A-stable"
_SCHEME_I = "closed form: the trace 2 - z^2 / (1 + lam (1 - lam) z^2) gives z |1 - 2 lam| < 2"

LIMITS = (
    Limit("stormer-verlet", 2.0, _VERLET),
    Limit("stormer-verlet-dkd", 2.0, _VERLET),
    Limit("symplectic-euler-p", 2.0, f"{_VERLET}; conjugate to Stormer-Verlet"),
    Limit("symplectic-euler-q", 2.0, f"{_VERLET}; conjugate to Stormer-Verlet"),
    Limit("lobatto-iiia-iiib-2", 2.0, f"{HLW}, II.2: it is Stormer-Verlet"),
    Limit("variational-trapezoidal", 2.0, "Marsden & West 2001: it is Stormer-Verlet"),
    Limit("explicit-euler", 0.0, f"{HLW}, I.1: spirals outwards"),
    Limit("heun-2", 0.0, f"{STIFF}, IV.2: |R(iy)|^2 = 1 + y^4 / 4"),
    Limit("kutta-3", math.sqrt(3), f"{STIFF}, IV.2: 1.732 on the imaginary axis", digits=4),
    Limit("rk4", math.sqrt(8), f"{STIFF}, IV.2: 2.828 on the imaginary axis", digits=4),
    Limit("mclachlan-s2", 2.55, "Blanes, Casas & Sanz-Serna 2014, SIAM J. Sci. Comput. 36, A1556", digits=3),
    Limit(
        "forest-ruth",
        (2 - _CUBE) * math.sqrt(2 * (1 + _CUBE)),
        "closed form: the trace of three leapfrogs gives z = (2 - 2^(1/3)) (2 + 2^(4/3))^(1/2)",
    ),
    Limit("implicit-euler", UNLIMITED, _A_STABLE),
    Limit("implicit-midpoint", UNLIMITED, "Skeel, Zhang & Schlick 1997, SIAM J. Sci. Comput. 18, 203"),
    Limit("gauss-2", UNLIMITED, _A_STABLE),
    Limit("gauss-4", UNLIMITED, _A_STABLE),
    Limit("radau-iia-3", UNLIMITED, f"{_A_STABLE} (Ehle 1969)"),
    Limit("imex", UNLIMITED, "Stern & Grinspun 2009"),
    Limit("avf", UNLIMITED, "Quispel & McLaren 2008: the midpoint rule where H is quadratic"),
    Limit("deuflhard", UNLIMITED, f"{HLW}, XIII.1: exact where the force is linear"),
    Limit("scheme-i", 2 / 3, _SCHEME_I, {"lam": "-1"}),
    Limit("scheme-i", 6.0, _SCHEME_I, {"lam": "1/3"}),
    Limit("scheme-i", UNLIMITED, _SCHEME_I, {"lam": "1/2"}),
)
