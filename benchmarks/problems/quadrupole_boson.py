r"""The quadrupole boson Hamiltonian: quadrupole vibrations of the nuclear surface, Henon-Heiles with a quartic term.

.. math::
    H = \tfrac A2 (p_0^2 + p_2^2 + q_0^2 + q_2^2) + \tfrac B{\sqrt2} q_0 (3 q_2^2 - q_0^2) + \tfrac D4 (q_0^2 + q_2^2)^2

It has the symmetry of an equilateral triangle; the motion along q2 = 0 is an oscillator of one degree of freedom.
"benchmark" is the start of the SciML benchmarks, at rest with H = 120.  "h20" has the four numbers of the default start
of DynamicalSystems.jl, taken as (q0, q2, p0, p2), which gives H = 20 (that package takes them as (p0, p2, q0, q2)).
"""

import sympy as sp

from phasebench.integrators.systems.hamiltonian import Hamiltonian

from .base import Orbit, Pace, Problem, decades

PARAMETERS = {"A": 1.0, "B": 0.55, "D": 0.4}


def make(A: float, B: float, D: float) -> Problem:
    """Make the quadrupole boson problem with the strengths ``A``, ``B``, ``D`` of linear, quadratic, cubic forces."""
    q0, q2, p0, p2 = sp.symbols("q0 q2 p0 p2", real=True)
    a, b, d = (sp.Rational(x) for x in (A, B, D))
    H = (
        a * (p0**2 + p2**2 + q0**2 + q2**2) / 2
        + b / sp.sqrt(2) * q0 * (3 * q2**2 - q0**2)
        + d * (q0**2 + q2**2) ** 2 / 4
    )
    return Problem(
        id="quadrupole-boson",
        name="quadrupole boson Hamiltonian",
        source="Eisenberg & Greiner, Nuclear Theory (1975); Baran & Raduta 1998, Int. J. Mod. Phys. E 7, 527-551; "
        "Micluta-Campeanu, Raportaru, Nicolin & Baran 2018, Rom. Rep. Phys. 70, 105; data: Micluta-Campeanu & "
        "Rackauckas, SciMLBenchmarks.jl; Datseris, DynamicalSystems.jl",
        cite=("baran-raduta1998",),
        system=Hamiltonian(q=[q0, q2], p=[p0, p2], H=H),
        orbits=(
            Orbit(
                "benchmark",
                (4.919080920016389, 2.836942666663649),
                (0.0, 0.0),
                "at rest, H = 120 at the defaults",
                decades(100.0),
            ),
            Orbit(
                "h20",
                (0.0, -2.5830294658973876),
                (1.3873470962626937, -4.743416490252585),
                "H = 20 at the defaults",
                (0.1, 1.0, 10.0, 60.0),
            ),
        ),
        pace=Pace(step=0.03, span=0.5, later=0.2),
    )
