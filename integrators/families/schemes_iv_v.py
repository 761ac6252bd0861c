r"""Schemes IV and V: the parameter of Schemes I and III is chosen in each step so that the energy is H0.

With :math:`\lambda = \tfrac12 + x` let :math:`\Phi^{x}_h` be the substeps (c, sign): Scheme I with
:math:`\lambda_s = \tfrac12 + \text{sign}_s\,x` over :math:`c_s h` (Scheme IV: one substep, sign 1; Scheme V: two
halves, signs -1, 1).  Every fixed x gives a symplectic map, so every quadratic invariant is kept; x is the root of

.. math::
    E(x) = H(\Phi^x_h(q, p)) - H_0

nearest to zero.  E is :math:`h^2 x\,a(y) + O(h^3)` for Scheme IV, with :math:`a = \tfrac{d}{dt}(H_p\cdot H_q)`, and a
quadratic in x times :math:`h^3` to leading order for Scheme V.  A step without a root is taken with x = 0 and counted
as a fallback; the target stays H0, so that a later step wins the energy back.

A composition has several groups of substeps, each with its own root, and a group may name a second list of substeps,
the alternative, that is tried where the first has no root.

Source: Y. Wang, Y. Bo, W. Cai, "A general symplectic integrator for canonical Hamiltonian systems" (talk), Schemes IV
and V, equations (24)-(26); L. Brugnano, F. Iavernaro, D. Trigiante, SIAM J. Numer. Anal. 50 (2012) 2897-2916 (EQUIP).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from phasebench.integrators.engine.differences import columns, table
from phasebench.integrators.engine.energy_model import (
    ALONG,
    BEFORE,
    CHANGE,
    CONSTANT,
    CONSTANTS,
    FALL,
    FIRST,
    LAST,
    ROOT,
    ROOTS,
    STEPS,
    STREAK,
    USUAL,
    Attempt,
    Search,
)
from phasebench.integrators.engine.kernel import Orbit, Prepared, array, fixed, keep_energy
from phasebench.integrators.engine.resumed import Known, resumer
from phasebench.integrators.engine.root import finder
from phasebench.integrators.engine.solve import SOLVED
from phasebench.integrators.engine.vector import (
    State,
    advanced,
    axpy,
    chosen,
    close,
    distance,
    head,
    inlined,
    keep,
    load,
    minus,
    opened,
    scale,
    size,
    store,
    tail,
    velocity,
)

from .parametric import Stage, increments, kick, quadratic, shift, solve_increments, solve_kick, unknown

#: How far from 1/2 the parameter is looked for.
RADIUS = 2.0
#: Solutions of attempts that are so many units of their round-off apart tell how they change with x.
APART = 1024.0
#: A stage equation may be so much less exact, in units of the round-off of p, as the energy may be in its own.
SHARE_OF_ENERGY = 0.5
SEARCH = Search(radius=RADIUS, first=0.05, near=1.0, ratio=1.12, points=70, slack=0.0)
MISSED = "have no parameter near 1/2 that keeps the energy and were taken with 1/2"


#: The steps from which stages, how they change with x, and roots are extrapolated.
LEVELS, ALIKE, RECENT = STEPS, 3, 5
#: What the memory keeps of a stage: the solution of the last attempt (the next step's start, where a step is done), how
#: it changes with x, and the differences of both.
ALONG_ROW, STAGES, CHANGES = (np.uintp(k) for k in (1, 2, 2 + LEVELS))
KEPT = np.uintp(2 + LEVELS + ALIKE)
enter_stage, enter_change, enter_root = table(LEVELS), table(ALIKE), columns(LEVELS, RECENT)


class Adjusted(NamedTuple):
    """Substeps of length c h with lambda = 1/2 + sign x, one x for each group; H and its value to keep.

    In the Nystrom form ``field`` is None, else dT and dV are.
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
    """The substeps begin, ..., end - 1 from the state y."""

    step: Adjusted
    y: State
    orbit: Orbit
    counts: np.record
    begin: int
    end: int


resume_kick, resume_increments = resumer(kick, solve_kick), resumer(increments, solve_increments)


def _nystrom(field, step, y, h, lam, x, known, rough, work):
    stage = Stage(step, y.q, y.p, velocity(step.dT, y.p), h, 1 - lam, lam)
    solved = resume_kick(stage, x, known, rough, size(y.q) + size(y.p), step.eps, work)
    return advanced(y, shift(solved.x, stage), solved.x), solved


def _general(field, step, y, h, lam, x, known, rough, work):
    stage = Stage(step, y.q, y.p, y.p, h, 1 - lam, lam)
    solved = resume_increments(stage, x, known, rough, size(y.q) + size(y.p), step.eps, work)
    return advanced(y, head(solved.x), tail(solved.x)), solved


#: One substep from the start x of its equation, in the Nystrom form where ``field`` is None;
#: (field, step, y, h, lam, x, known, rough, work) -> (y, `Solved`).
substep = chosen(_nystrom, _general)


@inlined
def attempt(x, start, ease, e):
    """Take the group's substeps with the parameter x.

    The memory keeps the solutions of earlier steps at their roots, those of the last attempt, and how these change
    with x.
    """
    step, memory, counts, y = e.step, e.orbit.memory, e.counts, e.y
    numbers, row = e.orbit.state, 4 + e.begin
    guess = unknown(step.field, e.orbit.zero)
    move = x - numbers[row, LAST]
    numbers[row, LAST] = x
    for s in range(e.begin, e.end):
        place = np.uintp(s) * KEPT
        last = load(memory, place + STAGES if start == BEFORE else place, guess)
        z = last
        if start in (FIRST, ALONG):
            z = axpy(move, load(memory, place + ALONG_ROW, guess), last)
        own = 4 + s
        change, rate, usual = numbers[own, CHANGE], numbers[own, FALL], numbers[own, USUAL]
        if start in (FIRST, BEFORE):
            known = Known(usual if ease > 0 and usual > 0 else 1.0, 0.0)
        else:
            known = Known(abs(move) + (0.0 if change > 0 else rate), change)
        lam = 0.5 + step.sign[s] * x
        rough = ease * SHARE_OF_ENERGY * step.eps * size(y.p)
        y, solved = substep(step.field, step, y, step.c[s] * step.h, lam, z, known, rough, e.orbit.work)
        z = solved.x
        counts.gradient += solved.evaluations
        counts.newton += solved.newton
        if solved.status != SOLVED:
            return Attempt(y, np.inf, step.eps, solved.status)
        if start == FIRST and solved.evaluations == 1:
            numbers[own, CHANGE] = solved.change
        else:
            numbers[own, CHANGE], numbers[own, FALL] = 0.0, solved.rate
            numbers[own, USUAL] = min(solved.rate, 2 * usual) if usual > 0 else solved.rate
        store(memory, place, z)
        if start == ALONG and distance(z, last) > APART * step.eps * size(z):
            store(memory, place + ALONG_ROW, scale(1 / move, minus(z, last)))
    H, magnitude = step.energy(y.q, y.p)
    return Attempt(y, H - step.H0, step.eps * magnitude, SOLVED)


find = finder(attempt)


@inlined
def advance(step, y, orbit, counts, first):
    """Take the group that begins with the substep ``first``; (y, lambda or NaN, the substep after it, status)."""
    stages, memory, numbers = len(step.c), orbit.memory, orbit.state
    guess = unknown(step.field, orbit.zero)
    begin, found, lam, new = first, False, np.nan, y
    while not found and begin < stages and step.group[begin] == step.group[first]:
        end = begin
        while (
            end < stages and step.group[end] == step.group[first] and step.alternative[end] == step.alternative[begin]
        ):
            end += 1
        row = 4 + begin
        e = Group(step, y, orbit, counts, begin, end)
        x, found, result = find(step.search, numbers, row, e)
        numbers[row, LAST], numbers[row, ROOT] = enter_root(numbers, row, ROOTS, counts.steps, x)
        numbers[row, CONSTANT], _ = enter_root(numbers, row, CONSTANTS, counts.steps, numbers[row, CONSTANT])
        if result.status != SOLVED:
            return y, lam, end, result.status
        if found:
            lam = 0.5 + x
        if found or begin == first:
            new = result.y
        begin = end
    if not found:
        counts.fallbacks += 1
    for s in range(first, begin):
        place = np.uintp(s) * KEPT
        z, along = load(memory, place, guess), load(memory, place + ALONG_ROW, guess)
        store(memory, place, enter_stage(memory, place + STAGES, counts.steps, z))
        store(memory, place + ALONG_ROW, enter_change(memory, place + CHANGES, counts.steps, along))
    while begin < stages and step.group[begin] == step.group[first]:  # alternatives that were not tried
        numbers[4 + begin, STREAK] = -RECENT
        begin += 1
    return new, lam, begin, SOLVED


def run(step, orbit, samples, counts):
    """The kernel; the parameter is lambda of the last group, NaN for a fallback."""
    y = opened(orbit)
    for row in range(len(samples.q)):
        lam = np.nan
        for _ in range(samples.every):
            s = 0
            while s < len(step.c):
                y, lam, s, status = advance(step, y, orbit, counts, s)
                if status != SOLVED:
                    return row, status
            counts.steps += 1
        keep(samples, row, y)
        samples.parameter[row, 0] = lam
    close(orbit, y)
    return len(samples.q), 0


def prepare(method, system, arithmetic):
    """Substeps in the Nystrom form where T is quadratic."""
    energy = system.energy(arithmetic)
    functions, width = quadratic(system, arithmetic)
    c, sign, group, alternative = zip(*method.data, strict=True)
    step = Adjusted(
        energy,
        *functions,
        *(fixed(row) for row in array((c, sign), arithmetic)),
        fixed(group),
        fixed(alternative),
        SEARCH,
    )
    return Prepared(run, step, width, len(c), begin=keep_energy(energy), missed=MISSED)
