r"""OpenMM's integrators as peers, on its Reference platform in double precision: Verlet, variable and custom Verlet.

Coordinate i is the x of particle i, of the mass in :math:`H = \sum p_i^2 / 2 m_i + V(q)`; V is the energy of a single
`CustomCompoundBondForce` over all particles, which OpenMM differentiates and compiles.  Its units, kJ/mol = amu
nm^2 / ps^2, need no factors.

VerletIntegrator and VariableVerletIntegrator keep velocities half a step behind the positions, as their documentation
says: half a kick moves the initial velocity back to -h / 2, and that of a row forward.  VariableVerletIntegrator itself
takes its first half kick; its last step ends at a row, and half of that step's kick is added.

`CustomIntegrator` is given the velocity Verlet algorithm that its documentation lists, without constraints.

Source: P. Eastman et al., J. Phys. Chem. B 128 (2024) 109-116; OpenMM User Guide, Theory, Integrators.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from . import masses
from .record import NOT_FINITE, Claims, Peer, Run, Task

if TYPE_CHECKING:
    from phasebench.integrators.systems.hamiltonian import Hamiltonian

THEORY = "https://docs.openmm.org/latest/userguide/theory/04_integrators.html"
VERLET, VARIABLE, CUSTOM = "VerletIntegrator", "VariableVerletIntegrator", "CustomIntegrator"
#: errorTol where no tolerance is given.
TOLERANCE = 1e-6


@lru_cache(maxsize=128)
def _formula(system: Hamiltonian) -> str:
    """The potential as OpenMM writes formulas: particle i's coordinate is x<i+1>."""
    import sympy as sp

    renamed = {q: sp.Symbol(f"x{i + 1}") for i, q in enumerate(system.q)}
    return str(sp.N(system.potential.xreplace(renamed), 17)).replace("**", "^").replace("Abs(", "abs(")


def _integrator(kind: str, h: float, tol: float | None) -> Any:
    """Make OpenMM's integrator of a ``kind``: `VERLET` or `CUSTOM` with step h, `VARIABLE` with tolerance ``tol``."""
    import openmm

    if kind == VERLET:
        return openmm.VerletIntegrator(h)
    if kind == VARIABLE:
        return openmm.VariableVerletIntegrator(tol)
    made = openmm.CustomIntegrator(h)
    made.addUpdateContextState()
    made.addComputePerDof("v", "v+0.5*dt*f/m")
    made.addComputePerDof("x", "x+dt*v")
    made.addComputePerDof("v", "v+0.5*dt*f/m")
    return made


class _Simulation:
    """A system in OpenMM with an integrator; states are (q, p), arrays (2 d,)."""

    def __init__(self, system: Hamiltonian, kind: str, h: float, tol: float | None = None) -> None:
        import openmm

        self.kind, self.d, self.h = kind, system.d, h
        self.masses = masses.masses(system)
        made, force = openmm.System(), openmm.CustomCompoundBondForce(system.d, _formula(system))
        for mass in self.masses:
            made.addParticle(float(mass))
        force.addBond(list(range(system.d)), [])
        made.addForce(force)
        self.integrator = _integrator(kind, h, tol)
        self.context = openmm.Context(made, self.integrator, openmm.Platform.getPlatformByName("Reference"))

    def _kick(self, h: float) -> np.ndarray:
        """The change of the velocities by the present forces in the time h, array (d,)."""
        forces = self.context.getState(forces=True).getForces(asNumpy=True)._value[:, 0]
        return h * forces / self.masses

    def start(self, y: np.ndarray) -> None:
        """Set the state y = (q, p), array (2 d,)."""
        self.context.setPositions(masses.on_lines(y[: self.d]))
        v = y[self.d :] / self.masses
        self.context.setVelocities(masses.on_lines(v - self._kick(self.h / 2) if self.kind == VERLET else v))

    def state(self) -> np.ndarray:
        """The state (q, p) reached, array (2 d,)."""
        found = self.context.getState(positions=True, velocities=True)
        q, v = (x._value[:, 0] for x in (found.getPositions(asNumpy=True), found.getVelocities(asNumpy=True)))
        if self.kind == VERLET:
            v = v + self._kick(self.h / 2)
        elif self.kind == VARIABLE:
            v = v + self._kick(self.integrator.getStepSize()._value / 2)
        return np.concatenate([q, self.masses * v])


def _build_run(kind: str) -> Callable[[Task], Run]:
    adaptive = kind == VARIABLE

    def run(task: Task) -> Run:
        import openmm

        made = _Simulation(task.system, kind, task.h, task.tol or TOLERANCE)
        made.start(task.state)
        rows, seconds, failure, steps = [task.state], 0.0, None, 0
        for row, (before, number) in enumerate(pairwise(task.numbers), start=1):
            started = time.perf_counter()
            try:
                if adaptive:
                    made.integrator.stepTo(task.times[row])
                else:
                    made.integrator.step(number - before)
                    steps = number
            except openmm.OpenMMException as error:
                failure = NOT_FINITE if "NaN" in str(error) else str(error)
            seconds += time.perf_counter() - started
            y = made.state()
            if failure or not np.isfinite(y).all():
                failure = failure or NOT_FINITE
                break
            rows.append(y)
        return Run.of_states(np.array(rows), steps, steps, seconds, failure)

    return run


def _peer(id: str, kind: str, title: str, order: int | None, about: str, source: str, claims: Claims) -> Peer:
    return Peer(
        f"openmm-{id}",
        f"OpenMM's {title}",
        package="openmm",
        adaptive=kind == VARIABLE,
        order=order,
        license="MIT",
        about=f"{about}; the Reference platform in double precision, V is compiled by OpenMM",
        source=source,
        run=_build_run(kind),
        scope=masses.SCOPE,
        lacks=masses.lacks,
        claims=claims,
        tol=TOLERANCE if kind == VARIABLE else None,
        ahead=True,
    )


LEAPFROG = "Verlet 1967, Phys. Rev. 159, 98-103"

PEERS: tuple[Peer, ...] = (
    _peer(
        "verlet",
        VERLET,
        "VerletIntegrator",
        2,
        "leapfrog; the velocities of starts and rows are moved by half a kick",
        LEAPFROG,
        Claims(symplectic=True, source=f'"Unlike a fixed step size Verlet integrator ... not symplectic", {THEORY}'),
    ),
    _peer(
        "variable-verlet-adaptive",
        VARIABLE,
        "VariableVerletIntegrator, adaptive",
        None,
        "tol is errorTol, an estimate of a step's error in nm",
        LEAPFROG,
        Claims(symplectic=False, energy=None, source=f'"variable step size Verlet is not symplectic", {THEORY}'),
    ),
    _peer(
        "custom-velocity-verlet",
        CUSTOM,
        "CustomIntegrator with velocity Verlet",
        2,
        "the algorithm of the documentation of CustomIntegrator, without constraints",
        LEAPFROG,
        Claims(source="openmm.CustomIntegrator.__doc__: a velocity Verlet integrator"),
    ),
)
