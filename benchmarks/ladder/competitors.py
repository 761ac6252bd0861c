"""The competitors: every method of this project that can integrate a problem, and every peer at its best settings.

Peers are integrators of other packages.  They run as fast as their packages can: heyoka with and without
``high_accuracy`` and ``compact_mode`` (if it compiles in `race.PREPARING` seconds); REBOUND's WHFast with
``safe_mode`` 0, its correctors, kernels and coordinates, IAS15 in each of its adaptive modes, SABA, leapfrog, JANUS,
EOS and BS; SciPy's solvers with right-hand sides compiled by Numba, and its older interfaces, whose loops are compiled
as well; Boost.odeint in compiled C++ and pynamicalsys with Numba, where installed.  `LEFT_OUT` lists peers that do not
compete, and why.

On problems of more than `SMALL` degrees of freedom only some of this project's methods compete (`practical`).
"""

from __future__ import annotations

from functools import cache

from phasebench.benchmarks.measure.integrator import OURS, Integrator, integrator
from phasebench.benchmarks.measure.variants import variants
from phasebench.benchmarks.problems.base import Problem
from phasebench.integrators.record import Method
from phasebench.integrators.systems.hamiltonian import PartitionedSystem
from phasebench.reference.peers import PEERS, heyoka, rebound, scipy

from . import peer_rows
from .trial import exact

#: Registered peer that does not compete -> the reason.
LEFT_OUT = {
    "heyoka-batch": "it carries the same orbit in every lane: a throughput of many orbits",
    "scipy-dop853": "its right-hand side is Python; scipy-dop853-numba is the same solver with a compiled one",
    "scipy-lsoda": "its right-hand side is Python; scipy-lsoda-numba is the same solver with a compiled one",
    "scipy-radau": "its right-hand side is Python; scipy-radau-numba is the same solver with a compiled one",
}
#: Degrees of freedom up to which all of this project's methods compete; the families that compete above, together with
#: Gauss methods and, if H is separable, parametric methods with one stage per substep.
SMALL = 4
PRACTICAL = (
    *("splitting", "processed", "force_gradient", "extended", "runge_kutta", "relaxation", "adaptive", "field"),
    *("wisdom_holman", "fcirk", "multistep", "rigid", "parts", "trigonometric"),
)
#: Largest number of stage unknowns of a Gauss method above `SMALL`: a dense Newton step costs its cube.
UNKNOWNS = 512
#: Competitors that are measured first; their times are the ones that the others have to beat.
FIRST = ("heyoka", "heyoka-high-accuracy", "rebound-ias15", "stormer-verlet", "pefrl", "gauss-4", "gauss-8")


@cache
def competitors() -> tuple[Integrator, ...]:
    """All competitors, those of `FIRST` before the others."""
    ours = [integrator(id, parameters=dict(parameters)) for id, parameters in variants()]
    found = {c.label: c for c in (*ours, *map(Integrator, peers()))}
    first = [found.pop(id) for id in FIRST if id in found]
    return (*first, *found.values())


def peers() -> list:
    """The competing integrators of other packages, also with settings that are not registered."""
    registered = [p for p in PEERS if p.package in (*peer_rows.PACKAGES, *peer_rows.OPTIONAL) and p.id not in LEFT_OUT]
    modes = [rebound.ias15(mode) for mode in rebound.ADAPTIVE_MODES[1:]]
    return [*registered, *heyoka.variants(), *modes, *rebound.TRIED, scipy.fast("ode"), scipy.fast("odeint")]


def able(problem: Problem) -> tuple[list[Integrator], dict[str, str]]:
    """(The competitors that can integrate a problem, label -> reason for each of the others)."""
    can, cannot = [], {}
    for c in competitors():
        lack = c.lacks(problem) or ("it is exact on this problem, in one step" if exact(c, problem) else None)
        if lack is None and ours(c) and not practical(c.record, problem.system):
            lack = f"above {SMALL} degrees of freedom only explicit, one-stage, Gauss and relaxation methods compete"
        if lack is None:
            can.append(c)
        else:
            cannot[c.label] = lack
    return can, cannot


def practical(m: Method, system: PartitionedSystem) -> bool:
    """True if a method competes on a system of its number of degrees of freedom.

    Above `SMALL`, those left out take minutes to compile: root finders around stages, averages, projections,
    derivatives of second and higher order.
    """
    if system.d <= SMALL or m.family in PRACTICAL:
        return True
    if m.family == "collocation":
        unknowns = system.d if system.quadratic_kinetic else 2 * system.d
        return m.data[0] == "gauss" and m.data[1] * unknowns <= UNKNOWNS
    return m.family == "parametric" and system.separable and m.data[0] == 1


def ours(c: Integrator) -> bool:
    """True for a method of this project."""
    return c.kind == OURS
