"""The systems on which a step is certified: small, nonlinear, not all of the form H = T(p) + V(q), at random states.

A step that is right on one kind of system only, or at one state only, must not pass: d is 1, 2, 3, 4 and 6, the kinetic
energy is not always |p|^2 / 2, and a seed moves every component of a state.  Steps with special requirements have
systems of their own (`BY_TRAIT`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np

from phasebench.benchmarks.measure.battery import PARTS, RIGID, SYSTEMS, coupled_double_well, tao
from phasebench.benchmarks.problems.base import Problem
from phasebench.integrators.systems.hamiltonian import Hamiltonian, PartitionedSystem

#: The most by which a seed moves a component of a state.
MOVED = 0.02
#: In a user's own problem, a component of 0 is moved by up to this share of the largest.
NUDGED = 1e-3


@dataclass(frozen=True)
class Entry:
    """A test system with a state to start from and its units.

    Attributes
    ----------
    name : its name in certificates
    system, state : the system, and its initial state before a seed moves it, 2 d numbers
    reversible : whether H(q, -p) = H(q, p)
    invariant, kind : an expression that is conserved besides H, or "", and its kind, "bilinear" or "quadratic"
    lasting : whether long runs are made on it
    unit : the unit of time, a power of two; steps are fractions of it
    size : the typical sizes of q and of p, by which errors and structural defects are divided
    share : if True, a seed moves each component by a share of itself, as in a user's own problem; else by up to `MOVED`
    """

    name: str
    system: Hamiltonian
    state: tuple[float, ...]
    reversible: bool = True
    invariant: str = ""
    kind: str = ""
    lasting: bool = False
    unit: float = 1.0
    size: tuple[float, float] = (1.0, 1.0)
    share: bool = False

    def start(self, seed: int) -> np.ndarray:
        """The initial state, displaced at random by a seed; doubles (2 d,)."""
        draws = np.random.default_rng([seed, *self.name.encode()]).uniform(-1, 1, len(self.state))
        state = np.array(self.state)
        if self.share:
            return self.on_manifold(state + draws * np.where(state == 0, NUDGED * self.sizes, MOVED * state))
        return state + MOVED * draws

    def on_manifold(self, state: np.ndarray) -> np.ndarray:
        """Move a state, array (2 d,), onto the manifold of the system's constraints; leave it if there are none."""
        d, system = len(state) // 2, self.system
        return np.concatenate(system.retract(state[:d], state[d:])) if system.constrained else state

    @property
    def sizes(self) -> np.ndarray:
        """The typical size of each component of a state, array (2 d,): the size of q d times over, then that of p."""
        return np.repeat(self.size, len(self.state) // 2)


def _two(H: str, **more: Any) -> Hamiltonian:
    return Hamiltonian(q="q1 q2", p="p1 p2", H=H, **more)


def _one(H: str) -> Hamiltonian:
    return Hamiltonian(q="q", p="p", H=H)


HENON_HEILES = "(p1**2 + p2**2)/2 + (q1**2 + q2**2)/2 + q1**2*q2 - q2**3/3"
CENTRAL = "(p1**2 + p2**2)/2 - 1/sqrt(q1**2 + q2**2)"
#: Two sites of the discrete nonlinear Schroedinger equation: J. C. Eilbeck, P. S. Lomdahl, A. C. Scott (1985).
DIMER = "(q1**2 + p1**2)**2/4 + (q2**2 + p2**2)**2/4 + q1*q2 + p1*p2"


def ring(d: int) -> Hamiltonian:
    """A ring of d particles in wells of different widths, each bound to its neighbours: H = T(p) + V(q)."""
    q, p = ([f"{x}{i + 1}" for i in range(d)] for x in "qp")
    wells = " + ".join(f"{p[i]}**2/2 + {i + 4}*{q[i]}**2/16" for i in range(d))
    springs = " + ".join(f"({q[i]} - {q[i - 1]})**3/24 + ({q[i]} - {q[i - 1]})**4/32" for i in range(d))
    return Hamiltonian(q=" ".join(q), p=" ".join(p), H=f"{wells} + {springs}")


@cache
def entries() -> tuple[Entry, ...]:
    """The systems on which structure and order are measured, for steps without special requirements."""
    return (
        Entry("pendulum", _one("p**2/2 - cos(q)"), (0.9, 0.8)),
        Entry("henon-heiles", _two(HENON_HEILES), (0.1, -0.2, 0.3, 0.15), lasting=True),
        Entry("quartic", _one("p**2/2 + p**4/8 + q**2/2 + q**3/6"), (0.6, 0.5)),
        Entry("tao", tao(), (0.3, -0.7)),
        Entry("coupled", coupled_double_well(), (0.4, -0.6, 0.5, 0.3), reversible=False),
        Entry("lattice", ring(4), (0.3, -0.4, 0.2, 0.5, -0.3, 0.4, 0.6, -0.2)),
        Entry("triangle", ring(3), (-0.3, 0.5, 0.4, 0.6, -0.2, 0.3)),
        Entry("ring", ring(6), (0.2, -0.5, 0.4, 0.3, -0.2, 0.6, 0.5, 0.3, -0.4, 0.2, 0.6, -0.3)),
    )


@cache
def lasting() -> tuple[Entry, ...]:
    """The systems of the battery on which long runs are made, to measure the conservation of invariants."""
    central = Entry("kepler", _two(CENTRAL), (0.9, 0.1, -0.1, 1.1), True, "q1*p2 - q2*p1", "bilinear", True)
    mass = "q1**2 + p1**2 + q2**2 + p2**2"
    dimer = Entry("dimer", _two(DIMER), (0.5, 0.2, -0.3, 0.6), True, mass, "quadratic", True)
    return (*(e for e in entries() if e.lasting), central, dimer)


@cache
def magnetic() -> tuple[Entry, ...]:
    """The test systems for steps that require a charged particle, in magnetic fields and confining potentials."""
    plane = "((p1 + q2*(1 + q1**2)/2)**2 + (p2 - q1*(1 + q2**2)/3)**2)/2 + q1**2/2 + q1*q2**2/3 + q2**4/4"
    tilted = "(px + y*(1 + z**2)/2)**2 + (py - x*(1 + z**2)/2 - z**2/4)**2 + (pz - x*y/3)**2"
    heavy = f"({tilted})/4 + x**2*y/4 - y*z/3 + (x**2 + y**2 + z**2)**2/8"
    mirror = "((px + y*(1 + z**2/4)/2)**2 + (py - x*(1 + z**2/4)/2)**2 + pz**2)/2 + (x**2 + y**2)**2/16 + z**4/8"
    heavy, mirror = (Hamiltonian(q="x y z", p="px py pz", H=H) for H in (heavy, mirror))
    around = "x*py - y*px", "bilinear"
    return (
        Entry("planar particle", _two(plane), (0.4, -0.6, 0.5, 0.3), False, lasting=True),
        Entry("heavy particle", heavy, (0.3, -0.5, 0.4, 0.4, 0.6, -0.3), False),
        Entry("particle in a mirror", mirror, (0.5, 0.2, -0.3, 0.3, 0.4, 0.5), False, *around, True),
    )


@cache
def constrained() -> tuple[Entry, ...]:
    """The test systems for steps that require a system with holonomic constraints."""
    states = {
        "on-sphere": (0.8, 0.36, 0.48, 0.3, 0.7, -0.5),
        "rods": (0.28, -0.96, 0.88, -1.76, 0.1, 0.2, -0.3, 0.1),
        "on-ellipsoid": (0.6, 0.4, 0.3, 0.3, 0.5, -0.75),
    }
    systems = {name: SYSTEMS[name]()[0] for name in states}
    return tuple(Entry(n, systems[n], y, n != "on-ellipsoid", lasting=True, share=True) for n, y in states.items())


@cache
def rigid() -> tuple[Entry, ...]:
    """The test systems for steps that require a rigid body."""
    found = {name: SYSTEMS[name]() for name in RIGID}
    return tuple(Entry(name, body, (*q, *p), lasting=True, share=True) for name, (body, q, p) in found.items())


@cache
def parts() -> tuple[Entry, ...]:
    """The test systems for steps that require H to be a sum of parts whose flows are known exactly."""
    found = {name: SYSTEMS[name]() for name in PARTS}
    return tuple(
        Entry(name, system, (*q, *p), name == "geodesic", lasting=True, share=True)
        for name, (system, q, p) in found.items()
    )


#: Trait -> the systems on which everything is measured of a step that requires it.
BY_TRAIT = {"magnetic": magnetic, "constrained": constrained, "rigid body": rigid, "parts": parts}


@cache
def oscillator() -> Entry:
    """The harmonic oscillator of frequency 1, as an entry of the battery."""
    return Entry("harmonic-oscillator", _one("p**2/2 + q**2/2"), (0.8, 0.3))


def find_entry(name: str) -> Entry:
    """The system (`Entry`) of the battery with this name."""
    special = (e for of in BY_TRAIT.values() for e in of())
    return next(e for e in (*entries(), *lasting(), *special, oscillator()) if e.name == name)


def of_problem(problem: Problem) -> Entry:
    """Make an entry of a user's own problem; it starts from the chosen orbit, and long runs are made on it."""
    system = problem.system
    state = np.array([*problem.q0, *problem.p0], dtype=float)
    d = system.d
    size = tuple(float(np.abs(x).max()) or 1.0 for x in (state[:d], state[d:]))
    entry = Entry(problem.label, system, tuple(map(float, state)), False, lasting=True, size=size, share=True)
    # A start at rest would tell nothing: H is compared at other momenta, too.
    draws = np.random.default_rng(0).uniform(-1.0, 1.0, (3, d)) * size[1]
    looked = [state, *(state + np.concatenate([np.zeros(d), moved]) for moved in draws)]
    pairs = [(_energy(system, y * np.repeat([1, -1], d)), _energy(system, y)) for y in looked]
    reversible = all(abs(a - b) < 1e-13 * max(abs(b), 1e-300) for a, b in pairs if np.isfinite(b))
    return replace(entry, reversible=reversible, unit=time_unit(system, entry.start(0), entry.sizes))


def _energy(system: PartitionedSystem, state: np.ndarray) -> float:
    d = system.d
    return float(system.observe(system.H, state[None, :d], state[None, d:])[0])


def time_unit(system: PartitionedSystem, state: np.ndarray, sizes: np.ndarray) -> float:
    """A unit of time, a power of two, in which no component of the state moves by more than its size.

    Nor does any linear mode at the state advance by more than a radian: the modes' rates are the moduli of the
    eigenvalues of the vector field's Jacobian.  ``state`` and ``sizes`` are arrays (2 d,).
    """
    field = system.vector_field()
    columns = []
    for i, size in enumerate(sizes):
        step = np.zeros(len(state))
        step[i] = 1e-6 * size
        columns.append((field(0.0, state + step) - field(0.0, state - step)) / 2e-6 / sizes)
    rates = np.abs(np.linalg.eigvals(np.array(columns).T)).max(), np.abs(field(0.0, state) / sizes).max()
    fastest = max(rates)
    return 2.0 ** np.floor(-np.log2(fastest)) if np.isfinite(fastest) and fastest > 0 else 1.0


#: The time over which an order is measured, in the entry's unit, and the numbers of steps into which it is divided.
SPAN = Fraction(1, 4)
LADDER = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64)
