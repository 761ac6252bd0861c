r"""ASE's velocity Verlet as a peer: atoms on lines, with the masses of :math:`H = \sum p_i^2 / 2 m_i + V(q)`.

Forces come from a calculator in Python around this project's compiled gradient of V: the time is that of Python.  ASE's
units, eV = amu Angstrom^2 / t^2 with its own unit of time t, need no factors.

Source: A. H. Larsen et al., J. Phys.: Condens. Matter 29 (2017) 273002.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from .field import split_gradients
from .forms import ON_LINES, masses, on_lines
from .record import Claims, Peer, Run, Task
from .run import by_rows

if TYPE_CHECKING:
    from ase import Atoms

    from phasebench.integrators.systems.hamiltonian import Hamiltonian


def _atoms(system: Hamiltonian, y: np.ndarray) -> Atoms:
    """ASE's atoms at the state (q, p), with a calculator that counts its calls."""
    from ase import Atoms
    from ase.calculators.calculator import Calculator, all_changes

    slope, d = split_gradients(system)[0], system.d

    class Potential(Calculator):
        implemented_properties = ("energy", "forces")
        calls = 0

        def calculate(
            self,
            atoms: Atoms | None = None,
            properties: Sequence[str] = ("forces",),
            system_changes: Sequence[str] = all_changes,
        ) -> None:
            super().calculate(atoms, properties, system_changes)
            self.calls += 1
            state = np.concatenate([atoms.positions[:, 0], np.zeros(d)])
            self.results = {"energy": 0.0, "forces": on_lines(-np.array(slope(state)))}

    atoms = Atoms(numbers=[1] * d, positions=on_lines(y[:d]), masses=masses(system))
    atoms.set_momenta(on_lines(y[d:]))
    atoms.calc = Potential()
    return atoms


def _run(task: Task) -> Run:
    from ase.md.verlet import VelocityVerlet

    atoms = _atoms(task.system, task.state)
    dynamics = VelocityVerlet(atoms, timestep=task.h, logfile=None)

    def state() -> np.ndarray:
        return np.concatenate([atoms.positions[:, 0], atoms.get_momenta()[:, 0]])

    return by_rows(task, lambda i, n: dynamics.run(n) and None, state)._replace(gradient=atoms.calc.calls)


DOCUMENTED = "https://ase-lib.org/ase/md.html"

PEERS: tuple[Peer, ...] = (
    Peer(
        "ase-velocity-verlet",
        "ASE's VelocityVerlet",
        package="ase",
        order=2,
        license="LGPL-2.1-or-later",
        about="Python loop; forces by a calculator around this project's compiled gradient",
        source="Verlet 1967, Phys. Rev. 159, 98-103",
        run=_run,
        claims=Claims(
            energy="bounded",
            source=f'"this preserves the particle number, volume ..., and the energy", {DOCUMENTED}',
        ),
        **ON_LINES,
    ),
)
