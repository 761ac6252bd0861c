"""Known stability limits of h omega on the harmonic oscillator, with the evidence for each.

``derived``: the limit follows in closed form from the trace and the determinant of the step's matrix; the tests derive
each one again, exactly, from the method's coefficients as its authors give them, not from this project's records.
``printed``: a publication or software that states the limit, and was looked up.  A measured limit must agree in
``digits`` significant digits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np

    from phasebench.benchmarks.measure.own_step import System

#: The limit of a method that is stable at every step.
UNLIMITED = math.inf
EXACT = 10

#: Sources that state a limit.
KOBAYASHI = "Kobayashi 2007, Phys. Lett. A 371, 360 (arXiv:0705.4523): q and p grow for steps from 2 on"
NODEPY = "Ketcheson et al. 2020, JOSS 5, 2515: NodePy prints 2.8284271247"
GAUSS = "documentation of the Rust package differential-equations 0.3: Gauss-Legendre methods are A-stable"
RADAU = "documentation of OrdinaryDiffEq.jl: RadauIIA3 and RadauIIA5 are A-, B- and L-stable"
IMEX = "McLachlan & Stern 2014 (arXiv:1305.3216): the midpoint rule for the fast, linear part, free of resonances"


@dataclass(frozen=True)
class Limit:
    """A known stability limit of h omega.

    Attributes
    ----------
    method : a method's id, or a key of `STEPS`, step functions of further methods
    value : the limit, or `UNLIMITED`
    derived : the formula of the step's matrix from which the limit follows; empty if it is not derived
    printed : the source that states the limit; empty if none was found
    parameters : the method's parameters, name -> value
    digits : significant digits in which a measured limit must agree
    """

    method: str
    value: float
    derived: str = ""
    printed: str = ""
    parameters: dict[str, str] = field(default_factory=dict)
    digits: int = EXACT

    @property
    def evidence(self) -> str:
        """How the limit is known: "derived", "printed", or both."""
        return " and ".join(name for name in ("derived", "printed") if getattr(self, name))


def _runge_kutta(rows: Sequence[Sequence[float]], weights: Sequence[float]) -> Callable:
    """Make the step of an explicit Runge-Kutta method, a function (system, q, p, h) -> (q, p).

    ``rows`` are those of the method's matrix, each as far as the diagonal, ``weights`` its weights.
    """

    def step(system: System, q: np.ndarray, p: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray]:
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
_OMELYAN = (2 * math.sqrt(326) + 36) ** (1 / 3)
#: The fraction of McLachlan's symmetric two-stage method, 0.1931833275.
MCLACHLAN = 1 / 2 - _OMELYAN / 12 + 1 / (6 * _OMELYAN)
_VERLET = "tr = 2 - z^2"
_SCHEME_I = "tr = 2 - z^2 / (1 + lam (1 - lam) z^2), so z |1 - 2 lam| = 2"
_MIDPOINT = "tr = 2 (4 - z^2) / (4 + z^2), det = 1"
_PADE = "R(i z) is a Pade approximation"

LIMITS = (
    Limit("symplectic-euler-p", 2.0, _VERLET, KOBAYASHI),
    Limit("symplectic-euler-q", 2.0, _VERLET, KOBAYASHI),
    Limit("stormer-verlet", 2.0, _VERLET, KOBAYASHI),
    Limit("stormer-verlet-dkd", 2.0, _VERLET, KOBAYASHI),
    Limit("lobatto-iiia-iiib-2", 2.0, f"{_VERLET}: Stormer-Verlet"),
    Limit("lobatto-iiia-iiib-3", math.sqrt(8), "tr = 2 (48 - 22 z^2 + z^4) / (48 + 2 z^2)"),
    Limit("variational-trapezoidal", 2.0, f"{_VERLET}: Stormer-Verlet"),
    Limit("explicit-euler", 0.0, "det = 1 + z^2"),
    Limit("heun-2", 0.0, "det = 1 + z^4 / 4"),
    Limit("kutta-3", math.sqrt(3), "det = 1 - z^4 / 12 + z^6 / 36"),
    Limit("rk4", math.sqrt(8), "det = 1 - z^6 / 72 + z^8 / 576", NODEPY),
    Limit("mclachlan-s2", math.sqrt(2 / (1 / 2 - MCLACHLAN)), "two stages of fraction b: z^2 = 2 / (1/2 - b)"),
    Limit("saba-2", 2 * 3**0.25, "two stages of fraction b = 1/2 - 3^(1/2) / 6: z^2 = 2 / (1/2 - b)"),
    Limit("mclachlan-atela-2", 2.2644837646238005, "the first root of tr = -2, of degree 4"),
    Limit("ruth-3", 2.5074811709523557, "the first root of |tr| = 2, of degree 6"),
    Limit("forest-ruth", (2 - _CUBE) * math.sqrt(2 * (1 + _CUBE)), "z = (2 - 2^(1/3)) (2 + 2^(4/3))^(1/2)"),
    Limit("implicit-euler", UNLIMITED, "det = 1 / (1 + z^2)"),
    Limit("implicit-midpoint", UNLIMITED, _MIDPOINT),
    Limit("gauss-2", UNLIMITED, f"{_PADE} of modulus 1", GAUSS),
    Limit("gauss-4", UNLIMITED, f"{_PADE} of modulus 1", GAUSS),
    Limit("radau-iia-3", UNLIMITED, f"{_PADE} of modulus below 1", RADAU),
    Limit("imex", UNLIMITED, f"{_MIDPOINT}: the midpoint rule", IMEX),
    Limit("avf", UNLIMITED, f"{_MIDPOINT}: the midpoint rule"),
    Limit("deuflhard", UNLIMITED, "tr = 2 cos z: exact"),
    Limit("scheme-i", 2 / 3, _SCHEME_I, parameters={"lam": "-1"}),
    Limit("scheme-i", 6.0, _SCHEME_I, parameters={"lam": "1/3"}),
    Limit("scheme-i", UNLIMITED, _SCHEME_I, parameters={"lam": "1/2"}),
    Limit("scheme-iii", 1.0, "two substeps of Scheme I and its adjoint", parameters={"lam": "-1"}),
    Limit("scheme-iii", 3.0, "two substeps of Scheme I and its adjoint", parameters={"lam": "1/3"}),
)
