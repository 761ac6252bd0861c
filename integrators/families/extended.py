r"""Explicit methods for every H with a second copy of the state, integrated along with it: Tao's and Pihajoki's.

To the state (q, p) belongs a copy (x, y), equal to it at the start.  In the extended phase space, with the pairs (q, p)
and (x, y), the Hamiltonian

.. math::
    \underbrace{H(q, y)}_A + \underbrace{H(x, p)}_B
    + \underbrace{\tfrac\omega2\bigl(|q - x|^2 + |p - y|^2\bigr)}_C

has on equal copies the flow of H in each of them.  The flow of each part is explicit: A moves x and p by the field at
(q, y), B moves q and y by the field at (x, p), C turns (q - x, p - y) by the angle :math:`2\omega h`.  Tao's step is

.. math:: e^{\frac h2A}\,e^{\frac h2B}\,e^{hC}\,e^{\frac h2B}\,e^{\frac h2A},

Pihajoki's, without the bond C, is :math:`e^{\frac h2A}e^{hB}e^{\frac h2A}`.  Higher orders are compositions of steps.
:math:`\omega` has the unit of p / (q t), and equal units of q and p are taken for granted: 20 suits states and times of
size 1.  A larger one keeps the copies closer together, and needs a shorter step.
The last substep A of a step is merged with the first of the next, except where a row of output is stored, so that
Tao's step takes three evaluations of the field, Pihajoki's two.

The steps are symplectic and symmetric in the extended phase space.  The map of (q, p) alone, with a new copy in
every step, is neither: so the copy is kept from row to row, and rows have q and p.  For H = T(p) + V(q) Pihajoki's q
and p are those of Stormer-Verlet; for other H nothing keeps the copies together.

Sources: M. Tao, Phys. Rev. E 94 (2016) 043303; P. Pihajoki, Celest. Mech. Dyn. Astron. 121 (2015)
211-231, without its mixing maps.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import mpmath
import numpy as np

from phasebench.integrators.coefficients.copies import lengths_of_a
from phasebench.integrators.coefficients.fractions import DIGITS, times
from phasebench.integrators.stepping.codes import SOLVED
from phasebench.integrators.stepping.kernel import Prepared, numbers
from phasebench.integrators.stepping.loop import loop
from phasebench.integrators.values.elementary import cos, sin
from phasebench.integrators.values.vector import (
    add_product_in_place,
    axpy,
    inline,
    load,
    minus,
    plus,
    read_state,
    scale,
    store,
)

if TYPE_CHECKING:
    from phasebench.integrators.record import Method
    from phasebench.integrators.stepping.kernel import Carry
    from phasebench.integrators.systems.hamiltonian import Hamiltonian
    from phasebench.integrators.values.kinds import Number

#: Orbits may be integrated side by side.
IN_LANES = True
#: The first of the state's spare rows: x, y, and what rounding lost of x and of y.
COPY = 4


class Extended(NamedTuple):
    """The field of H, and the substeps of a step: A over a[0] h, then for k = 1, 2, ... the substeps B, C, B and A.

    A, B and C are the parts of the extended Hamiltonian (see the module): H(q, y), H(x, p) and the bond of the copies.

    Attributes
    ----------
    field : the vector field (q', p')
    a : the k-th substep A has the length a[k] h
    before, after : the substeps B before and after the k-th C have the lengths before[k] h and after[k] h
    bond : the k-th C turns (q - x, p - y) by the angle 2 bond[k] h
    h, eps : the step size and the unit round-off, set by the run
    """

    field: Callable
    a: np.ndarray
    before: np.ndarray
    bond: np.ndarray
    after: np.ndarray
    h: float = 0.0
    eps: float = 0.0


class Copies(NamedTuple):
    """The state (q, p), its copy (x, y), and the field at (q, y).

    Attributes
    ----------
    q, p, x, y : the state and the copy of q and of p
    lost_q, lost_p, lost_x, lost_y : what rounding lost of each (compensation)
    dq, dp : the field at (q, y)
    rows : the table in which the copy is kept between calls of the kernel
    """

    q: Any
    p: Any
    lost_q: Any
    lost_p: Any
    x: Any
    y: Any
    lost_x: Any
    lost_y: Any
    dq: Any
    dp: Any
    rows: Any


@inline
def move_copy(z: Copies, h: Number) -> Copies:
    """Apply exp(h A) to the two copies z: x and p move by the field at (q, y); returns the new `Copies`."""
    x, lost_x = add_product_in_place(z.x, z.lost_x, h, z.dq)
    p, lost_p = add_product_in_place(z.p, z.lost_p, h, z.dp)
    return Copies(z.q, p, z.lost_q, lost_p, x, z.y, lost_x, z.lost_y, z.dq, z.dp, z.rows)


def begin(method: Extended, carry: Carry, counts: np.record) -> Copies:
    """Read the state and its copy from ``carry``, and evaluate the field.

    At the start of a run the copy equals the state.  The coefficients of the rotations C (of the differences q - x and
    p - y of the copies) are computed as well, and written to ``carry.memory``.
    """
    rows = carry.state
    if counts.steps == 0:
        for k in range(4):
            store(rows, COPY + k, load(rows, k, carry.zero))
    for k in range(1, len(method.bond)):
        half = method.bond[k] * method.h
        sine = sin(half)
        carry.memory[k, 0] = -sine * sine  # (cos 2a - 1) / 2
        carry.memory[k, 1] = sine * cos(half)  # sin(2a) / 2
    z = read_state(carry)
    x, y = load(rows, COPY, carry.zero), load(rows, COPY + 1, carry.zero)
    lost_x, lost_y = load(rows, COPY + 2, carry.zero), load(rows, COPY + 3, carry.zero)
    dq, dp = method.field(z.q, y, method.h, 0.0)
    counts.gradient += 1
    return Copies(z.q, z.p, z.lost_q, z.lost_p, x, y, lost_x, lost_y, dq, dp, rows)


def start(method: Extended, z: Copies) -> Copies:
    """Apply a step's first substep A (see `move_copy`); in later steps the last A of the step before includes it."""
    return move_copy(z, method.a[0] * method.h)


def step(method: Extended, z: Copies, carry: Carry, counts: np.record) -> tuple[Copies, int]:
    """Take a step from the two copies z: apply B, C, B and A for each composed step in turn.

    They are the flows of the parts of the extended Hamiltonian (see `Extended`): A moves x and p by the field at
    (q, y), B moves q and y by the field at (x, p), C turns (q - x, p - y), with coefficients in ``carry.memory``.  The
    last A includes the first A of the next step.  Returns (copies, `SOLVED`), and adds evaluations to ``counts``.
    """
    h, last = method.h, len(method.a) - 1
    q, p, lost_q, lost_p, x, y, lost_x, lost_y, dq, dp, rows = z
    for k in range(1, last + 1):
        dq, dp = method.field(x, p, h, 0.0)
        counts.gradient += 1
        q, lost_q = add_product_in_place(q, lost_q, method.before[k] * h, dq)  # exp(b_k h B)
        y, lost_y = add_product_in_place(y, lost_y, method.before[k] * h, dp)
        if method.bond[k] != 0:
            u = plus(minus(q, x), minus(lost_q, lost_x))
            v = plus(minus(p, y), minus(lost_p, lost_y))
            a, b = carry.memory[k, 0], carry.memory[k, 1]
            dq, dp = axpy(b, v, scale(a, u)), axpy(-b, u, scale(a, v))
            q, lost_q = add_product_in_place(q, lost_q, 1.0, dq)  # exp(c_k h C)
            p, lost_p = add_product_in_place(p, lost_p, 1.0, dp)
            x, lost_x = add_product_in_place(x, lost_x, -1.0, dq)
            y, lost_y = add_product_in_place(y, lost_y, -1.0, dp)
        if method.after[k] != 0:
            dq, dp = method.field(x, p, h, 0.0)
            counts.gradient += 1
            q, lost_q = add_product_in_place(q, lost_q, method.after[k] * h, dq)  # exp(b_k h B)
            y, lost_y = add_product_in_place(y, lost_y, method.after[k] * h, dp)
        dq, dp = method.field(q, y, h, 0.0)
        counts.gradient += 1
        length = method.a[k] * h
        if k == last:
            length += method.a[0] * h
        x, lost_x = add_product_in_place(x, lost_x, length, dq)  # exp(a_k h A)
        p, lost_p = add_product_in_place(p, lost_p, length, dp)
    return Copies(q, p, lost_q, lost_p, x, y, lost_x, lost_y, dq, dp, rows), SOLVED


def finish(method: Extended, z: Copies) -> Copies:
    """Undo the next step's first substep A, which `step` has merged with its own last, and store the copy (x, y)."""
    z = move_copy(z, -method.a[0] * method.h)
    store(z.rows, COPY, z.x)
    store(z.rows, COPY + 1, z.y)
    store(z.rows, COPY + 2, z.lost_x)
    store(z.rows, COPY + 3, z.lost_y)
    return z


run = loop(step, begin, start, finish)


def prepare(method: Method, system: Hamiltonian, arithmetic: str) -> Prepared:
    """Prepare the kernel (compiled loop over steps) of a method with two copies of the state, for a system.

    ``method.data`` is (fractions of h of the composed steps, omega); omega is the strength of the bond C between the
    copies, None if there is no bond.
    """
    fractions, omega = method.data
    none = [0] * len(fractions)
    bonds, before, after = none, fractions, none
    if omega is not None:
        with mpmath.workdps(DIGITS):
            half = [f / 2 for f in fractions]
        bonds, before, after = [times(f, omega) for f in fractions], half, half
    columns = (numbers(x, arithmetic) for x in (lengths_of_a(fractions), [0, *before], [0, *bonds], [0, *after]))
    return Prepared(run, Extended(system.field(arithmetic), *columns), 2, 4, implicit=False)
