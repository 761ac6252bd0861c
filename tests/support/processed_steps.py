"""Compare processed methods with a plain implementation in 40 digits: ``python processed_steps.py`` prints JSON.

Run with NUMBA_DISABLE_JIT=1, as multiprecision needs.
"""

from __future__ import annotations

import json

import mpmath

from phasebench.integrators import Hamiltonian, coefficients
from phasebench.integrators.compile.codegen import MULTIPRECISION, precision
from phasebench.integrators.driver import integrate
from support.force_gradients import DIGITS, START, STEPS, H
from support.solutions import apart, distance

#: A mass matrix that is not diagonal.
SYSTEM = Hamiltonian(q="q1 q2", p="p1 p2", H="p1**2 + p1*p2 + p2**2 + cos(q1)/3 + q1**2*q2**2/2 + q2**4/4")
#: Change of the processor's first number in the control.
SPOILED = mpmath.mpf("1e-18")


def kick(state, h):
    """Apply the kick exp(h B) of `SYSTEM`, written by hand, to a state (x, y, u, v); return the new state."""
    x, y, u, v = state
    return x, y, u - h * (-mpmath.sin(x) / 3 + x * y**2), v - h * (x**2 * y + y**3)


def drift(state, h):
    """Apply the drift exp(h A) of `SYSTEM`, written by hand, to a state (x, y, u, v); return the new state."""
    x, y, u, v = state
    return x + h * (2 * u + v), y + h * (u + 2 * v), u, v


def act(state, steps, h):
    """Apply a sequence of substeps to a state (x, y, u, v); return the new state.

    A substep is a number g, for a Stormer-Verlet step of length g h (half a kick, a drift, half a kick), or a pair of a
    letter and a weight g, for a drift ("A") or a kick by g h.
    """
    for x in steps:
        if isinstance(x, tuple):
            state = (drift if x[0] == "A" else kick)(state, x[1] * h)
        else:
            state = kick(drift(kick(state, x * h / 2), x * h), x * h / 2)
    return state


def plain(pre, kernel, post, steps):
    """Integrate `SYSTEM` by a processed method, programmed plainly; return the end state (x, y, u, v).

    The substeps ``pre`` (processor) are applied first, then ``kernel`` as often as ``steps`` says, then ``post`` (the
    inverse of the processor).
    """
    h, state = mpmath.mpf(H), tuple(map(mpmath.mpf, (*START[0], *START[1])))
    state = act(state, pre, h)
    for _ in range(steps):
        state = act(state, kernel, h)
    return act(state, post, h)


def of(id: str) -> dict:
    """Compare the processed method ``id`` with the plain implementation.

    Returns a dict of lists with an entry for each number of `STEPS`: "distance" from the plain run, "control" (distance
    of a plain run with a slightly wrong processor) and "ends" (end states).
    """
    out = {"distance": [], "control": [], "ends": []}
    with precision(DIGITS):
        table, numbers = coefficients.table(id), coefficients.polished_numbers(id)
        pre, kernel = table.pre(numbers), table.kernel(numbers)
        post = [(x[0], -x[1]) if isinstance(x, tuple) else -x for x in pre[::-1]]
        last = pre[-1]
        other = [*pre[:-1], (last[0], last[1] + SPOILED) if isinstance(last, tuple) else last + SPOILED]
        for steps in STEPS:
            wanted = plain(pre, kernel, post, steps)
            s = integrate(
                SYSTEM, id, h=H, steps=steps, q0=START[0], p0=START[1], save_every=steps, arithmetic=MULTIPRECISION
            )
            out["distance"].append(distance(s, wanted))
            out["control"].append(float(apart(plain(other, kernel, post, steps), wanted)))
            out["ends"].append([float(x) for x in wanted])
    return out


if __name__ == "__main__":
    print(json.dumps({"result": {id: of(id) for id in [t.name for t in coefficients.GROUPS["processed"]]}}))
