"""On what a step is certified: small nonlinear systems, half of them not H = T(p) + V(q), at seeded states.

A step that is right on one kind of system alone, or at one state alone, is not to pass: d is 1 and 2, the kinetic
energy is not always |p|^2 / 2, and every component of a state is moved by a seeded amount.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cache

import numpy as np

from phasebench.benchmarks.measure.battery import coupled, tao
from phasebench.integrators.systems.hamiltonian import Hamiltonian

#: Where a seed moves a state to: by at most so much in every component.
MOVED = 0.02


@dataclass(frozen=True)
class Entry:
    """A system of the battery.

    Attributes
    ----------
    name : as certificates name it
    system, state : the system, and about where its orbit starts, 2 d numbers
    reversible : whether H(q, -p) = H(q, p)
    invariant : an expression that is conserved besides H, as text, or ""
    kind : of that invariant, in words
    lasting : whether long runs are made on it
    """

    name: str
    system: Hamiltonian
    state: tuple[float, ...]
    reversible: bool = True
    invariant: str = ""
    kind: str = ""
    lasting: bool = False

    def start(self, seed: int) -> np.ndarray:
        """The state for a seed, doubles (2 d,)."""
        draws = np.random.default_rng([seed, *self.name.encode()]).uniform(-1, 1, len(self.state))
        return np.array(self.state) + MOVED * draws


def _two(H: str, **more) -> Hamiltonian:
    return Hamiltonian(q="q1 q2", p="p1 p2", H=H, **more)


def _one(H: str) -> Hamiltonian:
    return Hamiltonian(q="q", p="p", H=H)


HENON_HEILES = "(p1**2 + p2**2)/2 + (q1**2 + q2**2)/2 + q1**2*q2 - q2**3/3"
CENTRAL = "(p1**2 + p2**2)/2 - 1/sqrt(q1**2 + q2**2)"
#: Two sites of the discrete nonlinear Schroedinger equation: J. C. Eilbeck, P. S. Lomdahl, A. C. Scott (1985).
DIMER = "(q1**2 + p1**2)**2/4 + (q2**2 + p2**2)**2/4 + q1*q2 + p1*p2"


@cache
def entries() -> tuple[Entry, ...]:
    """The systems on which structure and order are measured."""
    return (
        Entry("pendulum", _one("p**2/2 - cos(q)"), (0.9, 0.8)),
        Entry("henon-heiles", _two(HENON_HEILES), (0.1, -0.2, 0.3, 0.15), lasting=True),
        Entry("quartic", _one("p**2/2 + p**4/8 + q**2/2 + q**3/6"), (0.6, 0.5)),
        Entry("tao", tao(), (0.3, -0.7)),
        Entry("coupled", coupled(), (0.4, -0.6, 0.5, 0.3), reversible=False),
    )


@cache
def lasting() -> tuple[Entry, ...]:
    """The systems of the long runs."""
    central = Entry("kepler", _two(CENTRAL), (0.9, 0.1, -0.1, 1.1), True, "q1*p2 - q2*p1", "bilinear", True)
    mass = "q1**2 + p1**2 + q2**2 + p2**2"
    dimer = Entry("dimer", _two(DIMER), (0.5, 0.2, -0.3, 0.6), True, mass, "quadratic", True)
    return (*(e for e in entries() if e.lasting), central, dimer)


@cache
def oscillator() -> Entry:
    """The harmonic oscillator of frequency 1."""
    return Entry("harmonic-oscillator", _one("p**2/2 + q**2/2"), (0.8, 0.3))


def known(name: str) -> Entry:
    """The system of that name."""
    return next(e for e in (*entries(), *lasting(), oscillator()) if e.name == name)


#: The time over which an order is measured, and into how many steps it is divided.
SPAN = Fraction(1, 4)
LADDER = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64)
