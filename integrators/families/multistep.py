r"""Symmetric linear multistep methods for H = p . M^-1 p / 2 + V(q): a step takes one gradient and k earlier states.

.. math::
    \sum_{j=0}^k \alpha_j\,q_{n+j} = h^2 M^{-1}\sum_{j=1}^{k-1} \beta_j\,g_{n+j},\qquad g = -\nabla V(q).

:math:`\rho(z) = \sum_j\alpha_j z^j = (z - 1)^2\sum_j r_j z^j` has integers :math:`r_j`.  Summed twice, with
compensation,

.. math::
    \sum_{j=0}^{k-2} r_j\,W_{n+1+j} = h\sum_{j=1}^{k-1}\beta_j\,g_{n+j},\qquad
    U_{n+1/2} = U_{n-1/2} + W_n,\qquad q_{n+1} = q_n + h M^{-1} U_{n+1/2},

the positions and the momenta U of half steps are sums of as many terms as those of a splitting, and round-off follows
Brouwer's law.  The division by the common denominator of the beta comes last: rounded coefficients would act like
changed masses.

**Start.**  The first k - 1 steps are those of Gauss's method with 8 stages, of order 16, in the same h.  Its kicks
:math:`x_i = h b_i g_i` give the sums exactly: :math:`U_{n+1/2} = p_n + \sum_i (1 - c_i) x_i`.

**Momenta of rows** of output are no part of the recursion.  They are computed by the backward formula

.. math:: p_n = U_{n-1/2} + h\sum_{j=0}^{k-1} d_j\,g_{n-j},

whose fractions d are exact for q a polynomial of degree k + 1; its error is of order k + 1 in h, one more than that of
the positions.

The state that is passed from step to step is not (q, p) but k - 1 gradients, k - 2 sums, U and q: a step is no map of
phase space.  Run backwards from that state, with the earlier ones in reversed order, the recursion returns: it is
symmetric.

Sources: G. D. Quinlan, S. Tremaine, Astron. J. 100 (1990) 1694-1700; the summed form after E. Hairer, C. Lubich,
G. Wanner, Geometric Numerical Integration (2006), XV.3 and P. Console, E. Hairer, BIT 54 (2014).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import mpmath
import numpy as np

from phasebench.integrators.coefficients.multistep import reduced, velocity_weights
from phasebench.integrators.coefficients.tableaus import LEVELS, tableau
from phasebench.integrators.compile import codegen
from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.stepping.codes import SOLVED, STALLED
from phasebench.integrators.stepping.kernel import Carry, Prepared, array, numbers
from phasebench.integrators.stepping.loop import loop
from phasebench.integrators.stepping.solve import fixed_point, replace
from phasebench.integrators.values.masks import number
from phasebench.integrators.values.vector import (
    State,
    add,
    add_product,
    axpy,
    distance,
    elementwise,
    head,
    inline,
    jit,
    join,
    load,
    plus,
    read_state,
    scale,
    size,
    store,
    tail,
    update,
    velocity,
)

if TYPE_CHECKING:
    from phasebench.integrators.record import Method
    from phasebench.integrators.systems.hamiltonian import Hamiltonian
    from phasebench.integrators.values.kinds import Condition, Number, Value

#: Orbits may be integrated side by side.
IN_LANES = True
#: Stages of the Gauss method that takes the first steps.
STAGES = 8


class Multistep(NamedTuple):
    """The data of a symmetric linear multistep method, and of Gauss's method, which takes the first steps.

    Attributes
    ----------
    dT, dV : the gradients of T and V; ``dT`` is None if grad T is p itself
    reduced : -r_0, ..., -r_(k-3), with the coefficients r_j of rho(z) / (z - 1)^2, rho(z) = sum_j alpha_j z^j
    beta, denominator : the numerators of beta_1, ..., beta_(k-1), and their denominator
    backward : d_0, ..., d_(k-1), weights of gradients in the formula for the momenta
    A, b, c, w : of Gauss's method: stages q + c h v + h M^-1 A x with the kicks x = b h g, and w = 1 - c
    h, eps : the step size and the unit round-off, set by the run
    """

    dT: Callable | None
    dV: Callable
    reduced: np.ndarray
    beta: np.ndarray
    denominator: float
    backward: np.ndarray
    A: np.ndarray
    b: np.ndarray
    c: np.ndarray
    w: np.ndarray
    h: float = 0.0
    eps: float = 0.0


class MultistepState(NamedTuple):
    """The state (q, p) with the memory of earlier steps.

    Attributes
    ----------
    q, p : the state; p is up to date in stored rows only, once the recursion has started
    lost_q, lost_p : what rounding lost of each (compensation)
    memory : array with what the recursion needs of earlier steps: gradients, the changes W of the momentum from half
        step to half step, and the momentum U of the last half step
    known : the number of steps taken so far
    """

    q: Any
    p: Any
    lost_q: Any
    lost_p: Any
    memory: np.ndarray
    known: int


class Start(NamedTuple):
    """Arguments of the stage equations of a first step, by Gauss's method.

    Attributes
    ----------
    method : the multistep method, with the coefficients of Gauss's method
    q, v : the coordinates, and h M^-1 p, both before the step
    memory, at : the kicks of the stages are in the rows of the array ``memory`` from ``at`` on
    zero : a zero of the type of q
    """

    method: Multistep
    q: Any
    v: Any
    memory: np.ndarray
    at: int
    zero: Any


@elementwise()
def divide(x, a):
    """The vector x / a."""
    return x / a


# -- rows of the memory: rings of k gradients and of k - 2 sums W; U, its lost part, a part of W; kicks ----------------


@inline
def _sums(method: Multistep) -> int:
    """The number of the first row of `MultistepState.memory` with changes W of the momentum between half steps."""
    return len(method.backward)


@inline
def _half_step(method: Multistep) -> int:
    """The number of the row of `MultistepState.memory` with the momentum U of the half step.

    The row after it has what rounding lost of U.
    """
    return 2 * len(method.backward) - 2


# -- the first steps --------------------------------------------------------------------------------------------------


@inline
def sweep(e: Start, x: Value, active: Condition) -> tuple[Value, Number, Number]:
    """Do one iteration of the stage equations of one of the first steps, by Gauss's method.

    It computes new kicks k_i = h b_i g_i of the stages in ``e.memory``, with the forces g_i = -grad V at the stages and
    Gauss's nodes c_i and weights b_i; the vector x holds the sums of (1 - c_i) k_i and of c_i k_i.  Returns (new x,
    distance of old and new kicks, size of the new); only the SIMD lanes ``active`` change.
    """
    m, s = e.method, len(e.method.b)
    delta, length = 0.0 * size(e.q), 0.0 * size(e.q)
    for i in range(s):
        moved = e.zero
        for j in range(s):
            moved = axpy(m.A[i, j], load(e.memory, e.at + j, e.zero), moved)
        at = plus(e.q, axpy(m.c[i], e.v, scale(m.h, velocity(m.dT, moved))))
        store(e.memory, e.at + s + i, scale(-m.b[i], scale(m.h, m.dV(at))))
    first, second = e.zero, e.zero
    for i in range(s):
        old, new = load(e.memory, e.at + i, e.zero), load(e.memory, e.at + s + i, e.zero)
        delta, length = delta + distance(new, old), length + size(new)
        new = replace(active, old, new)
        store(e.memory, e.at + i, new)
        first, second = axpy(m.w[i], new, first), axpy(1 - m.w[i], new, second)
    return replace(active, x, join(first, second)), delta, length


solve = fixed_point(sweep)


@jit
def start_step(method: Multistep, y: MultistepState, zero: Value, counts: np.record) -> tuple[MultistepState, int]:
    """Take one of the first steps by Gauss's method; returns (state, status).

    What the recursion needs of the step is stored in ``y.memory``, as `MultistepState` states.
    ``zero`` is a zero of the shape of q; evaluations are added to ``counts``.
    """
    k, memory, n, at = len(method.backward), y.memory, y.known, _half_step(method)
    if n == 0:
        first = scale(-1.0, method.dV(y.q))
        counts.gradient += number(size(first) < np.inf)
        store(memory, 0, first)
    g = load(memory, n, zero)
    e = Start(method, y.q, scale(method.h, velocity(method.dT, y.p)), memory, at + 3, zero)
    for i in range(len(method.b)):
        store(memory, e.at + i, scale(method.b[i], scale(method.h, g)))
    x, sweeps, good = solve(e, join(zero, zero), size(y.q) + size(y.p), method.eps)
    counts.gradient += sweeps * len(method.b)
    if not good:
        return y, STALLED
    early, late = head(x), tail(x)
    if n > 0:
        store(memory, _sums(method) + n % (k - 2), plus(load(memory, at + 2, zero), early))
    store(memory, at + 2, late)
    if n == k - 2:
        U, lost = add(y.p, y.lost_p, early)
        store(memory, at, U)
        store(memory, at + 1, lost)
    q, p, lost_q, lost_p = update(
        State(y.q, y.p, y.lost_q, y.lost_p),
        plus(e.v, scale(method.h, velocity(method.dT, early))),
        plus(early, late),
    )
    return MultistepState(q, p, lost_q, lost_p, memory, n), SOLVED


# -- a step -----------------------------------------------------------------------------------------------------------


@inline
def recur(method: Multistep, y: MultistepState, zero: Value) -> MultistepState:
    """Take one step of the multistep recursion; returns the state, whose momentum is not computed (see `finish`).

    ``zero`` is a zero of the shape of q.
    """
    k, memory, n, at = len(method.backward), y.memory, y.known, _half_step(method)
    row = (n + 2) % k  # of the gradient that beta_1 multiplies, the oldest but one
    total = zero
    for j in range(k - 1):
        total = axpy(method.beta[j], load(memory, row, zero), total)
        row = row + 1 if row + 1 < k else 0
    W = divide(scale(method.h, total), method.denominator)
    oldest = n % (k - 2)
    row = oldest
    for j in range(k - 2):
        W = axpy(method.reduced[j], load(memory, _sums(method) + row, zero), W)
        row = row + 1 if row + 1 < k - 2 else 0
    store(memory, _sums(method) + oldest, W)
    U, lost = add(load(memory, at, zero), load(memory, at + 1, zero), W)
    store(memory, at, U)
    store(memory, at + 1, lost)
    q, lost_q = add_product(y.q, y.lost_q, method.h, velocity(method.dT, U))
    return MultistepState(q, y.p, lost_q, y.lost_p, memory, n)


def begin(method: Multistep, carry: Carry, counts: np.record) -> MultistepState:
    """Read the state from ``carry``, where the last call of the kernel (loop over steps) left it."""
    y = read_state(carry)
    return MultistepState(y.q, y.p, y.lost_q, y.lost_p, carry.memory, counts.steps)


def step(method: Multistep, y: MultistepState, carry: Carry, counts: np.record) -> tuple[MultistepState, int]:
    """Take a step: by Gauss's method until there are enough earlier states, then by the recursion.

    Returns (state, status: `SOLVED`, or `STALLED` if Gauss's stage equations could not be solved); evaluations are
    added to ``counts``.
    """
    k, status = len(method.backward), SOLVED
    if y.known < k - 1:
        y, status = start_step(method, y, carry.zero, counts)
        if status != SOLVED:
            return y, status
    else:
        y = recur(method, y, carry.zero)
    g = scale(-1.0, method.dV(y.q))
    counts.gradient += number(size(g) < np.inf)
    store(y.memory, (y.known + 1) % k, g)
    return MultistepState(y.q, y.p, y.lost_q, y.lost_p, y.memory, y.known + 1), status


def finish(method: Multistep, y: MultistepState) -> MultistepState:
    """Compute the momentum p of the state from earlier gradients, before a row is stored; returns the state."""
    k = len(method.backward)
    if y.known < k:
        return y
    total = scale(0.0, y.q)
    row = y.known % k
    for j in range(k):
        total = axpy(method.backward[j], load(y.memory, row, y.q), total)
        row = row - 1 if row > 0 else k - 1
    at = _half_step(method)
    p, lost = add(load(y.memory, at, y.q), load(y.memory, at + 1, y.q), scale(method.h, total))
    return MultistepState(y.q, p, y.lost_q, lost, y.memory, y.known)


run = loop(step, begin, finish=finish)


def prepare(method: Method, system: Hamiltonian, arithmetic: str) -> Prepared:
    """Prepare the kernel (compiled loop over steps) of a symmetric linear multistep method for a system.

    ``method.data`` is (alpha, numerators of beta, their denominator); beta_0 and beta_k are zero.
    """
    alpha, numerators, denominator = method.data
    k = len(alpha) - 1
    digits = 40 if arithmetic == DOUBLE else mpmath.mp.dps + 10
    unit = mpmath.mpf(2) ** (-52 if arithmetic == DOUBLE else 1 - mpmath.mp.prec)
    gauss = tableau("gauss", STAGES, STAGES, True, digits, unit)
    made = Multistep(
        system.grad_T(arithmetic),
        system.grad_V(arithmetic),
        numbers([-x for x in reduced(alpha)[:-1]], arithmetic),
        numbers(numerators[1:-1], arithmetic),
        codegen.to_number(denominator, arithmetic),
        numbers(velocity_weights(k), arithmetic),
        array(gauss.A_q, arithmetic),
        numbers([gauss.B[i][i] for i in range(STAGES)], arithmetic),
        numbers(gauss.c, arithmetic),
        numbers(gauss.weights[0], arithmetic),
    )
    rows = 2 * k + 1 + 2 * STAGES
    return Prepared(run, made, system.d, -(-rows // (3 * LEVELS + 1)), implicit=False, apart=True)
