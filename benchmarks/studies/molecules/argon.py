"""Energies that packages of molecular dynamics report of seven argon atoms with Lennard-Jones forces.

Each package runs at default and at best settings: OpenMM on its default platform (CPU, forces in single precision) and
on its Reference platform; ASE with its cutoff at 3 sigma and with none; JAX-MD in single precision with its smooth
cutoff at 2.5 sigma, and in double without.  All take the steps of velocity Verlet.

Source: the problem `lennard-jones`; the packages' documentation of their Lennard-Jones potentials.
"""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Callable, Iterator

import numpy as np

from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import Unavailable
from phasebench.integrators.driver import integrate
from phasebench.reference.installed import how_to_install, is_installed
from phasebench.reference.peers.jax_loop import double_precision

TABLE = "molecules_argon"
PROBLEM, METHOD = "lennard-jones", "stormer-verlet"
H, STEPS, EVERY = 0.004, 100_000, 100
DEFAULTS, BEST = "defaults", "at its best"
OURS = "phasebench"
FAR = 1e3

Report = Iterator[float]


def start() -> tuple[np.ndarray, np.ndarray]:
    """Return positions and velocities of the atoms in the plane z = 0, arrays (7, 3)."""
    made = problem(PROBLEM)
    q, p = (np.reshape(x, (-1, 2)) for x in (made.q0, made.p0))
    return tuple(np.column_stack([x, np.zeros(len(x))]) for x in (q, p))


def _openmm(best: bool) -> tuple[str, Report]:
    """Set up OpenMM's VerletIntegrator: (its settings as text, iterator over the energies of a run).

    The initial velocities are moved back by half a step, since this leapfrog has its velocities at half steps.  With
    ``best`` it runs on the Reference platform, in double precision.
    """
    import openmm

    x, v = start()
    made, force = openmm.System(), openmm.CustomNonbondedForce("4*(r^-12-r^-6)")
    for _ in x:
        made.addParticle(1.0)
        force.addParticle([])
    made.addForce(force)
    integrator = openmm.VerletIntegrator(H)
    platform = (openmm.Platform.getPlatformByName("Reference"),) if best else ()
    context = openmm.Context(made, integrator, *platform)
    context.setPositions(x)
    context.setVelocities(v - H / 2 * context.getState(forces=True).getForces(asNumpy=True)._value)

    def energies() -> Report:
        for _ in range(STEPS // EVERY):
            integrator.step(EVERY)
            state = context.getState(energy=True)
            yield state.getPotentialEnergy()._value + state.getKineticEnergy()._value

    name = context.getPlatform().getName()
    return f"{name} platform, {'double' if best else 'single'} precision, no cutoff", energies()


def _ase(best: bool) -> tuple[str, Report]:
    """Set up ASE's VelocityVerlet with its Lennard-Jones calculator: (settings as text, iterator over the energies).

    Without ``best`` the calculator has its default cutoff; with ``best`` the potential has none.
    """
    from ase import Atoms
    from ase.calculators.lj import LennardJones
    from ase.md.verlet import VelocityVerlet

    x, v = start()
    atoms = Atoms(numbers=[18] * len(x), positions=x, masses=np.ones(len(x)))
    atoms.set_momenta(v)
    atoms.calc = LennardJones(**{"rc": FAR} if best else {})
    dynamics = VelocityVerlet(atoms, timestep=H, logfile=None)

    def energies() -> Report:
        for _ in range(STEPS // EVERY):
            dynamics.run(EVERY)
            yield atoms.get_total_energy()

    return f"double precision, {'no cutoff' if best else 'cutoff at 3 sigma, shifted'}", energies()


def _jax_md(best: bool) -> tuple[str, Report]:
    """Set up JAX-MD's nve with its Lennard-Jones pair energy: (settings as text, iterator over the energies).

    Without ``best`` it runs in single precision with the default cutoff, with ``best`` in double precision without one.
    """
    import jax
    import jax.numpy as jnp
    from jax_md import energy, quantity, simulate, space

    displacement, shift = space.free()

    def energies() -> Report:
        with double_precision() if best else contextlib.nullcontext(), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of types that single precision does not have
            x, v = map(jnp.array, start())
            U = energy.lennard_jones_pair(displacement, **{"r_onset": FAR - 1, "r_cutoff": FAR} if best else {})
            begin, step = simulate.nve(U, shift, dt=H)
            state = begin(None, x, 0.0, mass=1.0, momenta=v)
            run = jax.jit(lambda s: jax.lax.fori_loop(0, EVERY, lambda _, s: step(s), s))
            for _ in range(STEPS // EVERY):
                state = run(state)
                kinetic = quantity.kinetic_energy(momentum=state.momentum, mass=state.mass)
                yield float(U(state.position) + kinetic)

    told = "double precision, no cutoff" if best else "single precision, smooth cutoff at 2.5 sigma"
    return told, energies()


ENGINES: dict[str, Callable[[bool], tuple[str, Report]]] = {"openmm": _openmm, "ase": _ase, "jax_md": _jax_md}


def measure(package: str, settings: str) -> dict:
    """The spread and the drift of the energy that a package reports; raises Unavailable without the package."""
    if package == OURS:
        s = integrate(problem(PROBLEM), METHOD, h=H, steps=STEPS, save_every=EVERY)
        told, found = "double precision, no cutoff, compensated sums", s.energy()[1:]
    elif not is_installed(package):
        raise Unavailable(f"{package} is not installed; {how_to_install(package)}")
    else:
        told, report = ENGINES[package](settings == BEST)
        found = np.array(list(report))
    return {"told": told} | summary(found)


def summary(energies: np.ndarray) -> dict[str, float]:
    """Compute mean, spread and drift, with the drift's uncertainty, of the energies of a run, an array (rows,).

    The spread is the difference of the largest and the smallest energy; the drift is the last tenth's mean less the
    first's, over the spread.  Its uncertainty, over the spread too, is that of both means, from blocks of a hundredth
    of the rows.
    """
    blocks = energies[: len(energies) // 100 * 100].reshape(100, -1).mean(axis=1)
    first, last = blocks[:10], blocks[-10:]
    unsure = np.sqrt((first.var(ddof=1) + last.var(ddof=1)) / 10)
    spread = float(np.ptp(energies))
    drift, unsure = (float(x / spread) for x in (last.mean() - first.mean(), unsure))
    return {"mean": float(energies.mean()), "spread": spread, "drift": drift, "uncertainty": unsure}
