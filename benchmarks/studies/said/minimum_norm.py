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
import pandas as pd

from phasebench.benchmarks.page.study import Runs
from phasebench.benchmarks.page.verdict import Range
from phasebench.integrators.ensemble import integrate_ensemble
from phasebench.integrators.systems.hamiltonian import Hamiltonian

TABLE = "printed_numbers_minimum_norm"
#: Name -> potential; evaluations of the force a step of each method.
POTENTIALS = {"oscillator": "q**2/2", "anharmonic": "q**2/2 + q**4/4"}
LEAPFROG, MINIMUM_NORM = "stormer-verlet-dkd", "omelyan-2"
FORCES = {LEAPFROG: 1, MINIMUM_NORM: 2}
POSITIONS, MOMENTA = "positions", "momenta"
#: Lengths of trajectories; numbers of steps in a unit of time; the rms error at which steps are compared.
LENGTHS, STEPS, EQUAL = (1.0, 2.0), (4, 6, 8, 12, 16, 24, 32), 1e-3
#: Nodes of Gauss's rule in each variable; states of a smaller weight than this share of the sum are left out.
NODES, LEAST = 40, 1e-18


def potential(name: str, q: np.ndarray) -> np.ndarray:
    """The potential ``name`` at each element of q."""
    return q**2 / 2 if name == "oscillator" else q**2 / 2 + q**4 / 4


def states(name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(q, p, weights), arrays (n,): nodes and weights, of the sum 1, of a rule for averages over exp(-H)."""
    x, w = np.polynomial.hermite_e.hermegauss(NODES)
    by_q = w * np.exp(x**2 / 2 - potential(name, x))
    weights = np.outer(by_q / by_q.sum(), w / w.sum()).ravel()
    q, p = (a.ravel() for a in np.meshgrid(x, x, indexing="ij"))
    kept = weights > LEAST
    return q[kept], p[kept], weights[kept]


def jumps(name: str, id: str, first: str, length: float, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """(Delta H, weights), arrays (n,): of trajectories of a length from each of the `states`."""
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


def jump(potential: str, method: str, first: str) -> list[dict]:
    """The rms of Delta H, and how far <exp(-Delta H)> is from 1, a row for each length of a trajectory and step.

    ``first`` is the variable that a step moves first.
    """
    rows = []
    for length in LENGTHS:
        for steps in STEPS:
            d, weights = jumps(potential, method, first, length, round(length * steps))
            rms, off = float(np.sqrt(weights @ d**2)), float(weights @ np.expm1(-d))
            rows.append({"length": length, "h": 1 / steps, "rms": rms, "off": off})
    return rows


def _rms(rows: pd.DataFrame) -> pd.DataFrame:
    """The rms of both methods, by the variable that is moved first, length and step."""
    table = rows.pivot_table(index=["first", "length", "h"], columns="method", values="rms")
    return table.reindex(columns=list(FORCES)).dropna()


def _span(values: pd.Series) -> Range | None:
    known = values.dropna()
    return Range(float(known.min()), float(known.max())) if len(known) else None


def smaller(rows: pd.DataFrame) -> Range | None:
    """Leapfrog's rms error over that of the minimum-norm splitting at the same step."""
    rms = _rms(rows)
    return _span(rms[LEAPFROG] / rms[MINIMUM_NORM])


def longer(rows: pd.DataFrame, percent: bool = False) -> Range | None:
    """The minimum-norm splitting's step over leapfrog's, where each has the rms error `EQUAL`.

    As ``percent``: how much farther it goes for an evaluation of the force.
    """

    def step(rms: pd.Series) -> float:
        h = np.log(rms.index.get_level_values("h"))
        return float(np.exp(np.interp(np.log(EQUAL), np.log(rms), h, left=np.nan, right=np.nan)))

    steps = pd.DataFrame(
        [part.apply(step) for _, part in _rms(rows).groupby(level=["first", "length"])], columns=list(FORCES)
    )
    found = steps[MINIMUM_NORM] / steps[LEAPFROG]
    return _span(100 * (found / FORCES[MINIMUM_NORM] - 1) if percent else found)


RUNS = Runs(
    TABLE,
    jump,
    [{"potential": v, "method": m, "first": f} for v in POTENTIALS for m in FORCES for f in (POSITIONS, MOMENTA)],
)
