r"""Schemes IV and V: the parameter of Schemes I and III is chosen in each step so that the energy is H0.

With :math:`\lambda = \tfrac12 + x` let :math:`\Phi^{x}_h` be the substeps ``plan[s]`` = (c, sign): Scheme I with
:math:`\lambda_s = \tfrac12 + \text{sign}_s\,x` over :math:`c_s h` (Scheme IV: one substep, sign 1; Scheme V: two
halves, signs -1, 1).  Every fixed x gives a symplectic map, so every quadratic invariant is kept; x is the root of

.. math::
    E(x) = H(\Phi^x_h(q, p)) - H_0

nearest to zero.  E is :math:`h^2 x\,a(y) + O(h^3)` for Scheme IV, with :math:`a = \tfrac{d}{dt}(H_p\cdot H_q)`, and a
quadratic in x times :math:`h^3` to leading order for Scheme V: the finder starts from the smaller root of the
quadratic model that the last step left, goes on by Muller's method, tries the model's other root where that may be
nearer, and where all that fails follows the stage equations outwards from x = 0 to ``radius`` for the nearest change of
sign.  If E(0) is at the round-off of H already, x = 0.  A step without a root is taken with x = 0 and counted as a
fallback; the target stays H0, so that a later step wins the energy back.

``plan`` rows are (c, sign, group, alternative): a composition has several groups, each with its own root, and a group
may name a second list of substeps that is tried where the first has no root.  ``table`` is [[H0, radius]].

Source: Y. Wang, Y. Bo, W. Cai, "A general symplectic integrator for canonical Hamiltonian systems" (talk), Schemes IV
and V, equations (24)-(26); L. Brugnano, F. Iavernaro, D. Trigiante, SIAM J. Numer. Anal. 50 (2012) 2897-2916 (EQUIP).
"""

from __future__ import annotations

import numpy as np

from phasebench.integrators.engine.kernel import Prepared, array
from phasebench.integrators.engine.solve import LEVELS, SOLVED, predict, predict_number, remember
from phasebench.integrators.engine.vector import close, inlined, jit, load, opened, store

from .parametric import substep, unknown

#: How far from 1/2 the parameter is looked for.
RADIUS = 2.0
#: For a root farther than this the other side is looked at first.
CHECKED = 0.1
#: A root farther than this is looked for by continuation: Muller's method might leave the branch that starts at 1/2.
NEAR = 1.0
#: The continuation's points x on either side: FAR / RATIO**k, k = POINTS - 1, ..., 0, up to the radius.
RATIO, POINTS, FAR = 1.12, 70, 2.0
MULLER_LIMIT = 14
MISSED = "have no parameter near 1/2 that keeps the energy and were taken with 1/2"
REFINE_LIMIT = 100


@inlined
def attempt(x, start, arguments):
    """Take the group's substeps with parameter x; (q, p, cq, cp, E, round-off of H, status).

    The substeps start from earlier steps' solutions at their roots (``start`` 0) or at x = 0 (1), or from the last
    attempt's (2).
    """
    energy, field, dT, dV, plan, rows, H0, h, eps, zero, q, p, cq, cp, memory, work, counts = arguments
    guess = unknown(field, zero)
    slots = len(plan)
    status = SOLVED
    for s in range(rows[0], rows[1]):
        latest = 2 * LEVELS * slots + s
        if start == 2:
            z = load(memory, latest, guess)
        else:
            z = predict(memory, start * LEVELS * slots + s, slots, counts[0], guess)
        lam = 0.5 + plan[s, 1] * x
        q, p, cq, cp, z, n, used, status = substep(
            field, dT, dV, q, p, cq, cp, plan[s, 0] * h, 1 - lam, lam, z, eps, work
        )
        counts[1] += n
        counts[2] += used
        if status != SOLVED:
            return q, p, cq, cp, np.inf, eps, status
        store(memory, latest, z)
        if start == 1:
            remember(memory, LEVELS * slots + s, slots, counts[0], z)
    E, magnitude = energy(q, p)
    return q, p, cq, cp, E - H0, eps * magnitude, status


@inlined
def smaller_root(c0, c1, c2):
    """The root of c0 + c1 x + c2 x^2 nearest zero; infinite where it has none."""
    D = c1 * c1 - 4 * c0 * c2
    if not D >= 0:
        return np.inf
    root = D**0.5
    denominator = c1 + root if c1 >= 0 else c1 - root
    if denominator == 0:
        return np.inf
    return -2 * c0 / denominator


@inlined
def muller(x0, x1, x2, E0, E1, E2):
    """The quadratic through three points, about x2: (slope, curvature)."""
    d1 = (E2 - E1) / (x2 - x1)
    d0 = (E1 - E0) / (x1 - x0)
    c2 = (d1 - d0) / (x2 - x0)
    return d1 + c2 * (x2 - x1), c2


@jit
def refine(a, Ea, b, Eb, arguments):
    """The root between a and b, where E changes sign: bisection quickened by the secant (Illinois); -> (x, ok)."""
    x = b
    side = 0
    for k in range(REFINE_LIMIT):
        x = 0.5 * (a + b) if k % 3 == 2 else b - Eb * (b - a) / (Eb - Ea)
        if not (min(a, b) < x < max(a, b)):
            x = 0.5 * (a + b)
        Ex, unit, status = attempt(x, 2, arguments)[4:]
        if status != SOLVED:
            return x, False
        if abs(Ex) <= unit or x in (a, b):
            return x, abs(Ex) <= 64 * unit
        if (Ex > 0) == (Eb > 0):
            b, Eb = x, Ex
            if side == 1:
                Ea = 0.5 * Ea
            side = 1
        else:
            a, Ea = x, Ex
            if side == 2:
                Eb = 0.5 * Eb
            side = 2
    return x, False


@jit
def outwards(side, radius, arguments):
    """The root nearest zero on one side, by continuation from x = 0 to ``radius`` or the branch's end; (x, found)."""
    E0 = attempt(0.0, 1, arguments)[4]
    inner, Einner, outer, Eouter = 0.0, np.inf, 0.0, E0
    for k in range(POINTS):
        x = side * min(FAR / RATIO ** (POINTS - 1 - k), radius)
        if x == outer:
            break
        E, _, status = attempt(x, 2, arguments)[4:]
        if status != SOLVED:
            break
        if (E > 0) != (Eouter > 0):
            return refine(outer, Eouter, x, E, arguments)
        if abs(Einner) < np.inf and abs(Eouter) < abs(Einner) and abs(Eouter) < abs(E):
            # A least |E| between three points of one sign: is there a pair of roots about it?
            c1, c2 = muller(x, inner, outer, E, Einner, Eouter)
            middle = outer - 0.5 * c1 / c2
            Emiddle, _, status = attempt(middle, 2, arguments)[4:]
            if status == SOLVED and (Emiddle > 0) != (Eouter > 0):
                if abs(middle) < abs(outer):
                    return refine(inner, Einner, middle, Emiddle, arguments)
                return refine(outer, Eouter, middle, Emiddle, arguments)
            attempt(x, 2, arguments)
        inner, Einner, outer, Eouter = outer, Eouter, x, E
    return 0.0, False


@jit
def scan(radius, arguments):
    """The root nearest zero within ``radius`` on the branch of the stage equations that starts at x = 0; (x, found)."""
    above, found = outwards(1.0, radius, arguments)
    below, second = outwards(-1.0, abs(above) if found else radius, arguments)
    if second and not (found and abs(above) <= abs(below)):
        return below, True
    return above, found


@jit
def chase(x, E0, radius, model, g, arguments):
    """Muller's method from x, with (0, E0) as its other point; returns (x, found, result of the last attempt)."""
    xa, Ea, xb, Eb = 0.0, E0, 0.0, E0
    c1, c2 = 0.0, model[g, 1]  # the curvature of the last step's model serves until there is a third point
    result = attempt(x, 0, arguments)
    for k in range(MULLER_LIMIT):
        E, unit, status = result[4:]
        if status != SOLVED:
            break
        if k == 0:
            c1 = (E - E0) / x + c2 * x
        elif x != xb and x != xa and xa != xb:
            c1, c2 = muller(xa, xb, x, Ea, Eb, E)
        if k == 1 and abs(Eb) > 1e4 * unit:
            model[g, 0], model[g, 1] = c1 - 2 * c2 * x, c2
        elif k < 2:
            model[g, 0] = (E - E0) / x - model[g, 1] * x
        if abs(E) <= unit or (k > 1 and abs(E) <= 8 * unit and abs(E) >= 0.5 * abs(Eb)):
            return x, True, result
        move = smaller_root(E, c1, c2)
        if not abs(x + move) <= radius and Eb != E:
            move = -E * (x - xb) / (E - Eb)  # the parabola has no root: the secant
        xa, Ea, xb, Eb = xb, Eb, x, E
        x = x + move
        if not abs(x) <= radius or x == xb:
            break
        result = attempt(x, 2, arguments)
    return x, False, result


@inlined
def find(radius, model, g, predicted, arguments):
    """Find the group's root; returns (x, found, status, result of the attempt at the root)."""
    result = attempt(0.0, 1, arguments)
    E0, unit, status = result[4:]
    if status != SOLVED or abs(E0) <= unit:
        return 0.0, True, status, result
    x = smaller_root(E0, model[g, 0], model[g, 1])
    if not 0 < abs(x) <= radius:
        x = 0.05
    elif abs(predicted - x) <= 0.25 * abs(x):
        x = predicted  # the model picks the branch, the last roots say more exactly where it is now
    if abs(x) > CHECKED:
        # Is there a nearer root on the other side?  With E(x) = 0, E(-x) also says what the model is now.
        beyond, _, status = attempt(-x, 0, arguments)[4:]
        if status == SOLVED:
            c2 = 0.5 * (beyond - 2 * E0) / (x * x)
            c1 = -(E0 + c2 * x * x) / x
            model[g, 0], model[g, 1] = c1, c2
            if (beyond > 0) != (E0 > 0):
                nearer = smaller_root(E0, c1, c2)
                x = nearer if abs(nearer) < abs(x) and nearer * x < 0 else -0.5 * x
    x, found, result = chase(x, E0, radius, model, g, arguments)
    if found and abs(E0) < 1.2 * abs(model[g, 1]) * x * x:
        # The product of the model's two roots is E0 / c2: the other one may be nearer.
        other = E0 / (model[g, 1] * x)
        nearer, better, second = chase(other, E0, radius, model, g, arguments)
        if better and abs(nearer) < abs(x):
            x, result = nearer, second
    if not found or abs(x) > NEAR:
        x, found = scan(radius, arguments)
        result = attempt(x, 2, arguments)
        if found and x != 0:
            model[g, 0], model[g, 1] = -E0 / x, 0.0
    return x, found, result[6], result


def run(energy, field, dT, dV, plan, table, h, every, eps, zero, state, memory, work, Q, P, aux, counts):
    """Fill the rows of Q, P and aux (the last lambda of the row, NaN for a fallback); returns (rows, status)."""
    q, p, cq, cp = opened(state, zero)
    guess = unknown(field, zero)
    slots = len(plan)
    H0, radius = table[0, 0], table[0, 1]
    model = state[4:]
    roots = (2 * LEVELS + 1) * slots  # where ``memory`` keeps the ring of each group's roots
    for row in range(len(Q)):
        for _ in range(every):
            begin = 0
            while begin < slots:
                found = False
                lam = np.nan
                group = plan[begin, 2]
                first = begin
                while not found and begin < slots and plan[begin, 2] == group:
                    end = begin
                    while end < slots and plan[end, 2] == group and plan[end, 3] == plan[begin, 3]:
                        end += 1
                    arguments = (
                        energy, field, dT, dV, plan, (begin, end), H0, h, eps, zero,
                        q, p, cq, cp, memory, work, counts,
                    )  # fmt: skip
                    predicted = predict_number(memory, roots + begin, slots, counts[0])
                    x, found, status, result = find(radius, model, begin, predicted, arguments)
                    memory[roots + begin + counts[0] % LEVELS * slots, 0] = x
                    if status != SOLVED:
                        return row, status
                    if found:
                        lam = 0.5 + x
                    elif begin == first:
                        plain = result
                    begin = end
                if not found:
                    result = plain
                    counts[3] += 1
                q, p, cq, cp = result[0], result[1], result[2], result[3]
                while begin < slots and plan[begin, 2] == group:
                    begin += 1
                for s in range(first, begin):
                    remember(memory, s, slots, counts[0], load(memory, 2 * LEVELS * slots + s, guess))
            counts[0] += 1
        store(Q, row, q)
        store(P, row, p)
        aux[row] = lam
    close(state, q, p, cq, cp)
    return len(Q), 0


def prepare(method, system, arithmetic):
    """Substeps in the Nystrom form where T is quadratic."""
    energy = system.energy(arithmetic)

    def begin(table, q, p):
        table[0, 0] = energy(q, p)[0]

    if system.separable and system.quadratic_kinetic:
        functions, width = (None, system.grad_T(arithmetic), system.grad_V(arithmetic)), system.d
    else:
        functions, width = (system.field(arithmetic), None, None), 2 * system.d
    plan = array(method.data, arithmetic)
    table = array([[0, RADIUS]], arithmetic)
    return Prepared(run, (energy, *functions), plan, table, width, len(plan), begin=begin, missed=MISSED)
