r"""Quantities whose errors are measured on particular problems, such as the perihelion or the adiabatic invariant.

``perihelion`` is the direction of the Laplace-Runge-Lenz vector :math:`A = p\times L - q/|q|`; ``phase`` an orbit's
polar angle; a planet's longitude is relative to the Sun.  ``section`` is the point where the orbit, continued from the
end without further error, next meets q1 = 0 with p1 > 0; it contains the error across the orbit, not that along it.
``adiabatic-invariant`` is the oscillatory energy of the stiff springs in a Fermi-Pasta-Ulam chain.  For chaotic orbits,
whose late states are not reproducible: ``average`` is the time average of the kinetic energy divided by the sum of the
absolute terms of H, and ``lyapunov`` the largest Lyapunov exponent over the span.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
import sympy as sp

from phasebench.integrators.errors import unknown_name

from . import lyapunov
from .body_quantities import of_bodies, position
from .quantities import ENERGY, GENERAL, PARTS, Quantity, scale
from .transits import of_planets

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem
    from phasebench.integrators.systems.hamiltonian import PartitionedSystem

#: Number of rows for an average and an exponent.
AVERAGED = 4000
#: Longest continuation of the flow to the section, in the problem's unit of time.
FAR = 100.0


def _angle(y: Callable, x: Callable, name: str, about: str) -> Quantity:
    """The angle of the direction (x, y) at the end; x and y are functions of (problem, q, p)."""

    def values(problem: Problem, t: np.ndarray, q: np.ndarray, p: np.ndarray) -> np.ndarray:
        return np.arctan2(y(problem, q[-1:], p[-1:]), x(problem, q[-1:], p[-1:]))

    return Quantity(name, about, "rad", values, angle=True)


def _polar(name: str, about: str) -> Quantity:
    return _angle(lambda problem, q, p: q[:, 1], lambda problem, q, p: q[:, 0], name, about)


def _laplace(component: int) -> Callable[[Problem, np.ndarray, np.ndarray], np.ndarray]:
    def value(problem: Problem, q: np.ndarray, p: np.ndarray) -> np.ndarray:
        L = q[:, 0] * p[:, 1] - q[:, 1] * p[:, 0]
        r = np.hypot(q[:, 0], q[:, 1])
        return (p[:, 1] * L if component == 0 else -p[:, 0] * L) - q[:, component] / r

    return value


PERIHELION = _angle(_laplace(1), _laplace(0), "perihelion", "the direction of the osculating perihelion at the end")
PHASE = _polar("phase", "the polar angle of the position at the end")
DRIFT_ANGLE = _polar("drift-angle", "the polar angle of the particle about the origin at the end")
AZIMUTH = Quantity("azimuth", "the angle phi, all turns, at the end", "rad", lambda problem, t, q, p: q[-1, 2:3])


def _rotation(problem: Problem, t: np.ndarray, q: np.ndarray, p: np.ndarray) -> np.ndarray:
    omega = float(problem.system.frequencies[0])
    return np.arctan2(-p[-1:, 0], omega * q[-1:, 0])


ROTATION = Quantity("phase", "the angle of (q, -p / omega) at the end", "rad", _rotation, angle=True)


def _longitude(name: str, body: int) -> Quantity:
    return _angle(
        lambda problem, q, p: position(problem, body, q, p)[:, 1],
        lambda problem, q, p: position(problem, body, q, p)[:, 0],
        f"{name}-longitude",
        f"the longitude of {name} about the Sun, in the plane of coordinates, at the end",
    )


def _oscillatory(problem: Problem, t: np.ndarray, q: np.ndarray, p: np.ndarray) -> np.ndarray:
    from phasebench.benchmarks.problems.fpu import oscillatory_energies

    total = sum(problem.system.observe(e, q, p) for e in oscillatory_energies(problem))
    return total[1:] / total[0]


ADIABATIC = Quantity(
    "adiabatic-invariant",
    f"the oscillatory energy at {PARTS} equidistant times in units of the first, the worst",
    "relative",
    _oscillatory,
    rows=PARTS,
)


@lru_cache(maxsize=16)
def _section_flow(system: PartitionedSystem) -> Any:
    import heyoka as hy

    from phasebench.reference.solvers import taylor

    plain = taylor.integrator(system, float)
    event = hy.t_event(plain.sys[0][0], direction=hy.event_direction.positive)
    return hy.taylor_adaptive(plain.sys, np.zeros(2 * system.d), t_events=[event])


def _section(problem: Problem, t: np.ndarray, q: np.ndarray, p: np.ndarray) -> np.ndarray:
    from phasebench.reference.solvers import taylor

    flow = _section_flow(problem.system)
    flow.reset_cooldowns()
    taylor.start(flow, float, q[-1], p[-1])
    flow.propagate_until(FAR)
    if abs(flow.state[0]) > 1e-9:
        return np.full(2 * problem.system.d - 1, np.nan)
    return np.array(flow.state[1:])


SECTION = Quantity(
    "section",
    "where the orbit, followed from the end without further error, next meets q1 = 0 with p1 > 0, max norm",
    "as (q, p)",
    _section,
)


def _average(problem: Problem, t: np.ndarray, q: np.ndarray, p: np.ndarray) -> np.ndarray:
    T = problem.system.observe(kinetic(problem), q, p)
    return np.array([np.trapezoid(T, t) / (t[-1] - t[0]) / scale(problem)])


def kinetic(problem: Problem) -> sp.Expr:
    """Return the sum of the terms of a problem's H that contain momenta, as an expression."""
    momenta = set(problem.system.p)
    return sp.Add(*(e for e in sp.Add.make_args(sp.expand(problem.system.H)) if e.free_symbols & momenta))


AVERAGE = Quantity(
    "average",
    "the average of the kinetic energy over time, in units of the sum of the sizes of H's terms at the start",
    "relative",
    _average,
    rows=AVERAGED,
    aligned=False,
    statistical=True,
)
EXPONENT = Quantity(
    "lyapunov",
    "the largest Lyapunov exponent over the span",
    "1 / time",
    lambda problem, t, q, p: np.array([lyapunov.exponent(problem.system, t, q, p)]),
    rows=AVERAGED,
    aligned=False,
    statistical=True,
)
PLANETS = ("jupiter", "saturn", "uranus", "neptune", "pluto")
#: Problem, or problem:orbit -> its own quantities.
NAMED: dict[str, tuple[Quantity, ...]] = {
    "harmonic-oscillator": (ROTATION,),
    "kepler": (PHASE, PERIHELION),
    "perturbed-kepler": (PHASE, PERIHELION),
    "schwarzschild": (AZIMUTH,),
    "charged-particle": (DRIFT_ANGLE,),
    "outer-solar-system": tuple(_longitude(name, k) for k, name in enumerate(PLANETS, start=1)),
    "fpu": (ADIABATIC, AVERAGE),
    "henon-heiles": (SECTION,),
    "henon-heiles:chaotic": (AVERAGE, EXPONENT),
    "double-pendulum:chaotic": (EXPONENT,),
    "lennard-jones": (AVERAGE,),
}


def problem_quantities(problem: Problem) -> Iterator[Quantity]:
    """Yield the quantities special to a problem: those of all its orbits, of its chosen orbit, and of its bodies."""
    id, label = getattr(problem, "id", ""), getattr(problem, "label", "")
    yield from NAMED.get(id, ())
    if label != id:
        yield from NAMED.get(label, ())
    yield from of_bodies(problem)
    yield from of_planets(problem)


def quantities(problem: Problem) -> Mapping[str, Quantity]:
    """Return name -> quantity for a problem: end state, trajectory and energy, then those special to the problem."""
    general = [x for x in GENERAL if x is not ENERGY or getattr(problem.system, "H", None) is not None]
    return {x.name: x for x in (*general, *problem_quantities(problem))}


def quantity(problem: Problem, name: str) -> Quantity:
    """Return the quantity of a problem with this name; raise InvalidInput, with the nearest known name, if unknown."""
    known = quantities(problem)
    if name not in known:
        raise unknown_name(f"quantity of '{getattr(problem, 'label', problem)}'", name, known)
    return known[name]
