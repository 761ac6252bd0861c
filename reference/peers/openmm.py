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

from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from phasebench.reference.files import entries

from .forms import ON_LINES, masses, on_lines
from .record import NOT_FINITE, Claims, Peer, Run, Task
from .run import by_rows

if TYPE_CHECKING:
    from phasebench.integrators.systems.hamiltonian import Hamiltonian

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
        self.masses = masses(system)
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
        self.context.setPositions(on_lines(y[: self.d]))
        v = y[self.d :] / self.masses
        self.context.setVelocities(on_lines(v - self._kick(self.h / 2) if self.kind == VERLET else v))

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
    def run(task: Task) -> Run:
        import openmm

        made = _Simulation(task.system, kind, task.h, task.tol)
        made.start(task.state)

        def advance(i: int, n: int) -> str | None:
            try:
                if kind == VARIABLE:
                    made.integrator.stepTo(task.times[i])
                else:
                    made.integrator.step(n)
            except openmm.OpenMMException as error:
                return NOT_FINITE if "NaN" in str(error) else str(error)
            return None

        found = by_rows(task, advance, made.state, 1)
        return found._replace(steps=0, gradient=0) if kind == VARIABLE else found

    return run


def _peer(id: str, kind: str, title: str, about: str, claims: dict[str, Any], **facts: Any) -> Peer:
    return Peer(
        f"openmm-{id}",
        f"OpenMM's {title}",
        package="openmm",
        adaptive=kind == VARIABLE,
        license="MIT",
        about=f"{about}; the Reference platform in double precision, V is compiled by OpenMM",
        run=_build_run(kind),
        claims=Claims(**claims),
        tol=TOLERANCE if kind == VARIABLE else None,
        ahead=True,
        **ON_LINES,
        **facts,
    )


PEERS: tuple[Peer, ...] = tuple(_peer(**entry) for entry in entries(__file__))
