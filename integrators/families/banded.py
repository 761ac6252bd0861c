"""The one-stage methods of `parametric`, their equations solved by Newton's method in a narrow band: for lattices.

The same equations in the same forms, to the same round-off; only how they are solved differs (`engine.banded`).  Which
unknown acts on which is found when a system is prepared (`engine.structure`).  Every substep keeps a matrix of its own.
Where nothing is implicit the method is that of `parametric`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from phasebench.integrators.engine import structure
from phasebench.integrators.engine.banded import Band, Room, band_of, band_solver, columns, forget
from phasebench.integrators.engine.codegen import DOUBLE
from phasebench.integrators.engine.kernel import Prepared, value
from phasebench.integrators.engine.solve import SOLVED, lengths_of_both
from phasebench.integrators.engine.vector import (
    advanced,
    chosen,
    close,
    head,
    inlined,
    keep,
    opened,
    size,
    tail,
    velocity,
)

from . import parametric
from .parametric import Stage, increments, kick, lengths_of_kick, shift, unknown

#: h and lambda at which a field of higher order is probed, and the seed of the states.
AT, SEED = (0.1, 1 / 3), 3


class Banded(NamedTuple):
    """The fields of `parametric.Parametric`, and the band of the equations."""

    field: Callable | None
    dT: Callable | None
    dV: Callable | None
    c: np.ndarray
    mu: np.ndarray
    lam: np.ndarray
    band: Band
    h: float = 0.0
    eps: float = 0.0


solve_increments, solve_kick = band_solver(increments, lengths_of_both), band_solver(kick, lengths_of_kick)


def _nystrom(field, step, y, c, mu, lam, x, room):
    stage = Stage(step, y.q, y.p, velocity(step.dT, y.p), c * step.h, mu, lam)
    x, n, status = solve_kick(stage, x, size(y.q) + size(y.p), step.eps, step.band, room)
    return advanced(y, shift(x, stage), x), n, status


def _general(field, step, y, c, mu, lam, x, room):
    stage = Stage(step, y.q, y.p, y.p, c * step.h, mu, lam)
    x, n, status = solve_increments(stage, x, size(y.q) + size(y.p), step.eps, step.band, room)
    return advanced(y, head(x), tail(x)), n, status


#: One substep from the start x of its equation; (field, step, y, c, mu, lam, x, room) -> (y, evaluations, status).
substep = chosen(_nystrom, _general)


@inlined
def advance(step, y, orbit):
    """One step; returns (y, evaluations, status)."""
    start = unknown(step.field, orbit.zero)
    evaluations, status = 0, SOLVED
    for s in range(len(step.c)):
        room = Room(orbit.memory, 0, orbit.work, s * len(start))
        y, n, status = substep(step.field, step, y, step.c[s], step.mu[s], step.lam[s], start, room)
        evaluations += n
        if status != SOLVED:
            break
    return y, evaluations, status


def run(step, orbit, samples, counts):
    """The kernel."""
    y = opened(orbit)
    if counts.steps == 0:  # what is in the memory may be of another h
        for s in range(len(step.c)):
            forget(orbit.work, s * len(unknown(step.field, orbit.zero)), columns(step.band))
    for row in range(len(samples.q)):
        for _ in range(samples.every):
            y, n, status = advance(step, y, orbit)
            counts.gradient += n
            counts.newton += len(step.c)
            if status != SOLVED:
                return row, status
            counts.steps += 1
        keep(samples, row, y)
    close(orbit, y)
    return len(samples.q), SOLVED


def structure_of(system, order: int) -> list[np.ndarray]:
    """Of each unknown the stage equations that it acts on; raises InvalidInput where that cannot be found."""
    (field, dT, dV), n = parametric.quadratic(system, DOUBLE, order)
    d = system.d

    def slope(x):
        if field is None:
            x = value(x, d)
            return np.array(dV(x if dT is None else dT(x)), float)
        return np.concatenate([np.array(z, float) for z in field(value(x[:d], d), value(x[d:], d), *AT)])

    rng = np.random.default_rng(SEED)
    return structure.found(slope, [rng.normal(size=n) / 10, rng.uniform(0.5, 1.5, size=n), rng.normal(size=n) * 10])


def prepare(method, system, arithmetic):
    """The step of `parametric` with the band of the system's equations."""
    plain = parametric.prepare(method, system, arithmetic)
    if plain.run is not parametric.run:  # explicit: there is nothing to solve
        return plain
    band = band_of(structure_of(system, method.data[0]))
    step = Banded(**{name: x for name, x in plain.step._asdict().items() if name in Banded._fields}, band=band)
    work = (plain.stages * plain.width, columns(band))
    return Prepared(run, step, plain.width, plain.stages, hessian=plain.hessian, work=work)
