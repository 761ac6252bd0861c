r"""Gonzalez' midpoint discrete gradient and its compositions, which keep H for every Hamiltonian.

With y = (q, p), the increment x of a step and :math:`\bar y = y + x/2`,

.. math::
    x = h J^{-1}\bigl(\nabla H(\bar y) + a\,x\bigr),\qquad
    a = \frac{H(y + x) - H(y) - \nabla H(\bar y)\cdot x}{x\cdot x} .

The equation makes x orthogonal to the bracket, so that a is also the number for which H(y + x) = H(y).  That is how it
is found here: for a given a the equation is smooth and solved to round-off, and a runs through secant steps, from the
slope :math:`dH(y + x)/da = -x\cdot x + O(h^3)`, until H is H0 to its round-off.  The quotient itself would bring the
round-off of H, divided by x.x, into every iterate; and with H0 as the target in place of H(y) nothing accumulates.  A
substep in which H stays away from H0 is counted as a fallback.

``plan`` rows are the fractions of the step, ``table`` is [[H0]].

Source: O. Gonzalez, J. Nonlinear Sci. 6 (1996) 449-467, equation (11).
"""

from __future__ import annotations

import numpy as np

from phasebench.integrators.engine.kernel import Prepared, array
from phasebench.integrators.engine.solve import LEVELS, SOLVED, predict, predict_number, remember, solver
from phasebench.integrators.engine.vector import (
    add,
    axpy,
    close,
    head,
    inlined,
    join,
    opened,
    scale,
    size,
    store,
    tail,
    written,
)

#: Secant steps for a.
LIMIT = 12
MISSED = "do not reach the energy of the start"


@written(lambda d: "  return " + " + ".join(f"x[{i}] * x[{i}]" for i in range(d)))
def square(x):
    """x . x."""
    return np.sum(x * x)


@inlined
def increment(x, arguments):
    """h J^-1 (grad H(y + x/2) + a x)."""
    field, q, p, h, a = arguments
    dq, dp = field(axpy(0.5, head(x), q), axpy(0.5, tail(x), p), h, 0.0)
    return join(scale(h, axpy(a, tail(x), dq)), scale(h, axpy(-a, head(x), dp)))


solve_increment = solver(increment)


def run(field, energy, plan, table, h, every, eps, zero, state, memory, work, Q, P, aux, counts):
    """Fill the rows of Q and P, each after ``every`` steps; returns (rows, status)."""
    q, p, cq, cp = opened(state, zero)
    both = join(zero, zero)
    slots = len(plan)
    numbers = LEVELS * slots  # where ``memory`` keeps the ring of each substep's a
    H0 = table[0, 0]
    for row in range(len(Q)):
        for _ in range(every):
            for s in range(slots):
                c = plan[s, 0] * h
                x = predict(memory, s, slots, counts[0], both)
                a = predict_number(memory, numbers + s, slots, counts[0])
                last_a, last = a, H0
                span = size(q) + size(p)
                reached = False
                for k in range(LIMIT):
                    x, n, used, status = solve_increment((field, q, p, c, a), x, span, eps, work)
                    counts[1] += n
                    counts[2] += used
                    if status != SOLVED:
                        return row, status
                    H, magnitude = energy(add(q, cq, head(x))[0], add(p, cp, tail(x))[0])
                    error, unit = H - H0, eps * magnitude
                    reached = abs(error) <= unit or (k > 1 and 8 * unit >= abs(error) >= 0.5 * abs(last))
                    slope = -square(x)
                    if k > 0 and (error - last) / (a - last_a) < 0:
                        slope = (error - last) / (a - last_a)
                    if reached or a - error / slope == a or not slope < 0:
                        break
                    last_a, last = a, error
                    a = a - error / slope
                if not reached:
                    counts[3] += 1
                remember(memory, s, slots, counts[0], x)
                memory[numbers + s + counts[0] % LEVELS * slots, 0] = a
                q, cq = add(q, cq, head(x))
                p, cp = add(p, cp, tail(x))
            counts[0] += 1
        store(Q, row, q)
        store(P, row, p)
    close(state, q, p, cq, cp)
    return len(Q), 0


def prepare(method, system, arithmetic):
    """The kernel with the initial state's energy as its target."""
    energy = system.energy(arithmetic)

    def begin(table, q, p):
        table[0, 0] = energy(q, p)[0]

    plan = array([[c] for c in method.data], arithmetic)
    functions = (system.field(arithmetic), energy)
    return Prepared(run, functions, plan, array([[0]], arithmetic), 2 * system.d, len(plan), begin=begin, missed=MISSED)
