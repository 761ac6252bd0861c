r"""gala's integrators as peers: its Python classes for any system, its Cython loops for potentials that it has in C.

The Python integrators take a function (t, w) -> w' of the state w = (q, v).  Leapfrog and Ruth's method use only its
second half and set q' = v: they integrate :math:`\ddot q = a(q)`, here :math:`H = p^T M^{-1} p/2 + V(q)` in the
velocities :math:`v = M^{-1}p`.  The Cython loops are called through `gala.potential.Hamiltonian.integrate_orbit`; among
the problems here gala has Kepler's (in space; the plane is z = 0) and Henon and Heiles's in C.  Without units, G = 1.

In version 1.11, RK5 and Ruth4 evaluate a force that depends on time at the end of the step, which reduces their order
to 1 for such forces (no system here has them); the Python DOPRI853 restarts at every row, the Cython one interpolates
rows.  Statements of its documentation beyond `Claims` are tested by the audit's scripts.

Source: A. M. Price-Whelan, J. Open Source Softw. 2 (2017) 388.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from phasebench.reference.files import entries

from .forms import is_henon_heiles, powers
from .record import Claims, Peer, Run, Task, only

if TYPE_CHECKING:
    from phasebench.integrators.systems.hamiltonian import Hamiltonian, PartitionedSystem

LEAPFROG, RUTH4, RK5, DOPRI853 = "LeapfrogIntegrator", "Ruth4Integrator", "RK5Integrator", "DOPRI853Integrator"
#: The integrators of second-order systems, q' = v.
SECOND_ORDER = (LEAPFROG, RUTH4)
#: A number of steps that no run reaches; gala's defaults are 500 per row in Python and 100000 in all in Cython.
MOST_STEPS = 10**9


def _class(integrator: str) -> type[Any]:
    import gala.integrate

    return getattr(gala.integrate, integrator)


@lru_cache(maxsize=64)
def _masses(system: Hamiltonian) -> tuple[np.ndarray, np.ndarray] | None:
    """(M, M^-1) of a quadratic kinetic energy; None for the identity."""
    if system.unit_mass:
        return None
    import sympy as sp

    inverse = sp.hessian(system.kinetic, system.p)
    return np.array(inverse.inv(), dtype=float), np.array(inverse, dtype=float)


@lru_cache(maxsize=8)
def _warm(integrator: str) -> None:
    """Take one step with gala's class ``integrator`` before any timing, so that lazy imports and set-up are done."""
    _class(integrator)(lambda t, w: np.array([w[1], -w[0]]))(np.array([1.0, 0.0]), dt=0.1, n_steps=1)


@lru_cache(maxsize=64)
def _potential(system: Hamiltonian) -> Any:
    """gala's Hamiltonian object for a system whose potential it has in C, after a step with each integrator."""
    import gala.potential

    if is_henon_heiles(system):
        potential = gala.potential.HenonHeilesPotential()
    else:
        potential = gala.potential.KeplerPotential(m=-powers(system)[0][0])
    hamiltonian = gala.potential.Hamiltonian(potential)
    for integrator in (LEAPFROG, RUTH4, DOPRI853):
        hamiltonian.integrate_orbit(np.full(hamiltonian.ndim, 0.5), Integrator=_class(integrator), dt=1e-3, n_steps=1)
    return hamiltonian


def _timed(integrator: str, task: Task, limit: str, build: Callable[[dict], Callable]) -> tuple[Any, float, str | None]:
    """Run a task by gala's call, which ``build(options)`` makes: (rows w or None, seconds, failure or None).

    ``limit`` is the name of gala's option for the largest number of steps.
    """
    times, options, rows = {"dt": task.h, "n_steps": task.steps}, {}, task.numbers
    if integrator == DOPRI853:
        times, options, rows = {"t": task.times}, {limit: MOST_STEPS} | task.tolerances("rtol", "atol"), slice(None)
    call = build(options)
    began = time.perf_counter()
    try:
        with np.errstate(all="ignore"):
            orbit = call(**times)
    except (ArithmeticError, RuntimeError) as error:
        return None, time.perf_counter() - began, str(error)
    seconds = time.perf_counter() - began
    return orbit.w()[:, rows].T, seconds, None


def _run_python(integrator: str) -> Callable[[Task], Run]:
    def run(task: Task) -> Run:
        _warm(integrator)
        field, d, calls = task.system.vector_field(), task.system.d, [0]
        masses = _masses(task.system) if integrator in SECOND_ORDER else None
        v = task.p if masses is None else masses[1] @ task.p

        def function(t: float, w: np.ndarray) -> np.ndarray:
            calls[0] += 1
            return field(t, w[:, 0])[:, None]

        def accelerations(t: float, w: np.ndarray) -> np.ndarray:
            calls[0] += 1
            return np.concatenate([w[d:], (masses[1] @ field(t, w[:, 0])[d:])[:, None]])

        def build(options: dict[str, Any]) -> Callable:
            solver = _class(integrator)(function if masses is None else accelerations, **options)
            return partial(solver, np.concatenate([task.q, v]))

        rows, seconds, failure = _timed(integrator, task, "nsteps", build)
        if failure is not None:
            return Run.stuck(task, 0, calls[0], seconds, failure)
        P = rows[:, d:] if masses is None else rows[:, d:] @ masses[0].T
        P[0] = task.p
        return Run(rows[:, :d], P, 0 if integrator == DOPRI853 else task.steps, calls[0], seconds)

    return run


def _run_cython(integrator: str) -> Callable[[Task], Run]:
    def run(task: Task) -> Run:
        hamiltonian, d = _potential(task.system), task.system.d
        half = hamiltonian.ndim // 2
        state = np.zeros(hamiltonian.ndim)
        state[:d], state[half : half + d] = task.q, task.p

        def build(options: dict[str, Any]) -> Callable:
            how = {"Integrator": _class(integrator), "Integrator_kwargs": options}
            return partial(hamiltonian.integrate_orbit, state, **how)

        rows, seconds, failure = _timed(integrator, task, "nmax", build)
        if failure is not None:
            return Run.stuck(task, 0, 0, seconds, failure)
        steps = 0 if integrator == DOPRI853 else task.steps
        return Run(rows[:, :d], rows[:, half : half + d], steps, 0, seconds)

    return run


def _in_c(system: PartitionedSystem) -> bool:
    """True for the systems of this suite whose potential gala has in C."""
    terms = powers(system)
    kepler = system.d in (2, 3) and terms is not None and len(terms) == 1 and terms[0][1] == -1
    return kepler or is_henon_heiles(system)


IN_C = only(
    "Kepler and Henon-Heiles (what gala has in C)",
    "of the potentials that gala has in C, only Kepler's and Henon and Heiles's are among the problems here",
    _in_c,
)
ACCELERATED = only(
    "H = p.M^-1 p / 2 + V(q)",
    "it integrates q'' = a(q) alone: H must be p.M^-1 p / 2 + V(q)",
    lambda system: system.canonical and system.quadratic_kinetic,
)


def _peer(
    id: str, integrator: str, name: str, about: str, claims: Mapping[str, Any], cython: bool = False, **facts: Any
) -> Peer:
    adaptive = integrator == DOPRI853
    where, system = "a step in NumPy, forces in Python", ACCELERATED if integrator in SECOND_ORDER else {}
    if cython:
        where, system = "C through Cython; its time includes the making of an Orbit", IN_C
    return Peer(
        f"gala-{id}-cython" if cython else f"gala-{id}",
        f"{name} in Cython" if cython else name,
        package="gala",
        adaptive=adaptive,
        license="MIT",
        about=f"{about}; {where}",
        run=_run_cython(integrator) if cython else _run_python(integrator),
        claims=Claims(**claims, source=f"gala.integrate.{integrator}.__doc__ of gala 1.11.0"),
        least=1e-14 if adaptive else 0.0,
        **system,
        **facts,
    )


PEERS: tuple[Peer, ...] = tuple(_peer(**entry) for entry in entries(__file__))
