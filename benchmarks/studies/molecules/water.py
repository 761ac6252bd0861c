r"""A rigid water molecule that turns freely: constraints, kinetic energy and angular momentum over many steps.

Three distances are constraints.  OpenMM recognizes water (SETTLE); ASE's FixBondLengths iterates (RATTLE); beside them
`rattle` of this suite.  Units: nm, ps, atomic masses.

Source: W. L. Jorgensen et al., J. Chem. Phys. 79 (1983) 926-935 (TIP3P's geometry); S. Miyamoto, P. A. Kollman, J.
Comput. Chem. 13 (1992) 952-962 (SETTLE).
"""

from __future__ import annotations

from itertools import combinations
from math import cos, radians, sin
from typing import Any

import numpy as np

from phasebench.benchmarks.store.cells import Unavailable
from phasebench.integrators.driver import integrate
from phasebench.reference.installed import how_to_install, is_installed

from .argon import BEST, OURS

TABLE = "molecules_water"
METHOD = "rattle"
ATOMS = (15.999, 1.008, 1.008)
MASSES = np.array(ATOMS)
BOND, ANGLE = 0.09572, radians(104.52)
#: Angular velocity about the molecule's axes (rad/ps).
TURN = (9.0, 14.0, 6.0)
H, STEPS, EVERY = 0.001, 20_000, 20
PAIRS = tuple(combinations(range(3), 2))
#: Tolerances at their best; the defaults are 1e-5 (OpenMM) and 1e-13 (ASE).
TIGHT, TIGHTEST = 1e-12, 1e-14


def start() -> tuple[np.ndarray, np.ndarray]:
    """Return positions and velocities of the atoms, arrays (3, 3), with the centre of mass at rest in the origin."""
    x = BOND * np.array([[0, 0, 0], [1, 0, 0], [cos(ANGLE), sin(ANGLE), 0]])
    x -= MASSES @ x / MASSES.sum()
    return x, np.cross(TURN, x)


def _ours() -> tuple[np.ndarray, np.ndarray]:
    from phasebench.integrators.systems.constrained import ConstrainedHamiltonian

    x, v = start()
    names = [f"{axis}{k}" for k in range(3) for axis in "xyz"]
    momenta = [f"p{n}" for n in names]
    kinetic = " + ".join(f"{momenta[3 * k + i]}**2/{2 * ATOMS[k]!r}" for k in range(3) for i in range(3))
    constraints = [
        " + ".join(f"({axis}{a} - {axis}{b})**2" for axis in "xyz") + f" - {float(((x[a] - x[b]) ** 2).sum())!r}"
        for a, b in PAIRS
    ]
    system = ConstrainedHamiltonian(q=" ".join(names), p=" ".join(momenta), H=kinetic, constraints=constraints)
    p = (MASSES[:, None] * v).ravel()
    s = integrate(system, METHOD, h=H, steps=STEPS, save_every=EVERY, q0=x.ravel(), p0=p)
    if s.status != "ok":
        raise RuntimeError(s.reason)
    return s.q.reshape(-1, 3, 3), s.p.reshape(-1, 3, 3) / MASSES[:, None]


def _openmm(best: bool) -> tuple[np.ndarray, np.ndarray]:
    import openmm

    x, v = start()
    made = openmm.System()
    for mass in MASSES:
        made.addParticle(mass)
    for a, b in PAIRS:
        made.addConstraint(a, b, float(np.linalg.norm(x[a] - x[b])))
    integrator = openmm.VerletIntegrator(H)
    if best:
        integrator.setConstraintTolerance(TIGHT)
    platform = (openmm.Platform.getPlatformByName("Reference"),) if best else ()
    context = openmm.Context(made, integrator, *platform)
    context.setPositions(x)
    context.setVelocities(v)
    rows = []
    for _ in range(STEPS // EVERY):
        integrator.step(EVERY)
        state = context.getState(positions=True, velocities=True)
        rows.append((state.getPositions(asNumpy=True)._value, state.getVelocities(asNumpy=True)._value))
    return tuple(map(np.array, zip(*rows, strict=True)))


def _ase(best: bool) -> tuple[np.ndarray, np.ndarray]:
    from ase import Atoms
    from ase.calculators.calculator import Calculator
    from ase.constraints import FixBondLengths
    from ase.md.verlet import VelocityVerlet

    class Free(Calculator):
        implemented_properties = ("energy", "forces")

        def calculate(self, atoms: Atoms | None = None, *more: Any) -> None:
            self.results = {"energy": 0.0, "forces": np.zeros((3, 3))}

    x, v = start()
    atoms = Atoms("OHH", positions=x, masses=MASSES)
    atoms.set_momenta(MASSES[:, None] * v)
    atoms.calc = Free()
    atoms.set_constraint(FixBondLengths([list(pair) for pair in PAIRS], **{"tolerance": TIGHTEST} if best else {}))
    dynamics, rows = VelocityVerlet(atoms, timestep=H, logfile=None), []
    for _ in range(STEPS // EVERY):
        dynamics.run(EVERY)
        rows.append((atoms.get_positions(), atoms.get_velocities()))
    return tuple(map(np.array, zip(*rows, strict=True)))


ENGINES = {"openmm": _openmm, "ase": _ase}


def measure(package: str, settings: str) -> dict:
    """The errors of a rigid water that turns freely by a package; raises Unavailable without the package."""
    if package != OURS and not is_installed(package):
        raise Unavailable(f"{package} is not installed; {how_to_install(package)}")
    return errors(*(_ours() if package == OURS else ENGINES[package](settings == BEST)))


def errors(x: np.ndarray, v: np.ndarray) -> dict[str, float]:
    """Return relative errors of distances, kinetic energy and angular momentum over a run of the water.

    ``x`` and ``v`` are positions and velocities, arrays (rows, 3, 3).

    - distances : the largest error of the three distances
    - energy spread : the range of the kinetic energy, over its mean
    - energy drift : mean kinetic energy of the last tenth of the rows less that of the first tenth, over that of all
    - angular momentum : the largest error of a component, over the size of the vector
    """
    first, turned = start()
    exact = [np.linalg.norm(first[a] - first[b]) for a, b in PAIRS]
    apart = max(
        float(np.abs(np.linalg.norm(x[:, a] - x[:, b], axis=1) / r - 1).max())
        for (a, b), r in zip(PAIRS, exact, strict=True)
    )
    tenth = len(x) // 10
    kinetic = (MASSES[:, None] * v**2).sum(axis=(1, 2)) / 2
    momentum = (MASSES[:, None] * np.cross(x, v)).sum(axis=1)
    true = (MASSES[:, None] * np.cross(first, turned)).sum(axis=0)
    return {
        "distances": apart,
        "energy spread": float(np.ptp(kinetic) / kinetic.mean()),
        "energy drift": float((kinetic[-tenth:].mean() - kinetic[:tenth].mean()) / kinetic.mean()),
        "angular momentum": float(np.abs(momentum - true).max() / np.linalg.norm(true)),
    }
