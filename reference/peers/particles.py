"""Runs of REBOUND's particles, which represent a system as `forms.settings` says, through its public Python interface.

Extra forces are compiled by Numba to C callbacks, since a Python callback would cost far more than the step.

Source: H. Rein, S.-F. Liu, Astron. Astrophys. 537 (2012) A128.
"""

from __future__ import annotations

import ctypes
import warnings
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from . import floating, interrupts
from .forms import POTENTIAL, Setting
from .record import NOT_FINITE, SOLVED, STALLED, Calls, Run, Task
from .run import by_rows

if TYPE_CHECKING:
    import rebound

#: Distance from the origin beyond which a body has escaped; if one does so in a finite time, steps shrink without end.
FAR = 1e12
#: Unit (the default) in which JANUS rounds coordinates and velocities to 64-bit integers, and what these can hold.
UNIT = 1e-16
LARGEST = 2.0**62 * UNIT
#: Least step of IAS15 as a share of the time span: if the acceleration of a body passes through 0, steps would shrink
#: in proportion to the time left, and the run would never end (figure eight).
SHORTEST = 1e-13


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
    where[setting.places], velocity[setting.places] = q0, np.multiply(p0, setting.inverse)
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


def jacobi_vanishes(setting: Setting, q: Sequence[float] | np.ndarray) -> int | None:
    """The index of the first body that is in the centre of mass of the bodies before it; None if there is none.

    Its Jacobi coordinate, the vector from that centre, is 0, where REBOUND's Wisdom-Holman splittings are singular.
    """
    where = np.zeros((len(setting.masses), 3))
    where[setting.places] = q
    for k in range(1, len(where)):
        centre = np.average(where[:k], axis=0, weights=setting.masses[:k])
        if np.abs(where[k] - centre).max() <= 1e-14 * np.abs(where).max():
            return k
    return None


def state(sim: rebound.Simulation, setting: Setting) -> np.ndarray:
    """The state (q, p) of a REBOUND simulation, array (2 d,)."""
    x, v = np.empty((2, sim.N, 3))
    sim.serialize_particle_data(xyz=x, vxvyvz=v)
    return np.concatenate([x[setting.places], v[setting.places] / setting.inverse])


def prepare(task: Task, setting: Setting, integrator: str, options: Mapping[str, Any], adaptive: bool) -> Calls:
    """The `Calls` of a prepared simulation: ``advance(t_end)`` if ``adaptive``, else ``advance(h, steps)``.

    Each call of it first resets the particles, the time and the step.  IAS15 and BS keep across a reset what they
    predicted from their last step, which is as good a first guess as any; JANUS computes with integers of its own,
    which are dropped by setting the integrator anew.  ``options`` are fields of the integrator.
    """
    import rebound

    sim, force = build(setting, task.q, task.p, integrator, options)
    if adaptive:
        sim.exit_max_distance = FAR
    d, inverse, first = len(setting.inverse), np.array(setting.inverse), sim.dt
    at, begin = setting.places, np.zeros((sim.N, 6))
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
                sim.integrator.min_dt = SHORTEST * abs(t_end)
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
        advance = floating.restore_environment()(advance)
    return Calls(restart, advance, lambda: state(sim, setting), (sim, force))


def run(task: Task, setting: Setting, integrator: str, options: Mapping[str, Any], adaptive: bool) -> Run:
    """Integrate a task by REBOUND; the ``seconds`` of the result are those spent in REBOUND.

    ``setting`` represents the task's problem by REBOUND's particles; ``options`` are fields of the integrator.
    Adaptive integrators stop at the times of the rows; the others take the exact number of steps of h, without summing
    times.
    """
    import rebound

    sim, force = build(setting, task.q, task.p, integrator, options)
    if adaptive:
        sim.exit_max_distance = FAR
    else:
        sim.dt = task.h
    if integrator == "ias15":
        sim.integrator.min_dt = SHORTEST * abs(task.h * task.steps)

    def advance(i: int, n: int) -> str | None:
        try:
            if adaptive:
                taken = interrupts.handler()
                try:
                    sim.integrate(task.h * task.numbers[i])
                finally:
                    interrupts.put_back(taken)
                return None
            if integrator == "whfast512":  # one call of step makes this number of steps
                sim.integrator.concatenate_steps, n = n, 1
            sim.steps(n)
            sim.synchronize()
        except RuntimeError as error:
            return str(error)
        except rebound.Escape:
            return f"a body is farther away than {FAR:g}"
        return None

    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        found = by_rows(task, advance, lambda: state(sim, setting))
    del force  # not earlier: the simulation holds only its address
    if found.failure == NOT_FINITE and warned:
        found = found._replace(failure=str(warned[-1].message))
    if integrator == "janus":
        beyond = np.maximum(np.abs(found.q), np.abs(found.p * setting.inverse)).max(axis=1) > LARGEST
        beyond[0] = False  # the start is a row
        if beyond.any():
            failure, n = f"a coordinate or velocity is beyond {LARGEST:.4g}", int(beyond.argmax())
            found = found._replace(q=found.q[:n], p=found.p[:n], failure=failure)
    return found._replace(steps=int(sim.steps_done) if adaptive else int(task.numbers[len(found.q) - 1]))
