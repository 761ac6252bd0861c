r"""Wisdom-Holman steps with all bodies in SIMD lanes: 5.7 to 6.2 times as fast as one body after the other.

That is for the outer solar system (6 bodies) and four methods.  With Q, P, the masses :math:`m_k` and :math:`\mu_k` of
`wisdom_holman`, the potential has to be a sum of inverse distances, with a strength :math:`w_a` and a vector
:math:`D_a` for each pair a of bodies,

.. math:: V = -\sum_a \frac{w_a}{|D_a|},\qquad D_a = \sum_k M_{ak} Q_k,\qquad
          -\nabla_k B = -\sum_a w_a M_{ak}\frac{D_a}{|D_a|^3} + m_k\mu_k\frac{Q_k}{|Q_k|^3}.

The vectors of all bodies are three rows of lanes, x, y and z, with a body in each lane; in a kick the lanes are pairs
of bodies.  (B is the interaction, whose force :math:`-\nabla_k B` changes :math:`P_k` in a kick.)  Q, P and what
rounding lost of them stand in the memory between calls of the kernel.  After a drift, the distances |Q| are those that
Kepler's flow gives, improved by one correction of Newton's method, which takes no square root or quotient.
"""

from __future__ import annotations

from math import sqrt
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from phasebench.integrators.stepping import kepler_lanes
from phasebench.integrators.values.lanes import combine, put, take
from phasebench.integrators.values.masks import select
from phasebench.integrators.values.vector import State, add, axpy, inline, jit

if TYPE_CHECKING:
    from phasebench.integrators.stepping.kernel import Carry, Samples
    from phasebench.integrators.values.kinds import Number, Value

#: Number of coordinates of a body.
SPACE = 3
#: The rows of the memory: the state with its distances, and what steps and rows need.
STATE, DISTANCES, WORK = 0, 4 * SPACE, 4 * SPACE + 2
ROWS = WORK + kepler_lanes.ROWS
#: The rows of ``maps``, times the number of bodies: the columns of the matrices to q, to Q, to P, to p.
TO_Q, TO_JACOBI_Q, TO_JACOBI_P, TO_P = range(4)
#: The rows of ``parts``: mu, the masses, their inverses as sums of two doubles, m mu, and 1 where the motion is free.
MU, MASS, OVER_MASS, OVER_MASS_LOW, STRENGTH, FREE = range(6)


class Planets(NamedTuple):
    """The data of a Wisdom-Holman method in SIMD lanes; n bodies are padded to the number of lanes.

    q and p are the original variables of the bodies, Q and P those of the Kepler motions
    (for example Jacobi's).

    Attributes
    ----------
    substeps, corrector : rows (drift, kick), fractions of h, of a step and of the symplectic corrector
    like, bodies : tuples of zeros, one for each lane, and one for each body
    maps : the columns, n rows for each, of four matrices that transform vectors of bodies: Q to q, q to Q, p to P, P to
        p
    parts : the rows `MU` to `FREE`, a number for each body
    pairs : for each group of as many pairs of bodies as lanes, the rows: the n columns of the matrix M that gives the
        vectors D = M Q between the bodies of the pairs; a number that is added to the first component of D (1 in a lane
        without a pair, so that its distance is not 0); the weights w of the potential, a sum of -w / |D|; the rows of M
    series : the table `kepler_flow.constants`
    h, eps : the step size and the unit round-off, set by the run
    """

    substeps: np.ndarray
    corrector: np.ndarray
    like: tuple
    bodies: tuple
    maps: np.ndarray
    parts: np.ndarray
    pairs: np.ndarray
    series: np.ndarray
    h: float = 0.0
    eps: float = 0.0


class Places(NamedTuple):
    """The state of all bodies in SIMD lanes, with the distances of the Kepler motions.

    Attributes
    ----------
    y : the `State` of Q and P, the variables of the Kepler motions, each as the three rows x, y, z of lanes
    r, inverse : |Q| and 1 / |Q|, which are 1 for bodies that move without attraction
    """

    y: State
    r: object
    inverse: object


@inline
def _rows(table: np.ndarray, first: int, like: Value) -> Value:
    return take(table, first, like), take(table, first + 1, like), take(table, first + 2, like)


@inline
def _keep(table: np.ndarray, first: int, x: Value, like: Value) -> None:
    put(table, first, x[0], like)
    put(table, first + 1, x[1], like)
    put(table, first + 2, x[2], like)


@inline
def _dot(x: Value, y: Value) -> Number:
    return x[0] * y[0] + x[1] * y[1] + x[2] * y[2]


@inline
def _times(a: Number, x: Value) -> Value:
    return a * x[0], a * x[1], a * x[2]


@inline
def _transform(step: Planets, which: int, x: Value) -> Value:
    """Transform the bodies' vectors x, given as three rows of lanes, by a matrix of ``step.maps``; returns three rows.

    ``which`` is the number of the matrix: `TO_Q`, `TO_JACOBI_Q`, `TO_JACOBI_P` or `TO_P`.
    """
    row, n = which * len(step.bodies), step.bodies
    zero = 0 * x[0]
    return (
        combine(zero, x[0], 1.0, step.maps, row, n),
        combine(zero, x[1], 1.0, step.maps, row, n),
        combine(zero, x[2], 1.0, step.maps, row, n),
    )


@inline
def _squares(step: Planets, y: State) -> Number:
    free = take(step.parts, FREE, step.like)
    return select(free > 0, free, _dot(y.q, y.q))


@inline
def _add_distances(step: Planets, y: State) -> Places:
    """Compute the distances |Q| of the Kepler motions and their inverses from the state y; returns `Places`."""
    r = sqrt(_squares(step, y))
    return Places(y, r, 1 / r)


@inline
def _drift(step: Planets, at: Places, h: Number, memory: np.ndarray) -> Places:
    """Move all bodies along their Kepler orbits over the time h, exp(h A): returns the new `Places`."""
    like, y = step.like, at.y
    mu, mass = take(step.parts, MU, like), take(step.parts, MASS, like)
    free = take(step.parts, FREE, like) > 0
    high, low = take(step.parts, OVER_MASS, like), take(step.parts, OVER_MASS_LOW, like)
    v = axpy(high, y.p, _times(low, y.p))
    eta, vv = select(free, mu, _dot(y.q, v)), select(free, mu, _dot(v, v))
    beta = 2 * mu * at.inverse - vv
    m = kepler_lanes.motion(at.r, at.inverse, eta, beta, mu, h, step.eps, step.series, memory, WORK, like)
    q, lost_q = add(y.q, y.lost_q, axpy(m.f, y.q, _times(m.g, v)))
    p, lost_p = add(y.p, y.lost_p, axpy(mass * m.df, y.q, _times(m.dg, y.p)))
    y = State(q, p, lost_q, lost_p)
    if m.unsolved:
        return _add_distances(step, y)
    return Places(y, *kepler_lanes.root(_squares(step, y), m.inverse))


@inline
def _kick(step: Planets, at: Places, h: Number, counts: np.record) -> Places:
    """Change the momenta by the interaction over the time h, exp(h B): returns the new `Places`."""
    like, bodies, y, Q = step.like, step.bodies, at.y, at.y.q
    strength = take(step.parts, STRENGTH, like) * (at.inverse * at.inverse * at.inverse)
    x, y_, z = strength * Q[0], strength * Q[1], strength * Q[2]
    n, lanes = len(bodies), len(like)
    zero = 0 * Q[0]
    for first in range(0, len(step.pairs), n + 2 + lanes):
        D0 = combine(take(step.pairs, first + n, like), Q[0], 1.0, step.pairs, first, bodies)
        D1 = combine(zero, Q[1], 1.0, step.pairs, first, bodies)
        D2 = combine(zero, Q[2], 1.0, step.pairs, first, bodies)
        rr = D0 * D0 + D1 * D1 + D2 * D2
        w = take(step.pairs, first + n + 1, like) / (rr * sqrt(rr))
        back = first + n + 2
        x = combine(x, w * D0, -1.0, step.pairs, back, like)
        y_ = combine(y_, w * D1, -1.0, step.pairs, back, like)
        z = combine(z, w * D2, -1.0, step.pairs, back, like)
    p, lost = add(y.p, y.lost_p, (h * x, h * y_, h * z))
    counts.gradient += 1
    return Places(State(y.q, p, y.lost_q, lost), at.r, at.inverse)


@jit
def _correct(step: Planets, at: Places, sign: Number, memory: np.ndarray, counts: np.record) -> Places:
    """Apply the symplectic corrector (sign 1) or its inverse (sign -1) to the state ``at``; returns the new `Places`.

    The inverse is the corrector with its kicks reversed in sign.
    """
    rows = len(step.corrector)
    for k in range(rows):
        at = _drift(step, at, step.corrector[k, 0] * step.h, memory)
        if k + 1 < rows:
            at = _kick(step, at, sign * step.corrector[k, 1] * step.h, counts)
    return at


@inline
def _read_bodies(table: np.ndarray, row: int, n: int, memory: np.ndarray, like: Value) -> Value:
    """Read vectors of n bodies from a row of a table, body after body, into lanes; returns the three rows x, y, z.

    ``memory`` is working memory, ``like`` a tuple of zeros, one for each lane.
    """
    for i in range(SPACE):
        for j in range(len(like)):
            memory[WORK + i, j] = table[row, j * SPACE + i] if j < n else 0.0
    return _rows(memory, WORK, like)


@inline
def _write_bodies(x: Value, table: np.ndarray, row: int, n: int, memory: np.ndarray, like: Value) -> None:
    """Write vectors of n bodies, given as the three rows x, y, z of lanes, to a row of a table, body after body.

    ``memory`` is working memory, ``like`` a tuple of zeros, one for each lane.
    """
    _keep(memory, WORK, x, like)
    for i in range(SPACE):
        for j in range(n):
            table[row, j * SPACE + i] = memory[WORK + i, j]


@jit
def _write_start(step: Planets, carry: Carry, counts: np.record) -> None:
    """Write the start of a run to ``carry.memory``: the state in Jacobi coordinates, with the corrector applied."""
    memory, like, n = carry.memory, step.like, len(step.bodies)
    q = _transform(step, TO_JACOBI_Q, _read_bodies(carry.state, 0, n, memory, like))
    p = _transform(step, TO_JACOBI_P, _read_bodies(carry.state, 1, n, memory, like))
    none = _times(0.0, q)
    _save(memory, _correct(step, _add_distances(step, State(q, p, none, none)), 1, memory, counts), like)


@jit
def _fill_row(step: Planets, at: Places, samples: Samples, row: int, memory: np.ndarray, counts: np.record) -> None:
    """Fill row number ``row`` of the samples from the state ``at``, which it does not change.

    The step is finished by its last drift, the corrector is undone, and (Q, P) are transformed to (q, p).
    """
    like, n, last = step.like, len(step.bodies), len(step.substeps) - 1
    at = _drift(step, at, step.substeps[last, 0] * step.h, memory)
    y = _correct(step, at, -1, memory, counts).y
    _write_bodies(_transform(step, TO_Q, y.q), samples.q, row, n, memory, like)
    _write_bodies(_transform(step, TO_P, y.p), samples.p, row, n, memory, like)


@inline
def _save(memory: np.ndarray, at: Places, like: Value) -> None:
    y = at.y
    _keep(memory, STATE, y.q, like)
    _keep(memory, STATE + SPACE, y.p, like)
    _keep(memory, STATE + 2 * SPACE, y.lost_q, like)
    _keep(memory, STATE + 3 * SPACE, y.lost_p, like)
    put(memory, DISTANCES, at.r, like)
    put(memory, DISTANCES + 1, at.inverse, like)


@inline
def _read_state(memory: np.ndarray, like: Value) -> Places:
    q, p = _rows(memory, STATE, like), _rows(memory, STATE + SPACE, like)
    lost_q, lost_p = _rows(memory, STATE + 2 * SPACE, like), _rows(memory, STATE + 3 * SPACE, like)
    return Places(State(q, p, lost_q, lost_p), take(memory, DISTANCES, like), take(memory, DISTANCES + 1, like))


def run(step: Planets, carry: Carry, samples: Samples, counts: np.record) -> tuple[int, int]:
    """The kernel: integrate the steps between rows of output and fill the rows; returns (rows filled, status 0).

    It has a loop of its own, since rows need the corrector's inverse, and drifts of neighbouring steps are merged.
    """
    memory, like, a, h = carry.memory, step.like, step.substeps, step.h
    stages = len(a) - 1
    lead = between = (a[stages, 0] + a[0, 0]) * h
    if counts.steps == 0:
        _write_start(step, carry, counts)
        lead = a[0, 0] * h
    at = _read_state(memory, like)
    for row in range(len(samples.q)):
        for _ in range(samples.every):
            for k in range(stages):
                at = _drift(step, at, lead if k == 0 else a[k, 0] * h, memory)  # exp(a_k h A)
                at = _kick(step, at, a[k, 1] * h, counts)  # exp(b_k h B)
            lead = between
        _fill_row(step, at, samples, row, memory, counts)
    _save(memory, at, like)
    counts.steps += len(samples.q) * samples.every
    return len(samples.q), 0
