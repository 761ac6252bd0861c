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
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from phasebench.reference.files import entries

from .galactic import is_henon_heiles, powers
from .record import Claims, Peer, Run, Task

if TYPE_CHECKING:
    from phasebench.integrators.systems.hamiltonian import Hamiltonian, PartitionedSystem

LEAPFROG, RUTH4, RK5, DOPRI853 = "LeapfrogIntegrator", "Ruth4Integrator", "RK5Integrator", "DOPRI853Integrator"
#: The integrators of second-order systems, q' = v.
SECOND_ORDER = (LEAPFROG, RUTH4)
#: A number of steps that no run reaches; gala's defaults are 500 per row in Python and 100000 in all in Cython.
MOST_STEPS = 10**9


# -- Python -------------------------------------------------------------------------------------------------------


@lru_cache(maxsize=64)
def _masses(system: Hamiltonian) -> tuple[np.ndarray, np.ndarray] | None:
    """(M, M^-1) of a quadratic kinetic energy; None for the identity."""
    if system.unit_mass:
        return None
    import sympy as sp

    inverse = sp.hessian(system.kinetic, system.p)
    return np.array(inverse.inv(), dtype=float), np.array(inverse, dtype=float)


def _function(system: PartitionedSystem, integrator: str, calls: list) -> Callable[[float, np.ndarray], np.ndarray]:
    """Make the right-hand side F(t, w) of a system for gala, w of shape (2 d, 1); calls[0] counts its calls."""
    field, d = system.vector_field(), system.d
    masses = _masses(system) if integrator in SECOND_ORDER else None
    if masses is None:

        def function(t: float, w: np.ndarray) -> np.ndarray:
            calls[0] += 1
            return field(t, w[:, 0])[:, None]

        return function
    inverse = masses[1]

    def function(t: float, w: np.ndarray) -> np.ndarray:
        calls[0] += 1
        return np.concatenate([w[d:], (inverse @ field(t, w[:, 0])[d:])[:, None]])

    return function


def _call(
    integrator: str,
    function: Callable[[float, np.ndarray], np.ndarray],
    state: np.ndarray,
    times: dict[str, Any],
    options: dict[str, Any],
) -> tuple[Any, float]:
    """Integrate with gala's class ``integrator`` from ``state``, the pair (q, v): (gala's Orbit, seconds).

    ``function`` is the right-hand side F(t, w); ``times`` and ``options`` are keyword arguments of gala, as `_ways`
    makes them.
    """
    solver = _class(integrator)(function, **options)
    began = time.perf_counter()
    orbit = solver(state, **times)
    return orbit, time.perf_counter() - began


@lru_cache(maxsize=8)
def _warm(integrator: str) -> None:
    """Take one step with gala's class ``integrator`` before any timing, so that lazy imports and set-up are done."""
    _call(integrator, lambda t, w: np.array([w[1], -w[0]]), np.array([1.0, 0.0]), {"dt": 0.1, "n_steps": 1}, {})


def _ways(integrator: str, task: Task, limit: str) -> tuple[dict[str, Any], dict[str, Any], list[int] | slice, int]:
    """The arguments of gala's call for a task: (times, options, index of the rows to keep, steps or 0 if unknown).

    ``times`` and ``options`` are keyword arguments of gala, the former the step and number of steps, or the times of
    rows; ``limit`` is the name of gala's option for the largest number of steps.
    """
    if integrator != DOPRI853:
        return {"dt": task.h, "n_steps": task.steps}, {}, task.numbers, task.steps
    tolerances = {} if task.tol is None else {"rtol": task.tol, "atol": task.tol}
    return {"t": task.times}, {limit: MOST_STEPS, **tolerances}, slice(None), 0


def _run_python(integrator: str) -> Callable[[Task], Run]:
    def run(task: Task) -> Run:
        _warm(integrator)
        masses = _masses(task.system) if integrator in SECOND_ORDER else None
        v = task.p if masses is None else masses[1] @ task.p
        calls = [0]
        function = _function(task.system, integrator, calls)
        times, options, rows, steps = _ways(integrator, task, "nsteps")
        began = time.perf_counter()
        with np.errstate(all="ignore"):
            try:
                orbit, seconds = _call(integrator, function, np.concatenate([task.q, v]), times, options)
            except (ArithmeticError, RuntimeError) as error:
                return Run.stuck(task, 0, calls[0], time.perf_counter() - began, str(error))
        Q, V = (np.array(x.xyz if hasattr(x, "xyz") else x.d_xyz)[:, rows].T for x in (orbit.pos, orbit.vel))
        P = V if masses is None else V @ masses[0].T
        P[0] = task.p
        return Run(Q, P, steps, calls[0], seconds)

    return run


def _lacks_python(integrator: str) -> Callable[[Any, PartitionedSystem], str | None]:
    def lacks(problem: Any, system: PartitionedSystem) -> str | None:
        if integrator in SECOND_ORDER and not (system.canonical and system.quadratic_kinetic):
            return "it integrates q'' = a(q) alone: H must be p.M^-1 p / 2 + V(q)"
        return None

    return lacks


# -- Cython -------------------------------------------------------------------------------------------------------


@lru_cache(maxsize=64)
def _potential(system: Hamiltonian) -> Any:
    """Make gala's Hamiltonian object for a system whose potential gala has in C.

    A first step is taken with each integrator, so that set-up is not timed later.
    """
    import gala.potential

    if is_henon_heiles(system):
        potential = gala.potential.HenonHeilesPotential()
    else:
        potential = gala.potential.KeplerPotential(m=-powers(system)[0][0])
    hamiltonian = gala.potential.Hamiltonian(potential)
    for integrator in (LEAPFROG, RUTH4, DOPRI853):
        hamiltonian.integrate_orbit(np.full(hamiltonian.ndim, 0.5), Integrator=_class(integrator), dt=1e-3, n_steps=1)
    return hamiltonian


def _class(integrator: str) -> type[Any]:
    import gala.integrate

    return getattr(gala.integrate, integrator)


def _run_cython(integrator: str) -> Callable[[Task], Run]:
    def run(task: Task) -> Run:
        hamiltonian, d = _potential(task.system), task.system.d
        state = np.zeros(hamiltonian.ndim)
        half = hamiltonian.ndim // 2
        state[:d], state[half : half + d] = task.q, task.p
        times, options, rows, steps = _ways(integrator, task, "nmax")
        began = time.perf_counter()
        try:
            orbit = hamiltonian.integrate_orbit(
                state, Integrator=_class(integrator), Integrator_kwargs=options, **times
            )
        except RuntimeError as error:
            return Run.stuck(task, 0, 0, time.perf_counter() - began, str(error))
        seconds = time.perf_counter() - began
        states = orbit.w()[:, rows].T
        return Run(states[:, :d], states[:, half : half + d], steps, 0, seconds)

    return run


def _lacks_cython(problem: Any, system: PartitionedSystem) -> str | None:
    if is_henon_heiles(system):
        return None
    terms = powers(system)
    if system.d in (2, 3) and terms is not None and len(terms) == 1 and terms[0][1] == -1:
        return None
    return "of the potentials that gala has in C, only Kepler's and Henon and Heiles's are among the problems here"


def _peer(
    id: str,
    integrator: str,
    name: str,
    order: int,
    about: str,
    source: str,
    claims: Mapping[str, Any],
    *,
    cython: bool = False,
) -> Peer:
    adaptive = integrator == DOPRI853
    where = (
        "C through Cython; its time includes the making of an Orbit" if cython else "a step in NumPy, forces in Python"
    )
    if cython:
        scope = "Kepler and Henon-Heiles (what gala has in C)"
    else:
        scope = "H = p.M^-1 p / 2 + V(q)" if integrator in SECOND_ORDER else "any"
    return Peer(
        f"gala-{id}-cython" if cython else f"gala-{id}",
        f"{name} in Cython" if cython else name,
        package="gala",
        adaptive=adaptive,
        order=order,
        license="MIT",
        about=f"{about}; {where}",
        source=source,
        run=_run_cython(integrator) if cython else _run_python(integrator),
        scope=scope,
        lacks=_lacks_cython if cython else _lacks_python(integrator),
        claims=Claims(**claims, source=f"gala.integrate.{integrator}.__doc__ of gala 1.11.0"),
        least=1e-14 if adaptive else 0.0,
    )


PEERS: tuple[Peer, ...] = tuple(_peer(**entry) for entry in entries(__file__))
