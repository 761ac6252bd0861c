r"""Schemes IV and V: the parameter of Schemes I and III is chosen in each step so that the energy is H0.

A substep of Scheme I (`parametric`) over :math:`c h` solves :math:`(\Delta q, \Delta p) = ch\,f(q + (1 - \lambda)\Delta
q, p + \lambda\Delta p)`, with the field :math:`f = J^{-1}\nabla H`.  Let :math:`\Phi^{x}_h` be such substeps, with
:math:`\lambda_s = \tfrac12 + \text{sign}_s\,x` over :math:`c_s h` (Scheme IV: one substep, sign 1; Scheme V: two
halves, signs -1, 1).  Every fixed x gives a symplectic map, so every quadratic invariant is kept; x is the root of

.. math::
    E(x) = H(\Phi^x_h(q, p)) - H_0

nearest to zero.  E is :math:`h^2 x\,a(y) + O(h^3)` for Scheme IV, with :math:`a = \tfrac{d}{dt}(H_p\cdot H_q)`, and a
quadratic in x times :math:`h^3` to leading order for Scheme V.  A step without a root is taken with x = 0 and counted
as a fallback; the target stays H0, so that a later step restores the energy.

A composition has several groups of substeps, each with its own root, and a group may name a second list of substeps,
the alternative, that is tried where the first has no root.

Source: Y. Wang, Y. Bo, W. Cai, "A general symplectic integrator for canonical Hamiltonian systems" (talk), Schemes IV
and V, equations (24)-(26); L. Brugnano, F. Iavernaro, D. Trigiante, SIAM J. Numer. Anal. 50 (2012) 2897-2916 (EQUIP).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from phasebench.integrators.stepping.codes import SOLVED
from phasebench.integrators.stepping.energy_model import ALONG, FIRST, LAST, LATEST, STREAK, Attempt, Search
from phasebench.integrators.stepping.kernel import OWN, Carry, Prepared, array, freeze, keep_energy
from phasebench.integrators.stepping.loop import loop
from phasebench.integrators.stepping.root import finder
from phasebench.integrators.stepping.solve import LEVELS, predict, predict_number, remember
from phasebench.integrators.values.vector import State, axpy, force_inline, inline, load, minus, scale, store

from .parametric import quadratic, substep, unknown

if TYPE_CHECKING:
    from phasebench.integrators.record import Method
    from phasebench.integrators.systems.hamiltonian import Hamiltonian
    from phasebench.integrators.values.kinds import Number

#: Largest distance of lambda from 1/2.
RADIUS = 2.0
#: Least distance of two attempts for a difference quotient of their solutions.
APART = 1e-6
SEARCH = Search(radius=RADIUS, first=0.05, near=1.0, ratio=1.12, points=70, slack=0.0)
MISSED = "have no parameter near 1/2 that keeps the energy and were taken with 1/2"


class AdjustedScheme(NamedTuple):
    """The data of Scheme IV or V: substeps of length c_s h with the stage weight lambda_s = 1/2 + sign_s x.

    Attributes
    ----------
    energy : the function (q, p) -> (H, size of its terms), which sets the unit of its round-off
    field : the vector field (q', p'); None in the Nystrom form, where the unknown is the increment of p alone
    dT, dV : the gradients of T and V in the Nystrom form, else None
    c, sign : for each substep, the fraction of h, and the sign of x in its lambda
    group : for each substep, a number; substeps with the same number share a parameter x, which conserves H = H0
    alternative : for each substep, 0 or 1: a group is first tried with its substeps that have 0, and if no x is found
        with those that have 1
    search : the limits of the search for x
    H0 : the energy to conserve, that of the initial state
    h, eps : the step size and the unit round-off, set by the run
    """

    energy: Callable
    field: Callable | None
    dT: Callable | None
    dV: Callable | None
    c: np.ndarray
    sign: np.ndarray
    group: np.ndarray
    alternative: np.ndarray
    search: Search
    H0: float = 0.0
    h: float = 0.0
    eps: float = 0.0


class Group(NamedTuple):
    """Arguments of the search for the parameter x of a group of substeps.

    Attributes
    ----------
    step : the data of the method
    y : the state before the group
    carry, counts : memory of earlier steps, and counters of evaluations
    begin, end : the group is the substeps begin, ..., end - 1
    predicted : x extrapolated from earlier steps
    """

    step: AdjustedScheme
    y: State
    carry: Carry
    counts: np.record
    begin: int
    end: int
    predicted: float


@force_inline
def attempt(x: Number, start: int, ease: Number, e: Group) -> Attempt:
    """Take the substeps of a group with the parameter x; returns an `Attempt` with the state and its energy error.

    ``start`` chooses where their equations start from (`FIRST`: the extrapolation from earlier steps; `LATEST`: the
    last attempt; `ALONG`: the linear continuation of the last attempts in x), ``ease`` is the error that their
    solutions may have, in units of round-off.  The memory of ``e.carry`` has the solutions of earlier steps, each with
    the x found in that step, those of the last attempt, and their derivatives by x.
    """
    step, memory, counts, y = e.step, e.carry.memory, e.counts, e.y
    numbers, row = e.carry.state, OWN + e.begin
    guess = unknown(step.field, e.carry.zero)
    stages = len(step.c)
    move = x - (e.predicted if start == FIRST else numbers[row, LAST])
    numbers[row, LAST] = x
    status = SOLVED
    for s in range(e.begin, e.end):
        latest = LEVELS * stages + s
        if start == FIRST:
            last = predict(memory, s, stages, counts.steps, guess)
        else:
            last = load(memory, latest, guess)
        z = last
        if start != LATEST:
            z = axpy(move, load(memory, latest + stages, guess), last)
        lam = 0.5 + step.sign[s] * x
        y, z, n, used, status = substep(step.field, step, y, step.c[s], 1 - lam, lam, z, ease * step.eps, e.carry.work)
        counts.gradient += n
        counts.newton += used
        if status != SOLVED:
            return Attempt(y, np.inf, step.eps, status)
        store(memory, latest, z)
        if start == ALONG and abs(move) > APART:
            store(memory, latest + stages, scale(1 / move, minus(z, last)))
    H, magnitude = step.energy(y.q, y.p)
    return Attempt(y, H - step.H0, step.eps * magnitude, status)


find = finder(attempt, inline(lambda e: e.carry.state))


@force_inline
def advance(
    step: AdjustedScheme, y: State, carry: Carry, counts: np.record, first: int
) -> tuple[State, Number, int, int]:
    """Take the group of substeps that begins with number ``first``, with the parameter x that conserves the energy.

    Returns (state, lambda = 1/2 + x or NaN if there is no root, the number of the substep after the group, status).
    """
    stages, memory = len(step.c), carry.memory
    guess = unknown(step.field, carry.zero)
    roots = (LEVELS + 2) * stages  # where the memory keeps the ring of each group's roots
    begin, found, lam, new = first, False, np.nan, y
    while not found and begin < stages and step.group[begin] == step.group[first]:
        end = begin
        while (
            end < stages and step.group[end] == step.group[first] and step.alternative[end] == step.alternative[begin]
        ):
            end += 1
        predicted = predict_number(memory, roots + begin, stages, counts.steps)
        e = Group(step, y, carry, counts, begin, end, predicted)
        x, found, result = find(step.search, carry.state, OWN + begin, predicted, e, carry.work)
        memory[roots + begin + counts.steps % LEVELS * stages, 0] = x
        if result.status != SOLVED:
            return y, lam, end, result.status
        if found:
            lam = 0.5 + x
        if found or begin == first:
            new = result.y
        begin = end
    if not found:
        counts.fallbacks += 1
    while begin < stages and step.group[begin] == step.group[first]:
        carry.state[OWN + begin, STREAK] = -LEVELS
        begin += 1
    for s in range(first, begin):
        remember(memory, s, stages, counts.steps, load(memory, LEVELS * stages + s, guess))
    return new, lam, begin, SOLVED


def step(method: AdjustedScheme, y: State, carry: Carry, counts: np.record) -> tuple[State, int]:
    """Take one step from the state y, group of substeps by group; returns (state, status).

    ``counts.parameter`` becomes lambda of the last group, NaN if it has no root.  The status is `SOLVED` or why a stage
    equation could not be solved; starting values are kept in ``carry``.
    """
    s, status = np.int64(0), SOLVED  # for a literal 0 `advance` would be compiled twice
    while s < len(method.c) and status == SOLVED:
        y, counts.parameter, s, status = advance(method, y, carry, counts, s)
    return y, status


run = loop(step, parameter=True)


def prepare(method: Method, system: Hamiltonian, arithmetic: str) -> Prepared:
    """Prepare the kernel (compiled loop over steps) of Scheme IV or V for a system.

    It is in the Nystrom form if T is quadratic.  ``method.data`` has a row (c, sign, group, alternative) for each
    substep, the numbers of `AdjustedScheme`.
    """
    energy = system.energy(arithmetic)
    functions, width = quadratic(system, arithmetic)
    c, sign, group, alternative = zip(*method.data, strict=True)
    step = AdjustedScheme(
        energy,
        *functions,
        *(freeze(row) for row in array((c, sign), arithmetic)),
        freeze(group),
        freeze(alternative),
        SEARCH,
    )
    return Prepared(run, step, width, len(c), begin=keep_energy(energy), missed=MISSED, searches=True)
