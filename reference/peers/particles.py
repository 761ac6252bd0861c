r"""Hamiltonian systems as REBOUND's particles, through its public Python interface, which is imported on demand.

REBOUND integrates :math:`\ddot x_i = a_i(x)` for particles in space.  A system is represented in one of three ways:

- `CENTRAL`: :math:`H = |p|^2/(2m) - m\mu/|q| + U(q)` with a declared Kepler part is a massless particle around a body
  of mass :math:`\mu` at rest in the origin, with the extra force :math:`-\nabla U`;
- `GRAVITY`: :math:`H = \sum_i |p_i|^2/(2m_i) - \sum_{i<j} G m_i m_j/|q_i - q_j|` is N bodies under REBOUND's own
  gravity, in the frame of the data;
- `POTENTIAL`: any :math:`H = \sum_i p_i^2/(2m_i) + V(q)` is :math:`\lceil d/3 \rceil` massless particles whose
  coordinates, three by three, are q (unused ones stay 0), with the extra force :math:`-V_{q_i}/m_i`.

Extra forces are compiled by Numba to C callbacks, since a Python callback would cost far more than the step.

Source: H. Rein, S.-F. Liu, Astron. Astrophys. 537 (2012) A128.
"""

from __future__ import annotations

import ctypes
import time
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations, pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from . import floating, interrupts
from .record import Run, Start, Task

if TYPE_CHECKING:
    import rebound
    import sympy as sp

    from phasebench.integrators.systems.hamiltonian import PartitionedSystem

    from .prepared import Calls

#: Distance from the origin beyond which a body has escaped.
FAR = 1e12

CENTRAL, GRAVITY, POTENTIAL = "a central body", "gravity between bodies", "a potential"


@dataclass(frozen=True)
class Setting:
    """The representation of a system by REBOUND's particles.

    Attributes
    ----------
    kind : `CENTRAL`, `GRAVITY` or `POTENTIAL`
    masses : of the particles, including the body at rest
    dimension : number of coordinates of the system per particle
    first : index of the particle with the first coordinates
    inverse : d numbers; the velocity of q_i is inverse[i] p_i
    G : the gravitational constant
    gradient : () -> the compiled gradient of the extra potential, a function q -> (d,); None without extra force
    """

    kind: str
    masses: tuple[float, ...]
    dimension: int
    first: int
    inverse: tuple[float, ...]
    G: float = 1.0
    gradient: Callable | None = None

    def place(self, i: int) -> tuple[int, int]:
        """Where coordinate i is among the particles: (index of the particle, axis 0, 1 or 2)."""
        return self.first + i // self.dimension, i % self.dimension


def _mass_and_terms(system: PartitionedSystem) -> tuple[tuple[sp.Expr | int, ...], list[sp.Expr]] | None:
    """(the exact numbers 1/m_i, the terms of V) of H = sum p_i^2 / (2 m_i) + V(q); None for other forms of H."""
    import sympy as sp

    if not system.quadratic_kinetic:
        return None
    if not isinstance(system.H, sp.Basic):  # a system given by hand-written loops, without a formula
        return ((1,) * system.d, []) if system.unit_mass else None
    momenta, coordinates, T, V = set(system.p), set(system.q), [], []
    for term in sp.Add.make_args(system.H):
        for part in sp.Add.make_args(sp.expand(term) if term.free_symbols & momenta else term):
            (T if part.free_symbols & momenta else V).append(part)
    if any(t.free_symbols & coordinates for t in T):
        return None
    double = sp.Poly(2 * sp.Add(*T), *system.p).as_dict()
    inverse = tuple(double.pop(tuple(int(x == y) * 2 for y in system.p), 0) for x in system.p)
    return None if double or 0 in inverse else (inverse, V)


def attracting(system: PartitionedSystem) -> tuple[list[sp.Expr], sp.Expr, int] | None:
    """(masses, G, dimension), exact, of a system of gravitating bodies; None for other systems."""
    split = _mass_and_terms(system)
    return None if split is None else _bodies(system.q, *split)


@lru_cache(maxsize=64)
def settings(system: PartitionedSystem) -> dict[str, Setting]:
    """The possible representations of a system by REBOUND's particles: kind -> `Setting`, most special kind first."""
    import sympy as sp

    split = _mass_and_terms(system)
    if split is None:
        return {}
    inverse, terms = split
    numbers, fitting = tuple(map(float, inverse)), {}
    part = system.kepler
    if part is not None and len(part.masses) == 1 and not part.change and part.mu[0] > 0:
        rest = sp.Add(*terms) - part.potential(system.q)
        gradient = (lambda: part.interaction(system)) if rest != 0 else None
        fitting[CENTRAL] = Setting(CENTRAL, (float(part.mu[0]), 0.0), part.dimension, 1, numbers, gradient=gradient)
    bodies = _bodies(system.q, inverse, terms)
    if bodies is not None:
        masses, G, dimension = bodies
        fitting[GRAVITY] = Setting(GRAVITY, tuple(map(float, masses)), dimension, 0, numbers, float(G))
    fitting[POTENTIAL] = Setting(POTENTIAL, (0.0,) * -(-system.d // 3), 3, 0, numbers, gradient=system.grad_V)
    return fitting


def _bodies(
    q: Sequence[sp.Symbol], inverse: Sequence[sp.Expr | int], terms: Sequence[sp.Expr]
) -> tuple[list[sp.Expr], sp.Expr, int] | None:
    """(masses, G, dimension) of gravitating bodies; None if the potential is not that of their gravity.

    ``q`` are the coordinates, ``inverse`` the numbers 1/m_i, one for each of them, and ``terms`` the terms of V.
    """
    for dimension in (3, 2):
        n, left = divmod(len(q), dimension)
        rows = [set(inverse[i * dimension : (i + 1) * dimension]) for i in range(n)]
        if left or n < 2 or any(len(row) > 1 for row in rows) or len(terms) != n * (n - 1) // 2:
            continue
        masses = [1 / row.pop() for row in rows]
        where = [q[i * dimension : (i + 1) * dimension] for i in range(n)]
        pairs = {_squares(zip(where[i], where[j], strict=True)): (i, j) for i, j in combinations(range(n), 2)}
        G = set()
        for term in terms:
            strength, rest = term.as_independent(*q, as_Add=False)
            i, j = pairs.pop(_differences(rest), (None, None))
            if i is None:
                break
            G.add(-strength / (masses[i] * masses[j]))
        if not pairs and len(G) == 1 and min(*masses, *G) > 0:
            return masses, G.pop(), dimension
    return None


def _squares(pairs: Iterable[tuple[sp.Expr, sp.Expr]]) -> frozenset:
    """A key for the sum of (a - b)^2 over pairs (a, b), which does not depend on the signs of the differences."""
    return frozenset(frozenset((a - b, b - a)) for a, b in pairs)


def _differences(e: sp.Expr) -> frozenset | None:
    """The key, as from `_squares`, of the sum of squares in an inverse distance; None for other expressions."""
    if not (e.is_Pow and 2 * e.exp == -1 and all(s.is_Pow and s.exp == 2 for s in e.base.args)):
        return None
    return frozenset(frozenset((s.base, -s.base)) for s in e.base.args)


@lru_cache(maxsize=64)
def extra_force(setting: Setting) -> Any:
    """The compiled callback that subtracts grad U / m from the accelerations; it must live as long as REBOUND runs."""
    from numba import cfunc, types
    from rebound import Particle, Simulation

    from phasebench.integrators.compile.codegen import value_kind

    # The simulation and its particles are read as arrays of 8-byte slots, so no structure has to be declared.
    particles, size = Simulation._particles.offset // 8, ctypes.sizeof(Particle) // 8
    d, inverse = len(setting.inverse), np.array(setting.inverse)
    at = np.array([k * size + Particle.x.offset // 8 + axis for k, axis in map(setting.place, range(d))])
    to = at + (Particle.ax.offset - Particle.x.offset) // 8
    space = {"gradient": setting.gradient(), "inverse": inverse, "at": at, "to": to, "d": d, "np": np}
    lines = [f"def force(simulation):\n  body = simulation[{particles}]"]
    if value_kind(d) == "tuple":
        lines.append(f"  g = gradient(({', '.join(f'body[{i}]' for i in at)},))")
        lines += [f"  body[{i}] -= inverse[{k}] * g[{k}]" for k, i in enumerate(to)]
    else:
        lines.append("  q = np.empty(d)\n  for i in range(d):\n    q[i] = body[at[i]]\n  g = gradient(q)")
        lines.append("  for i in range(d):\n    body[to[i]] -= inverse[i] * g[i]")
    exec("\n".join(lines), space)
    pointer = types.CPointer(types.CPointer(types.float64))
    return cfunc(types.void(pointer), error_model="numpy")(space["force"])


def build(
    setting: Setting,
    q0: Sequence[float] | np.ndarray,
    p0: Sequence[float] | np.ndarray,
    integrator: str,
    options: Mapping[str, Any] | Sequence[tuple[str, Any]] = (),
    extra: bool = True,
) -> tuple[rebound.Simulation, Any]:
    """Make a REBOUND simulation of a setting: (simulation, callback of the extra force, to be kept alive, or None).

    ``q0`` and ``p0`` are the initial state, ``integrator`` is REBOUND's name of an integrator and ``options`` are its
    fields; the extra force is left out unless ``extra``.
    """
    import rebound

    sim = rebound.Simulation()
    choose(sim, integrator, options)
    sim.G, masses = setting.G, setting.masses
    if integrator == "whfast512":  # it supports only G = 1, and no exact end time
        sim.G, masses, sim.exact_finish_time = 1.0, [setting.G * m for m in masses], 0
    if setting.kind == POTENTIAL and integrator != "eos":  # EOS has its own gravity, which massless bodies do not feel
        sim.gravity = "none"
    where, velocity = np.zeros((2, len(masses), 3))
    for i, (x, v) in enumerate(zip(q0, np.multiply(p0, setting.inverse), strict=True)):
        where[setting.place(i)], velocity[setting.place(i)] = x, v
    for m, (x, y, z), (vx, vy, vz) in zip(masses, where.tolist(), velocity.tolist(), strict=True):
        sim.add(m=m, x=x, y=y, z=z, vx=vx, vy=vy, vz=vz)
    force = None
    if extra and setting.gradient is not None:
        force = extra_force(setting)
        sim.additional_forces = force.address
    return sim, force


def choose(sim: rebound.Simulation, integrator: str, options: Mapping[str, Any] | Sequence[tuple[str, Any]]) -> None:
    """Set a simulation's integrator and its fields; the state of the previous integrator is dropped."""
    sim.integrator = integrator
    for name, value in dict(options).items():
        setattr(sim.integrator, name, value)


def simulation(
    problem: Any,
    q0: Sequence[float] | np.ndarray,
    p0: Sequence[float] | np.ndarray,
    integrator: str,
    mu: float = 0.0,
    **options: Any,
) -> tuple[rebound.Simulation, Any]:
    """Make a REBOUND simulation of a (perturbed) Kepler problem: (simulation, callback to be kept alive, or None).

    ``integrator`` is REBOUND's name of an integrator, ``options`` are its fields.  The callback computes the extra
    force, that of the perturbation; ``mu`` is the strength of the perturbation, and at 0 the force is left out.
    """
    return build(settings(problem.system)[CENTRAL], q0, p0, integrator, options, bool(mu))


def jacobi_vanishes(setting: Setting, q: Sequence[float] | np.ndarray) -> int | None:
    """The index of the first body that is in the centre of mass of the bodies before it; None if there is none.

    Its Jacobi coordinate, the vector from that centre, is 0, where REBOUND's Wisdom-Holman splittings are singular.
    """
    where = np.zeros((len(setting.masses), 3))
    for i, x in enumerate(q):
        where[setting.place(i)] = x
    for k in range(1, len(where)):
        centre = np.average(where[:k], axis=0, weights=setting.masses[:k])
        if np.abs(where[k] - centre).max() <= 1e-14 * np.abs(where).max():
            return k
    return None


def state(sim: rebound.Simulation, setting: Setting) -> np.ndarray:
    """The state (q, p) of a REBOUND simulation, array (2 d,)."""
    d = len(setting.inverse)
    x, v = np.empty((2, sim.N, 3))
    sim.serialize_particle_data(xyz=x, vxvyvz=v)
    at = tuple(zip(*map(setting.place, range(d)), strict=True))
    return np.concatenate([x[at], v[at] / setting.inverse])


def prepare(
    start: Start, setting: Setting, integrator: str, options: Mapping[str, Any], *, adaptive: bool, shortest: float
) -> Calls:
    """The `Calls` of a prepared simulation: ``advance(t_end)`` if ``adaptive``, else ``advance(h, steps)``.

    Each call of it first resets the particles, the time and the step.  IAS15 and BS keep across a reset what they
    predicted from their last step, which is as good a first guess as any; JANUS computes with integers of its own,
    which are dropped by setting the integrator anew.  ``options`` are fields of the integrator; ``shortest`` is the
    least step of IAS15 as a share of the span.
    """
    import rebound

    from .prepared import SOLVED, STALLED, Calls

    sim, force = build(setting, start.q, start.p, integrator, options)
    if adaptive:
        sim.exit_max_distance = FAR
    d, inverse, first = len(setting.inverse), np.array(setting.inverse), sim.dt
    at = tuple(zip(*map(setting.place, range(d)), strict=True))
    begin = np.zeros((sim.N, 6))
    sim.serialize_particle_data(xyzvxvyvz=begin)
    put, address = rebound.clibrebound.reb_simulation_set_serialized_particle_data, ctypes.byref(sim)
    array = begin.ctypes.data_as(ctypes.POINTER(ctypes.c_double))
    known: list[float | None] = [None]  # the span or number of steps for which the simulation is configured

    def restart(y: np.ndarray) -> None:
        begin[:, :3][at], begin[:, 3:][at] = y[:d], y[d:] * inverse

    def reset(dt: float) -> None:
        if integrator == "janus":
            choose(sim, integrator, options)
        sim.t, sim.dt = 0.0, dt
        put(address, None, None, None, None, array)
        sim.did_modify_particles = 1

    def adaptively(t_end: float) -> int:
        if known[0] != t_end:
            known[0] = t_end
            if integrator == "ias15":
                sim.integrator.min_dt = shortest * abs(t_end)
        reset(first if t_end > 0 else -first)
        before = interrupts.handler()
        try:
            sim.integrate(t_end)
        except (RuntimeError, rebound.Escape):
            return STALLED
        finally:
            interrupts.put_back(before)
        return SOLVED

    def evenly(h: float, steps: int) -> int:
        reset(h)
        if integrator == "whfast512" and known[0] != steps:  # one call of step makes this number of steps
            known[0] = sim.integrator.concatenate_steps = steps
        try:
            sim.steps(1 if integrator == "whfast512" else steps)
            sim.synchronize()
        except (RuntimeError, rebound.Escape):
            return STALLED
        return SOLVED

    advance = adaptively if adaptive else evenly
    if integrator == "whfast512":
        advance = floating.keeping(advance)
    return Calls(restart, advance, lambda: state(sim, setting), (sim, force))


def run(
    task: Task, setting: Setting, integrator: str, options: Mapping[str, Any], *, adaptive: bool, limit: float = np.inf
) -> Run:
    """Integrate a task by REBOUND; the ``seconds`` of the result are those spent in REBOUND.

    ``setting`` represents the task's problem by REBOUND's particles; ``options`` are fields of the integrator.
    Adaptive integrators stop at the times of the rows; the others take the exact number of steps of h, without summing
    times.  Coordinates and velocities beyond ``limit`` end the run.
    """
    import rebound

    sim, force = build(setting, task.q, task.p, integrator, options)
    if adaptive:
        sim.exit_max_distance = FAR  # if a body escapes in a finite time, steps would shrink without end
    else:
        sim.dt = task.h
    d = len(setting.inverse)
    rows = np.empty((len(task.numbers), 2 * d))
    rows[0] = task.state
    spent, reached, failure = 0.0, 1, None
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        for row, (before, n) in enumerate(pairwise(map(int, task.numbers)), start=1):
            started = time.perf_counter()
            try:
                _advance(sim, integrator, task.h, before, n, adaptive)
            except RuntimeError as error:
                failure = str(error)
                break
            except rebound.Escape:
                failure = f"a body is farther away than {FAR:g}"
                break
            spent += time.perf_counter() - started
            rows[row] = state(sim, setting)
            if not np.isfinite(rows[row]).all():
                failure = str(warned[-1].message) if warned else None
                break
            if max(np.abs(rows[row, :d]).max(), np.abs(rows[row, d:] * setting.inverse).max()) > limit:
                failure = f"a coordinate or velocity is beyond {limit:.4g}"
                break
            reached = row + 1
    del force  # not earlier: the simulation holds only its address
    steps = int(sim.steps_done) if adaptive else int(task.numbers[reached - 1])
    return Run.of_states(rows[:reached], steps, 0, spent, failure)


def _advance(sim: rebound.Simulation, integrator: str, h: float, before: int, n: int, adaptive: bool) -> None:
    """Advance a REBOUND simulation from step ``before`` to step n of length h; to the time n h if ``adaptive``."""
    if adaptive:
        taken = interrupts.handler()
        try:
            sim.integrate(h * n)
        finally:
            interrupts.put_back(taken)
        return
    if integrator == "whfast512":  # one call of step makes this number of steps
        sim.integrator.concatenate_steps = n - before
        sim.steps(1)
    else:
        sim.steps(n - before)
    sim.synchronize()
