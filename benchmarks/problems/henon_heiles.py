"""The Henon-Heiles problem, H = |p|^2 / 2 + (q1^2 + q2^2 + 2 q1^2 q2 - 2 q2^3 / 3) / 2."""

import sympy as sp

from phasebench.integrators.systems.hamiltonian import Hamiltonian

from .base import DRIFT, ORDER, Orbit, Problem, Scene, decades, halvings

PARAMETERS: dict[str, float] = {}
#: The steps of the talk (see ``source``) over its time span, t = 1000.
LONG = (0.05, 0.02, 0.01, 0.005)
SCENES = (
    Scene("henon-heiles-chaotic-t1", "henon-heiles:chaotic", ORDER, 1.0, halvings(0.02, 5)),
    Scene("henon-heiles-box-t1", "henon-heiles:box", ORDER, 1.0, halvings(0.02, 5)),
    Scene("henon-heiles-box-t1000", "henon-heiles:box", DRIFT, 1000.0, LONG),
    Scene("henon-heiles-chaotic-t1000", "henon-heiles:chaotic", DRIFT, 1000.0, LONG, regular=False),
)


def _orbit(name: str, H0: float, q2: float, times: tuple[float, ...]) -> Orbit:
    """The orbit from q = (0, q2), p = (p1, 0), p1 > 0 such that H = H0, rounded to double."""
    p1 = (2 * H0 - q2**2 + 2 * q2**3 / 3) ** 0.5
    return Orbit(name, (0.0, q2), (p1, 0.0), f"{name} orbit, H0 = {H0:.6g}", times)


def make() -> Problem:
    """Make the Henon-Heiles problem, with a chaotic and a box orbit (cited in its ``source``)."""
    q1, q2, p1, p2 = sp.symbols("q1 q2 p1 p2", real=True)
    U = (q1**2 + q2**2 + 2 * q1**2 * q2 - sp.Rational(2, 3) * q2**3) / 2
    return Problem(
        id="henon-heiles",
        name="Henon-Heiles",
        source="Henon & Heiles 1964, Astron. J. 69, 73-79; Wang, Bo & Cai (talk), (27)-(28)",
        cite=("henon-heiles1964", "wang-talk"),
        system=Hamiltonian(q=[q1, q2], p=[p1, p2], H=(p1**2 + p2**2) / 2 + U, frequencies=[1, 1]),
        orbits=(
            _orbit("chaotic", 1 / 6, 0.82, (1.0, 10.0, 100.0, 300.0)),
            _orbit("box", 0.02, -0.082, decades(1000.0)),
        ),
    )
