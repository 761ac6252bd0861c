r"""Gauss's methods with steps that follow the field along the orbit: variable steps for any H.

The polynomials through f at the nodes of a step give the derivatives of f at the step's end, and these the next step,

.. math::
    \Delta t = h\,\frac{\tau}{T},\qquad
    \tau^2 = \frac{|f|\,|f''| + |f'|^2}{|f'|\,|f'''| + |f''|^2}.

Here f are the accelerations if :math:`H = \sum p_i^2 / 2 m_i + V(q)`, and T, the time scale of the initial state, is
:math:`T^2 = |q_0|/|q_0''|` (if :math:`q_0 = 0`, :math:`T = |q_0'|/|q_0''|`).  For any other H the shorter :math:`\tau`
of q' and p' is used, and T is the longer of the times

.. math::
    \frac{|q_0|}{\sqrt{|q_0'|^2 + |q_0|\,|q_0''|}}

of q and of p; the second derivatives are differences of the field along itself.  So h is the length of a step where the
field changes as fast as q or p does at the start.  On a harmonic oscillator :math:`\tau` is constant, on a Kepler orbit
it falls with the distance as :math:`r^{3/2}`.

A step is rejected if :math:`\tau` at its end is less than `TRUSTED` times the value by which the step was chosen; if
the highest derivative that s nodes give, as the rate :math:`(|f^{(s-1)}|/|f|)^{1/(s-1)}`, is as large as that (a steep
wall within the step, which :math:`\tau` at the end may not show); if it passes through a wall, behind which a distance
has another sign or the energy another value; or if its equations were not solved.  The step is then repeated with the
length that it suggests, or a quarter.  A step is at most `GROWTH` times the last.  All this looks back only:
the map is neither symmetric nor reversible, and the energy may drift.  Quadratic invariants are kept.

A row of output, the state at a multiple of h in time, is reached by a shorter step from the last state before it.  The
orbit goes on from that last state, so that it does not depend on which rows are stored: where the shorter step is
rejected, the next step of the orbit itself is tried, and decides.

Source: S. J. Aarseth, in Multiple Time Scales (1985) 377-418 (the quotient); H. Rein, D. S. Spiegel, Mon. Not. R.
Astron. Soc. 446 (2015) 1424-1437 (derivatives from the step's own polynomials, rejection at a quarter).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import mpmath
import numpy as np
from numba import types

from phasebench.integrators.compile import codegen
from phasebench.integrators.compile.lazy import sympy as sp
from phasebench.integrators.stepping.codes import OUT_OF_STEP, SOLVED
from phasebench.integrators.stepping.kernel import OWN, Prepared, array
from phasebench.integrators.stepping.loop import time_loop
from phasebench.integrators.values.lanes import put, take, total
from phasebench.integrators.values.vector import dispatch_on_none, inline

from . import adaptive, gauss_lanes, stage_lanes
from .lane_rows import MOMENTA, ORIGIN
from .stage_lanes import begin, equations

if TYPE_CHECKING:
    from phasebench.integrators.families.stage_lanes import Equations
    from phasebench.integrators.record import Method
    from phasebench.integrators.stepping.kernel import Carry
    from phasebench.integrators.systems.hamiltonian import Hamiltonian
    from phasebench.integrators.values.kinds import Function, Number
    from phasebench.integrators.values.vector import State

#: A step is rejected if the fitting one is shorter than this share of it; a step is at most GROWTH times the last.
TRUSTED, GROWTH = 0.25, 4.0
#: The same share for the first step, which is a guess.
FIRST = 0.98
#: tau is made of this many derivatives of f, the zeroth included.
DERIVATIVES = 4
#: The difference of the field along itself is taken over this share of h.
SHIFT = 1e-5
#: Products of derivatives below FLAT round-offs of |f|^2, and a last derivative below ROUGH round-offs of |f|, are
#: round-off alone.
FLAT, ROUGH = 1e5, 1e12
#: A step that was not solved is cut to the share CUT, a rejected one to no less than LEAST; MOST in a row end the run.
CUT, LEAST, MOST = 0.25, 1 / 16, 60
#: Share of the size of H's terms by which a step may change H.
JUMP = 0.01
#: Largest number of steps for one h; more would be a run that never ends.
SHORTEST = 100_000


class Field(NamedTuple):
    """The data of Gauss's method with variable steps, whose lengths follow from the field's time scale on the orbit.

    Attributes
    ----------
    method : the coefficients of Gauss's method, with stages in SIMD lanes
    inverse : the matrix from values of the field at the nodes to the coefficients of the polynomial through them, for
        `adaptive.remember`
    ends : rows of weights of f at the nodes, which give f, f', f'', f''' and the derivative of order s - 1 at the end
        of a step of length 1
    guard : the function (q, p) -> (H, size of its terms, a number for the signs of the distances to singularities)
    h, eps : the length of a step where the time scale tau is that of the initial state, and the unit round-off, set by
        the run
    """

    method: stage_lanes.Lanes
    inverse: np.ndarray
    ends: np.ndarray
    guard: Callable
    h: float = 0.0
    eps: float = 0.0


class Clock(NamedTuple):
    """The time of the last step's end, and what the step-size control remembers.

    Attributes
    ----------
    t, lost : the time and its rounding error (compensation)
    following, last : the lengths of the next step and of the last one
    scale : h divided by the time scale T of the initial state
    """

    t: float
    lost: float
    following: float
    last: float
    scale: float


#: Where the state's spare rows keep the clock between calls.
TIME, LOST, FOLLOWING = (OWN, 0), (OWN, 1), (OWN + 1, 0)
LAST, SCALE = (OWN + 1, 1), (OWN + 2, 1)

#: What a component of f is multiplied by to be an acceleration.
inertia = dispatch_on_none(lambda inverse_mass, e, k: 1.0, lambda inverse_mass, e, k: inverse_mass[0, k])


@inline
def inverse_square(e: Equations, step: Field, first: int, last: int) -> tuple[Number, Number]:
    """Rates of change of f at the end of a step: (1 / tau^2, (|f^(s-1)| / |f|)^2), in units of the step's length.

    f is the vector field along the orbit, with its values at the nodes in the memory of the stage equations e; f^(s-1)
    is the highest derivative that s nodes give, and tau the time scale tau^2 = (|f| |f''| + |f'|^2) / (|f'| |f'''| +
    |f''|^2). In the second number |f|^2 is summed over the nodes.  Only the components first, ..., last - 1 of f count.
    Either number is 0 if it is round-off alone.
    """
    f0, f1, f2, f3, highest, whole = 0.0 * e.h, 0.0 * e.h, 0.0 * e.h, 0.0 * e.h, 0.0 * e.h, 0.0 * e.h
    for k in range(first, last):
        f = inertia(e.step.inverse_mass, e, k) * take(e.memory, e.stages + k, e.like)
        f0 = f0 + total(take(step.ends, 0, e.like) * f) ** 2
        f1 = f1 + total(take(step.ends, 1, e.like) * f) ** 2
        f2 = f2 + total(take(step.ends, 2, e.like) * f) ** 2
        f3 = f3 + total(take(step.ends, 3, e.like) * f) ** 2
        highest = highest + total(take(step.ends, DERIVATIVES, e.like) * f) ** 2
        whole = whole + total(f * f)
    above, below = (f0 * f2) ** 0.5 + f1, (f1 * f3) ** 0.5 + f2
    told, rough = above > FLAT * step.eps * whole, highest > (ROUGH * step.eps) ** 2 * whole
    return (below / above if told else 0.0 * above), (highest / whole if rough else 0.0 * above)


def _of_both(inverse_mass, e, step):
    d = e.stages // 2
    a, b = inverse_square(e, step, 0, d), inverse_square(e, step, d, e.stages)
    return max(a[0], b[0]), max(a[1], b[1])


def _of_kicks(inverse_mass, e, step):
    return inverse_square(e, step, 0, e.stages)


#: (the length of the step / tau)^2, and the square of its last derivative.
rate = dispatch_on_none(_of_both, _of_kicks)


@inline
def _pace(e: Equations, first: int, last: int, shift: Number) -> Number:
    """Return the time scale |y| / sqrt(|y'|^2 + |y| |y''|) of a part y of the state (q, p) at the start of a step.

    The part has the components first, ..., last - 1; the result is 0 if y is 0 or at rest.  y' is the field, and y'' is
    made by a difference: in the memory of the equations e the first SIMD lane has the field at the state moved by
    ``shift`` times the field, and the second the field at the state moved by -``shift`` times the field.
    """
    size, slope, bend = 0.0 * e.h, 0.0 * e.h, 0.0 * e.h
    for k in range(first, last):
        ahead, behind = e.memory[e.stages + k, 0], e.memory[e.stages + k, 1]
        size, slope = size + abs(e.memory[e.base + ORIGIN, k]), slope + abs(0.5 * (ahead + behind))
        bend = bend + abs((ahead - behind) / (2.0 * shift))
    below = slope * slope + size * bend
    return size / below**0.5 if below > 0 else 0.0 * e.h


def _unit_of_both(inverse_mass, e, step):
    d, shift = e.stages // 2, SHIFT * abs(e.h)
    for k in range(e.stages):
        y, f = e.memory[e.base + ORIGIN, k], e.memory[e.stages + k, 0]
        put(e.memory, k, 0.0 * e.weights + (y + shift * f), e.like)
        e.memory[k, 1] = y - shift * f
    step.method.f(e.memory)
    longer = max(_pace(e, 0, d, shift), _pace(e, d, e.stages, shift))
    return longer if longer > 0 else 1.0 + longer


def _unit_of_kicks(inverse_mass, e, step):
    q, v, a = 0.0 * e.h, 0.0 * e.h, 0.0 * e.h
    for k in range(e.stages):
        q, v = q + abs(e.memory[e.base + ORIGIN, k]), v + abs(inverse_mass[0, k] * e.memory[e.base + MOMENTA, k])
        a = a + abs(inverse_mass[0, k] * e.memory[e.stages + k, 0])
    if a > 0 and q > 0:
        return (q / a) ** 0.5
    if a > 0 and v > 0:
        return v / a
    return q / v if v > 0 and q > 0 else 1.0 + 0.0 * q


#: T, where the equations begin and f is known.
unit = dispatch_on_none(_unit_of_both, _unit_of_kicks)


@inline
def read_clock(step: Field, carry: Carry, y: State) -> Clock:
    """Return the `Clock` (time, lengths of steps) that the last call of the kernel left in ``carry``.

    At the start of a run it is a new clock, with the time scale of the field at the state y.
    """
    rows = carry.state
    if rows[FOLLOWING] == 0:
        e = equations(step.method, carry, step.h)
        begin(step.method.inverse_mass, e, y)
        for k in range(e.stages):
            put(e.memory, k, 0.0 * e.weights + e.memory[e.base + ORIGIN, k], e.like)
        step.method.f(e.memory)
        scale = abs(step.h) / unit(step.method.inverse_mass, e, step)
        return Clock(rows[TIME], rows[LOST], step.h, step.h, scale)
    return Clock(rows[TIME], rows[LOST], rows[FOLLOWING], rows[LAST], rows[SCALE])


@inline
def fit_step(step: Field, carry: Carry, clock: Clock, length: Number, trusted: Number) -> tuple[Number, bool]:
    """Judge a step of length ``length``: returns (length of the next step, True if this step is accepted).

    Both follow from the field at the end of the step; ``clock`` has the time scale by which lengths are measured.  The
    step is rejected if the time scale of the field, or of its highest known derivative, fits only a step shorter than
    ``trusted`` times ``length``.
    """
    square, highest = rate(step.method.inverse_mass, equations(step.method, carry, length), step)
    share, rough = square**0.5, highest ** (0.5 / (step.method.stages - 1))
    if not share + rough < np.inf:
        return CUT * length, False
    if clock.scale < trusted * max(share, rough):
        return length * max(clock.scale / max(share, rough), LEAST), False
    if GROWTH * share < clock.scale:
        return GROWTH * length, True
    return length * clock.scale / share, True


@inline
def stays(step: Field, y: State, there: State) -> bool:
    """True if a step from the state y has not passed through a wall: it keeps the energy and the signs of distances."""
    H, size, side = step.guard(y.q, y.p)
    H1, size1, side1 = step.guard(there.q, there.p)
    return abs(H1 - H) <= JUMP * (size + size1) and side == side1


@inline
def wind(
    step: Field, carry: Carry, y: State, clock: Clock, until: Number, most: int, counts: np.record
) -> tuple[State, Clock, State, int]:
    """Integrate from the state y to the time ``until`` in at most ``most`` steps, rejecting steps that are too long.

    ``clock`` has the time at y and the lengths of steps.  Returns (last state before that time, its clock, the state at
    that time, status: `SOLVED` or why the run ends); steps and evaluations are added to ``counts``.
    """
    there, status, tries = y, SOLVED, 0
    last = counts.steps + most
    decided, deciding = False, False  # whether the step that passes the time is known to stand, or is tried for that
    while tries < MOST and counts.steps < last:
        left = (until - clock.t) - clock.lost
        passes = not (abs(clock.following) < abs(left) and left * step.h > 0)
        length = left if passes and not deciding else clock.following
        there, evaluations, status = adaptive.attempt(step.method, step, carry, y, clock, length, counts)
        counts.gradient += evaluations
        fits, good = fit_step(step, carry, clock, length, TRUSTED if counts.steps > 0 else FIRST)
        solved = status == SOLVED and stays(step, y, there)
        good = good and solved
        if passes and not deciding and status == SOLVED and (good or decided):
            return y, clock, there, SOLVED
        if passes and not deciding and not decided:
            deciding = True
        elif good and deciding:
            deciding, decided = False, True
        elif good:
            adaptive.settle(step.method, step, carry, length)
            t = (clock.t + clock.lost) + length
            y, tries = there, 0
            clock = Clock(t, (length + clock.lost) - (t - clock.t), fits, length, clock.scale)
            counts.steps += 1
        else:
            tries, deciding, decided = tries + 1, False, False
            shorter = fits if solved else CUT * length
            clock = Clock(clock.t, clock.lost, shorter, clock.last, clock.scale)
            if not abs(shorter) > step.eps * abs(clock.t):
                return y, clock, there, OUT_OF_STEP
    return y, clock, there, OUT_OF_STEP if status == SOLVED else status


@inline
def reach(
    method: Field, carry: Carry, y: State, clock: Clock, until: Number, every: int, counts: np.record
) -> tuple[State, Clock, State, int]:
    """Integrate to the time ``until`` of a row of output.

    Returns (last state before that time, its clock, the state at that time, status), see `loop.time_loop`; ``every`` is
    the time from row to row divided by h, and limits the number of steps.
    """
    return wind(method, carry, y, clock, until, SHORTEST * every, counts)


@inline
def leave(carry: Carry, clock: Clock) -> None:
    """Store the clock (time, lengths of steps) in the carry, for the next call of the kernel."""
    rows = carry.state
    rows[TIME], rows[LOST], rows[FOLLOWING], rows[LAST] = clock.t, clock.lost, clock.following, clock.last
    rows[SCALE] = clock.scale


run = time_loop(read_clock, reach, leave)


# -- the coefficients of the kernel ------------------------------------------------------------------------------------


def ends_of(s: int, step: stage_lanes.Lanes, arithmetic: str) -> np.ndarray:
    """The weights ``Field.ends``, array (5, lanes): derivatives of f at a step's end from values at its nodes.

    The rows are the derivatives of orders 0, 1, 2, 3 and s - 1, at 1, of the polynomials of degree s - 1 that are 1 at
    one node and 0 at the others; lanes beyond the s nodes of ``step`` are 0.
    """
    with mpmath.workdps(adaptive.digits(arithmetic)):
        inverse = adaptive.coefficients(s)
        falling = [[mpmath.ff(k, j) for k in range(s)] for j in (*range(DERIVATIVES), s - 1)]
        rows = [[mpmath.fdot(row, inverse[:, i]) for i in range(s)] for row in falling]
        return array([gauss_lanes.pad(row, len(step.like), 0) for row in rows], arithmetic)


def guard(system: Hamiltonian, arithmetic: str) -> Function:
    """Make the function ``Field.guard`` of a system."""
    T = codegen.value_type(system.d)

    def results() -> list:
        terms = sp.Add(*(sp.Abs(t) for t in sp.Add.make_args(system.H)))
        signed = [r for r in system.singular if not r.is_nonnegative]
        return [system.H, terms, sp.Add(*(3**k * r / sp.Abs(r) for k, r in enumerate(signed)))]

    signature = types.UniTuple(types.float64, 3)(T, T)
    return system.make_function("guard", [("q", system.q), ("p", system.p)], results, signature, arithmetic)


def prepare(method: Method, system: Hamiltonian, arithmetic: str) -> Prepared:
    """Prepare the kernel (compiled loop over steps) of Gauss's method with variable steps that the field determines.

    ``method.data`` is (s,), the number of stages.
    """
    (s,) = method.data
    lanes = gauss_lanes.build_lanes(s, system, arithmetic)
    inverse, ends = adaptive.inverse_of(s, lanes, arithmetic), ends_of(s, lanes, arithmetic)
    step = Field(lanes, inverse, ends, guard(system, arithmetic))
    width, stages = gauss_lanes.room(lanes, system.d)
    unknowns = stage_lanes.components(lanes.inverse_mass, system.d)
    return Prepared(run, step, width, max(3, stages), linear=len(lanes.like) * unknowns)
