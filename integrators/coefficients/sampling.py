"""Splittings of order 2 for sampling and molecular dynamics, with more stages than Stormer-Verlet.

Their numbers minimise an error and do not solve order conditions: they are used as printed, and the last number
of each kind is computed from the others, since drifts and kicks add up to the step.

Sources: S. Blanes, F. Casas, J. M. Sanz-Serna, SIAM J. Sci. Comput. 36 (2014) A1556-A1580, whose weights minimise the
expected energy error of Hamiltonian Monte Carlo on Gaussian targets; C. Predescu et al., Mol. Phys. 110 (2012) 967-983;
I. P. Omelyan, I. M. Mryglod, R. Folk, Comput. Phys. Commun. 151 (2003) 272-314 (minimum norm; the velocity version is
``mclachlan-s2``).

The trace of ``blanes-casas-sanz-serna-3`` on the oscillator touches -2 at h omega = 2.976; with its 14 digits it passes
-2 there by 3e-27, which no double shows.
"""

from __future__ import annotations

import mpmath

from .fractions import DIGITS
from .polish import starting_values
from .table import Table

_BCSS, _OMELYAN, _PREDESCU = ("blanes2014",), ("omelyan2003",), ("predescu2012",)

TABLES: tuple[Table, ...] = (
    Table(
        "blanes-casas-sanz-serna-2",
        "splitting",
        (2,),
        "Blanes, Casas & Sanz-Serna 2014, (6.4)",
        _BCSS,
        a=("1/2",),
        b=(
            "0.211324865405187117745425609749021272176199124364936561990699",
            "0.577350269189625764509148780501957455647601751270126876018602",
        ),
    ),
    Table(
        "blanes-casas-sanz-serna-3",
        "splitting",
        (2,),
        "Blanes, Casas & Sanz-Serna 2014, (6.7)",
        _BCSS,
        a=("0.29619504261126", "0.40760991477748"),
        b=("0.11888010966548", "0.38111989033452"),
    ),
    Table(
        "blanes-casas-sanz-serna-4",
        "splitting",
        (2,),
        "Blanes, Casas & Sanz-Serna 2014, (6.8)",
        _BCSS,
        a=("0.1916678", "0.3083322"),
        b=("0.071353913450279725904", "0.268548791161230105820", "0.320194590776980336552"),
    ),
    Table(
        "predescu-3",
        "splitting",
        (2,),
        "Predescu et al. 2012, (26), three stages",
        _PREDESCU,
        a=("0.290485609075128726", "0.419028781849742548"),
        b=("0.108991425403425322", "0.391008574596574678"),
    ),
    Table(
        "omelyan-2",
        "splitting",
        (2,),
        "Omelyan, Mryglod & Folk 2003, (31), position version",
        _OMELYAN,
        a=("0.19318332750378357396", "0.61363334499243285208"),
        b=("1/2",),
        first="A",
    ),
)
BY_NAME = {t.name: t for t in TABLES}


def steps(name: str) -> list[tuple[str, mpmath.mpf]]:
    """All substeps of the table ``name``, as printed: pairs of a letter, "A" (drift) or "B" (kick), and a weight."""
    table = BY_NAME[name]
    with mpmath.workdps(DIGITS):
        return table.steps(starting_values(table))
