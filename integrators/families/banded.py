"""One-stage methods with a parameter (those of `parametric`) with banded Newton iterations, for lattices of many sites.

The equations are those of `parametric`, solved to the same round-off; only the solver differs: it uses the band
structure of the Jacobian (`stepping.banded`).  Which unknown occurs in which equation is found when a system is
prepared (`stepping.structure`).  Every substep keeps a factorized matrix of its own from step to step.  Methods that
are explicit on the system are prepared by `parametric`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.stepping import structure
from phasebench.integrators.stepping.banded import Band, Room, band_of, band_solver, columns, forget
from phasebench.integrators.stepping.codes import SOLVED
from phasebench.integrators.stepping.kernel import Carry, Prepared, value
from phasebench.integrators.stepping.loop import loop
from phasebench.integrators.stepping.solve import lengths_of_both
from phasebench.integrators.values.vector import (
    State,
    dispatch_on_none,
    head,
    read_state,
    size,
    tail,
    update,
    velocity,
)

from . import parametric
from .parametric import Stage, increments, kick, lengths_of_kick, shift, unknown

if TYPE_CHECKING:
    from phasebench.integrators.record import Method
    from phasebench.integrators.systems.hamiltonian import Hamiltonian
    from phasebench.integrators.values.kinds import Value

#: h and lambda at which a field of higher order is probed, and the seed of the states.
AT, SEED = (0.1, 1 / 3), 3


class Banded(NamedTuple):
    """The data of a one-stage method whose equations are solved in a narrow band.

    Attributes
    ----------
    field : the vector field (q', p'), or None in the Nystrom form, where the unknown is the increment of p alone
    dT, dV : the gradients of T and V in the Nystrom form, else None
    c : lengths of the substeps as fractions of h
    mu, lam : weights of a substep's stage: it is evaluated at (q + mu Delta q, p + lam Delta p)
    band : the sparsity band of the stage equations
    h, eps : the step size and the unit round-off, set by the run
    """

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
    return update(y, shift(x, stage), x), n, status


def _general(field, step, y, c, mu, lam, x, room):
    stage = Stage(step, y.q, y.p, y.p, c * step.h, mu, lam)
    x, n, status = solve_increments(stage, x, size(y.q) + size(y.p), step.eps, step.band, room)
    return update(y, head(x), tail(x)), n, status


#: One substep from the start x of its equation; (field, step, y, c, mu, lam, x, room) -> (y, evaluations, status).
substep = dispatch_on_none(_nystrom, _general)


def begin(method: Banded, carry: Carry, counts: np.record) -> State:
    """Read the state from ``carry``, where the last call of the kernel (loop over steps) left it.

    Before the first step of a run, mark the stored matrices of Newton's method as out of date.
    """
    if counts.steps == 0:
        for s in range(len(method.c)):
            forget(carry.work.rows, s * len(unknown(method.field, carry.zero)), columns(method.band))
    return read_state(carry)


def step(method: Banded, y: State, carry: Carry, counts: np.record) -> tuple[State, int]:
    """Take one step from the state y, substep by substep; returns (state, status: `SOLVED` or why a substep failed).

    The factorized matrices of Newton's method stay in ``carry`` from step to step; evaluations are added to ``counts``.
    """
    start = unknown(method.field, carry.zero)
    status = SOLVED
    counts.newton += len(method.c)
    for s in range(len(method.c)):
        room = Room(carry.memory, 0, carry.work.rows, s * len(start))
        y, n, status = substep(method.field, method, y, method.c[s], method.mu[s], method.lam[s], start, room)
        counts.gradient += n
        if status != SOLVED:
            break
    return y, status


run = loop(step, begin)


def structure_of(system: Hamiltonian, order: int) -> list[np.ndarray]:
    """Find the sparsity of the Jacobian of the stage equations: for each unknown, the equations that depend on it.

    ``order`` is that of the truncated generating function (see `parametric`).  Returns a list with an array of equation
    numbers for each unknown.  Raises InvalidInput if the structure cannot be found.
    """
    (field, dT, dV), n = parametric.quadratic(system, DOUBLE, order)
    d = system.d

    def slope(x: Value) -> np.ndarray:
        if field is None:
            x = value(x, d)
            return np.array(dV(x if dT is None else dT(x)), float)
        return np.concatenate([np.array(z, float) for z in field(value(x[:d], d), value(x[d:], d), *AT)])

    rng = np.random.default_rng(SEED)
    return structure.find_structure(
        slope, [rng.normal(size=n) / 10, rng.uniform(0.5, 1.5, size=n), rng.normal(size=n) * 10]
    )


def prepare(method: Method, system: Hamiltonian, arithmetic: str) -> Prepared:
    """Prepare the kernel (compiled loop over steps) of a one-stage method, with the band of its stage equations.

    Methods that are explicit on the system have no equations to solve: they get the kernel of `parametric`.
    """
    plain = parametric.prepare(method, system, arithmetic)
    if plain.run is not parametric.run:  # explicit: there is nothing to solve
        return plain
    band = band_of(structure_of(system, method.data[0]))
    step = Banded(**{name: x for name, x in plain.step._asdict().items() if name in Banded._fields}, band=band)
    work = (plain.stages * plain.width, columns(band))
    return Prepared(run, step, plain.width, plain.stages, hessian=plain.hessian, work=work)
