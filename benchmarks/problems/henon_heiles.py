"""The Henon-Heiles problem, H = |p|^2 / 2 + (q1^2 + q2^2 + 2 q1^2 q2 - 2 q2^3 / 3) / 2."""

import sympy as sp

from phasebench.integrators.systems.hamiltonian import Hamiltonian

from .base import Orbit, Problem

PARAMETERS: dict[str, float] = {}


def _orbit(name: str, H0: float, q2: float) -> Orbit:
    """q = (0, q2), p = (p1, 0) with p1 > 0 from H0, rounded to double."""
    return Orbit(name, (0.0, q2), ((2 * H0 - q2**2 + 2 * q2**3 / 3) ** 0.5, 0.0), f"{name} orbit, H0 = {H0:.6g}")


def make() -> Problem:
    """The problem with the two orbits of the talk."""
    q1, q2, p1, p2 = sp.symbols("q1 q2 p1 p2", real=True)
    U = (q1**2 + q2**2 + 2 * q1**2 * q2 - sp.Rational(2, 3) * q2**3) / 2
    return Problem(
        id="henon-heiles",
        name="Henon-Heiles",
        source="Henon & Heiles 1964, Astron. J. 69, 73-79; Wang, Bo & Cai (talk), (27)-(28)",
        cite=("henon-heiles1964", "wang-talk"),
        system=Hamiltonian(q=[q1, q2], p=[p1, p2], H=(p1**2 + p2**2) / 2 + U, frequencies=[1, 1]),
        orbits=(_orbit("chaotic", 1 / 6, 0.82), _orbit("box", 0.02, -0.082)),
    )
