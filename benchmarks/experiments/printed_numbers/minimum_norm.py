r"""The rms energy error of a trajectory of hybrid Monte Carlo: leapfrog beside the minimum-norm splitting of order 2.

Positions and momenta are distributed as :math:`e^{-H}`, and :math:`\langle\Delta H^2\rangle^{1/2}` is taken over
that distribution by Gauss's quadrature rule, without random numbers.  The equality
:math:`\langle e^{-\Delta H}\rangle = 1` of volume-preserving methods checks the rule.

Both methods move the positions first.  To measure steps that move the momenta first, the methods are applied to
H(-p, q): positions and momenta then change places, and the flow is the same.

Source: T. Takaishi, Ph. de Forcrand, Phys. Rev. E 73 (2006) 036706 (hep-lat/0505020).
"""

from __future__ import annotations

import numpy as np

from phasebench.benchmarks.store.cells import Cell, Rows, content
from phasebench.integrators.ensemble import integrate_ensemble
from phasebench.integrators.registry import BY_ID
from phasebench.integrators.systems.hamiltonian import Hamiltonian

TABLE = "printed_numbers_minimum_norm"
#: Name -> potential.
POTENTIALS = {"oscillator": "q**2/2", "anharmonic": "q**2/2 + q**4/4"}
LEAPFROG, MINIMUM_NORM = "stormer-verlet-dkd", "omelyan-2"
#: Evaluations of the force a step.
FORCES = {LEAPFROG: 1, MINIMUM_NORM: 2}
POSITIONS, MOMENTA = "positions", "momenta"
#: Lengths of trajectories; numbers of steps in a unit of time.
LENGTHS, STEPS = (1.0, 2.0), (4, 6, 8, 12, 16, 24, 32)
#: Nodes of Gauss's rule in each variable.
NODES = 40
#: States of a smaller weight than this share of the sum are left out.
LEAST = 1e-18


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`), one for each potential, method and variable moved first; none if ``quick``."""
    if quick:
        return []
    return [_cell(name, id, first) for name in POTENTIALS for id in FORCES for first in (POSITIONS, MOMENTA)]


def _cell(name: str, id: str, first: str) -> Cell:
    needs = content(TABLE, BY_ID[id], POTENTIALS[name], first, LENGTHS, STEPS, NODES, code=[__name__])
    key = {"potential": name, "method": id, "first": first}
    return Cell("printed_numbers", (TABLE,), key, measure_rows, (name, id, first), needs, frozenset({id}))


def potential(name: str, q: np.ndarray) -> np.ndarray:
    """Evaluate the potential ``name``, of the harmonic or an anharmonic oscillator, at each element of q."""
    return q**2 / 2 if name == "oscillator" else q**2 / 2 + q**4 / 4


def states(name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (q, p, weights), arrays (n,): nodes and weights of a rule for averages over exp(-H).

    H is p^2 / 2 plus the potential ``name``; the weights have the sum 1.
    """
    x, w = np.polynomial.hermite_e.hermegauss(NODES)
    by_q = w * np.exp(x**2 / 2 - potential(name, x))
    weights = np.outer(by_q / by_q.sum(), w / w.sum()).ravel()
    q, p = (a.ravel() for a in np.meshgrid(x, x, indexing="ij"))
    kept = weights > LEAST
    return q[kept], p[kept], weights[kept]


def jumps(name: str, id: str, first: str, length: float, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Integrate a trajectory from each of the `states`: (Delta H, weights of the states), arrays (n,).

    ``name`` is the potential, ``id`` the method, ``first`` the variable that a step moves first; the trajectory takes
    ``steps`` steps over the time ``length``.
    """
    q, p, weights = states(name)
    V = POTENTIALS[name]
    if first == POSITIONS:
        system, start = Hamiltonian(q="q", p="p", H=f"p**2/2 + {V}"), (q, p)
    else:
        system, start = Hamiltonian(q="q", p="p", H=f"q**2/2 + {V.replace('q', 'p')}"), (p, -q)
    run = integrate_ensemble(system, id, start[0][:, None], start[1][:, None], h=length / steps, steps=steps, threads=1)
    ends = run.Q[:, -1, 0], run.P[:, -1, 0]
    Q, P = ends if first == POSITIONS else (-ends[1], ends[0])
    return P**2 / 2 - p**2 / 2 + potential(name, Q) - potential(name, q), weights


def measure_rows(name: str, id: str, first: str) -> Rows:
    """Measure the energy error of the method ``id`` in a potential: a row for each trajectory's length and step.

    ``first`` is the variable that a step moves first.  A row has the rms of Delta H, and how far <exp(-Delta H)> is
    from 1.
    """
    rows = []
    for length in LENGTHS:
        for steps in STEPS:
            d, weights = jumps(name, id, first, length, round(length * steps))
            row = {"potential": name, "method": id, "first": first, "length": length, "h": 1 / steps}
            row |= {"rms": float(np.sqrt(weights @ d**2)), "off": float(weights @ np.expm1(-d))}
            rows.append(row)
    return {TABLE: rows}
