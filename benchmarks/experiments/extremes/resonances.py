r"""Step-size resonances of two coupled oscillators, over (h omega_1, h omega_2).

.. math::
    H = \tfrac12(p_1^2 + p_2^2) + \tfrac12(\omega_1^2 q_1^2 + \omega_2^2 q_2^2) + \kappa\,\omega_1\omega_2 q_1 q_2,

kappa < 1, is a stable linear system.  A step of it is a 4 x 4 matrix, unstable where its spectral radius is above 1:
beyond a method's limit and, for methods that split the coupling off, in strips about
:math:`h(\omega_1 + \omega_2) = 2\pi k`.

Source: Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), XIII.2 and XIII.4.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import sympy as sp

from phasebench.benchmarks.store.cells import Cell, Rows, content
from phasebench.integrators.prepared import prepare
from phasebench.integrators.systems.hamiltonian import Hamiltonian

from .methods import record

if TYPE_CHECKING:
    from phasebench.integrators.prepared import PreparedRun

METHODS = ("stormer-verlet", "deuflhard", "mollified-impulse", "hairer-lubich")
#: The coupling kappa; ratios omega_2 / omega_1; the largest h omega_2 and the number of its values.
COUPLING = sp.Rational(1, 5)
RATIOS = tuple(sp.Rational(round(16 * 2 ** (k / 5)), 16) for k in range(16))
LAST, POINTS = 10.0, 120
TABLES = ("extremes_resonances",)


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements to make (`Cell`), one for each method; none if ``quick``."""
    return [] if quick else [_cell(id) for id in METHODS]


def _cell(id: str) -> Cell:
    needs = content("resonances", record(id), *map(str, RATIOS), str(COUPLING), code=[__name__])
    return Cell("extremes", TABLES, {"method": id}, measure_rows, (id,), needs, frozenset({id}))


class CoupledOscillators:
    """Two coupled oscillators with frequencies 1 and ``ratio``, as a problem with ``system``, ``q0`` and ``p0``."""

    def __init__(self, ratio: sp.Rational) -> None:
        q1, q2, p1, p2 = sp.symbols("q1 q2 p1 p2", real=True)
        H = (p1**2 + p2**2) / 2 + (q1**2 + ratio**2 * q2**2) / 2 + COUPLING * ratio * q1 * q2
        self.system = Hamiltonian(q=[q1, q2], p=[p1, p2], H=H, frequencies=[1, ratio])
        self.q0, self.p0 = (1.0, 0.0), (0.0, 0.0)


def radius(run: PreparedRun, h: float) -> float:
    """Compute the spectral radius of the matrix of one step of length h on a linear system.

    ``run`` integrates the system: a function (h, steps, q, p) -> (q, p, ...).
    """
    columns = [np.concatenate(run(h, 1, unit[:2], unit[2:])[:2]) for unit in np.eye(4)]
    return float(np.abs(np.linalg.eigvals(np.array(columns).T)).max())


def measure_rows(id: str) -> Rows:
    """Compute the spectral radius of a method's step on coupled oscillators: a row for each frequency ratio and h."""
    rows = []
    for ratio in RATIOS:
        run, w = prepare(CoupledOscillators(ratio), record(id)), float(ratio)
        for z in np.linspace(LAST / POINTS, LAST, POINTS):
            rows.append(
                {
                    "method": id,
                    "ratio": w,
                    "h omega 1": float(z / w),
                    "h omega 2": float(z),
                    "radius": radius(run, z / w),
                }
            )
    return {TABLES[0]: rows}
