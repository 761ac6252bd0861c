"""Scripts on OpenMM."""

import numpy as np
import openmm


def openmm_variable_verlet():
    """The energy drift of variable Verlet over 1000 Kepler orbits of e = 0.6, beside that of Verlet.

    Verlet has as many equal steps an orbit.  The drift is the difference between the means over the last and over the
    first hundred orbits, relative to the energy.
    """
    system, force = openmm.System(), openmm.CustomCompoundBondForce(2, "-1/sqrt(x1^2+x2^2)")
    for _ in range(2):
        system.addParticle(1.0)
    force.addBond([0, 1], [])
    system.addForce(force)

    def drift(integrator, given=0):
        steps = given
        context, energies = openmm.Context(system, integrator, openmm.Platform.getPlatformByName("Reference")), []
        context.setPositions([[0.4, 0, 0], [0, 0, 0]])
        context.setVelocities([[integrator.getStepSize()._value / 2 / 0.16 if given else 0, 0, 0], [2, 0, 0]])
        while not given and context.getTime()._value < 2 * np.pi:
            integrator.step(1)
            steps += 1
        for _ in range(1000):
            integrator.step(steps)
            s = context.getState(positions=True, velocities=True, forces=True)
            x, v, f = (a(asNumpy=True)._value[:, 0] for a in (s.getPositions, s.getVelocities, s.getForces))
            energies.append(((v + integrator.getStepSize()._value / 2 * f) ** 2).sum() / 2 - 1 / np.hypot(*x))
        return steps, abs(np.mean(energies[-100:]) - np.mean(energies[:100])) / 0.5

    steps, variable = drift(openmm.VariableVerletIntegrator(1e-4))
    yield "drift with steps of its own", f"{variable:.1e}"
    equal = drift(openmm.VerletIntegrator(2 * np.pi / steps), steps)[1]
    yield f"drift with {steps} equal steps an orbit", f"{equal:.1e}"
