r"""The time to a planet's transit, ``b.transit`` of a table of bodies, for an observer far out on the z axis.

A planet is in transit where f + omega is 90 degrees on its osculating orbit about the central body, as at the time T0
of a table of bodies (`benchmarks.problems.elements`).  There the latitude of its direction is at its maximum: with
position and velocity relative to the central body,

.. math:: \dot z\,(x^2 + y^2) - z\,(x\dot x + y\dot y)

falls through zero.  An orbit in the plane of coordinates has no node; Omega is then 0, so that x falls through zero.

The time is counted from the end of a span, of t_end, so that t_end + ``b.transit`` is T0 and some periods.

Source: J. N. Winn, in Exoplanets (2010) 55-77.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from .quantities import Quantity

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem
    from phasebench.benchmarks.problems.planetary import PlanetarySystem
    from phasebench.integrators.systems.hamiltonian import PartitionedSystem

SPACE = 3
#: Share of a period after the end from which a transit is looked for.  It is no simple fraction, as spans are often
#: whole or half periods after a transit: two solutions would find different transits if one fell on the edge.
AFTER = 0.62
#: Number of periods in which it is looked for, and the most steps of heyoka's integrator in them.
PERIODS, STEPS = 3.0, 100_000
#: Sine of an inclination that differs from 0 by rounding alone.
FLAT = 1e-9


def of_planets(problem: Problem) -> Iterator[Quantity]:
    """Yield the `Quantity` b.transit of every body of a problem but the central one; none without bodies."""
    found = getattr(problem, "bodies", None)
    for body, name in enumerate(found.names if found is not None else ()):
        if body:
            about = f"the time from the end to the first transit of {name} after {AFTER:g} periods"
            yield Quantity(f"{name}.transit", about, "time", partial(transit, body))


def transit(body: int, problem: PlanetarySystem, t: np.ndarray, q: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Return the time from the last row to the first transit of a body after `AFTER` periods: array (1,).

    The orbit of all bodies is followed from the last row by heyoka, without further error; bodies whose position is NaN
    are left out.  The period is that of the osculating orbit at the problem's start.  NaN if there is no transit within
    `PERIODS`, or no period.
    """
    from phasebench.reference.solvers import taylor

    masses = np.array(problem.bodies.masses)
    period = _period(problem, masses, body)
    absent = np.isnan(q[-1].reshape(-1, SPACE)).any(axis=1)
    if not period < np.inf or absent[[0, body]].any():
        return np.full(1, np.nan)
    if absent.any():
        names = np.array(problem.bodies.names)
        problem, body = problem.without(*names[absent]), int(np.sum(~absent[:body]))
        keep = np.repeat(~absent, SPACE)
        q, p, masses = q[:, keep], p[:, keep], masses[~absent]
    x, v = _relative(q[-1], p[-1], masses, body)
    L = np.cross(x, v)
    flat = bool(np.hypot(L[0], L[1]) < FLAT * abs(L[2]))
    flow, found = _flow(problem.system, tuple(masses.tolist()), body, flat)
    taylor.start(flow, float, q[-1], p[-1])
    flow.propagate_until(AFTER * period, max_steps=STEPS)
    found.clear()
    flow.propagate_until(PERIODS * period, max_steps=STEPS, callback=lambda _: not found)
    return np.array(found[:1] or [np.nan])


@lru_cache(maxsize=16)
def _flow(system: PartitionedSystem, masses: tuple[float, ...], body: int, flat: bool) -> tuple[Any, list[float]]:
    """heyoka's integrator of ``system``, and the list to which it appends the times of transits of ``body``."""
    import heyoka as hy

    from phasebench.reference.solvers import taylor

    motion = taylor.equations(system, float)
    variables = [variable for variable, _ in motion]
    x, v = _relative(*np.split(np.array(variables, dtype=object), 2), masses, body)
    crossed = x[0] if flat else v[2] * (x[0] ** 2 + x[1] ** 2) - x[2] * (x[0] * v[0] + x[1] * v[1])
    found: list[float] = []
    event = hy.nt_event(crossed, callback=lambda flow, t, sign: found.append(t), direction=hy.event_direction.negative)
    compact = len(motion) > taylor.COMPACT
    return hy.taylor_adaptive(motion, np.zeros(len(motion)), nt_events=[event], compact_mode=compact), found


def _period(problem: PlanetarySystem, masses: np.ndarray, body: int) -> float:
    """The period of the osculating orbit at the start; infinite if it is not bound."""
    mu = problem.bodies.units.G * (masses[0] + masses[body])
    x, v = _relative(np.array(problem.q0), np.array(problem.p0), masses, body)
    inverse = 2 / np.linalg.norm(x) - v @ v / mu  # of the semi-major axis
    return 2 * np.pi / np.sqrt(mu * inverse**3) if inverse > 0 else np.inf


def _relative(q: Any, p: Any, masses: Any, body: int) -> tuple[Any, Any]:
    """Position and velocity of a body relative to the central one, arrays (3,) of numbers or expressions."""
    at = slice(SPACE * body, SPACE * (body + 1))
    return q[at] - q[:SPACE], p[at] / masses[body] - p[:SPACE] / masses[0]
