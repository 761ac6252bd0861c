r"""Wisdom-Holman splittings H = A + B: A is a sum of Kepler problems and free motions, B the interaction of positions.

In the variables :math:`Q = C q, P = C^{-T} p` (for N bodies Jacobi's),

.. math:: A = \sum_k \frac{|P_k|^2}{2 m_k} - \frac{m_k\mu_k}{|Q_k|},\qquad
          B = V(C^{-1} Q) + \sum_k \frac{m_k\mu_k}{|Q_k|}.

A step is a sequence of drifts along A and kicks by B, with a drift at either end.  The last drift of a step is merged
with the first of the next; for a row of output the step is completed on a copy, so that rows do not change the
trajectory.  Q, P are kept between calls of the kernel, and converted for rows.  If the potential is a sum of inverse
distances of several bodies in space, `planet_lanes` takes the same steps for all bodies side by side in SIMD lanes.

A symplectic corrector K is applied once at the start and undone on every row.  To first order in B the step
:math:`e^{hA/2}e^{hB}e^{hA/2}` has every kick in its middle; with :math:`B(t) = e^{t\,\mathrm{ad}_A} B` and
:math:`x = h\,\mathrm{ad}_A` the terms to be added at the start are

.. math:: \Bigl[\frac{1}{2\sinh(x/2)} - \frac1x\Bigr] hB = h\Bigl[-\frac{x}{24} + \frac{7 x^3}{5760} - \dots\Bigr] B,

and n pairs of kicks :math:`\pm\beta_j` at the times :math:`\pm j\alpha h` make :math:`2\sum_j\beta_j\sinh(j\alpha x)`
agree with it up to :math:`x^{2n - 1}`: the corrector of order 2 n + 1, with an error of :math:`B h^{2n + 2} + B^2 h^2`.

Sources: J. Wisdom, M. Holman, Astron. J. 102 (1991) 1528-1538; J. Wisdom, M. Holman, J. Touma, Fields Inst. Commun. 10
(1996) 217-244 and J. Wisdom, Astron. J. 131 (2006) 2294-2298 (correctors); H. Rein, D. Tamayo, Mon. Not. R. Astron.
Soc. 452 (2015) 376-388 (mu_k = G times the mass inside and of body k).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import mpmath
import numpy as np

from phasebench.integrators.coefficients.fractions import DIGITS
from phasebench.integrators.compile import codegen
from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.compile.lazy import sympy as sp
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.stepping import kepler_flow
from phasebench.integrators.stepping.kepler_flow import add
from phasebench.integrators.stepping.kernel import Prepared, array, numbers
from phasebench.integrators.values.vector import jit, load, store

from . import planet_pairs

if TYPE_CHECKING:
    from phasebench.integrators.record import Method
    from phasebench.integrators.stepping.kernel import Carry, Samples
    from phasebench.integrators.systems.hamiltonian import Hamiltonian
    from phasebench.integrators.values.kinds import Function, Number


class WisdomHolman(NamedTuple):
    """The data of a Wisdom-Holman method.

    Attributes
    ----------
    dB : the gradient of the interaction B with respect to the original coordinates q
    substeps, corrector : rows (drift, kick), fractions of h; a drift is along the Kepler motions, a kick by the
        interaction
    dimension : of space, 2 or 3
    masses, mu : masses and gravitational parameters of the Kepler problems; mu = 0 for a free motion
    change, back : the matrices of Q = change q and q = back Q, acting on bodies; Q are the variables of the Kepler
        motions
    series : the table `kepler_flow.constants`
    h, eps : the step size and the unit round-off, set by the run
    """

    dB: Callable
    substeps: np.ndarray
    corrector: np.ndarray
    dimension: int
    masses: np.ndarray
    mu: np.ndarray
    change: np.ndarray
    back: np.ndarray
    series: np.ndarray
    h: float = 0.0
    eps: float = 0.0


@dataclass(frozen=True)
class KeplerPart:
    """The part of a Hamiltonian that is a sum of Kepler problems; numbers are exact (SymPy rationals).

    Attributes
    ----------
    dimension : of space, 2 or 3; coordinates stand body after body
    masses : N numbers, the masses m_k of the new variables
    mu : N numbers, their gravitational parameters; 0 if the motion is free
    change : N x N numbers, Q_k = sum_j change[k][j] q_j by bodies; () for the original variables
    """

    dimension: int
    masses: tuple
    mu: tuple
    change: tuple[tuple, ...] = ()

    @cached_property
    def matrix(self) -> sp.Matrix:
        """The matrix C of the variables Q = C q, N x N, acting on bodies."""
        return sp.Matrix(self.change) if self.change else sp.eye(len(self.masses))

    def potential(self, q: Sequence[sp.Symbol]) -> sp.Expr:
        """The sum of -m_k mu_k / |Q_k| as an expression in the original coordinates."""
        n, total = self.dimension, sp.Integer(0)
        for k, (m, mu) in enumerate(zip(self.masses, self.mu, strict=True)):
            Q = [sum(c * q[j * n + i] for j, c in enumerate(self.matrix.row(k))) for i in range(n)]
            total -= m * mu / sp.sqrt(sum(x**2 for x in Q))
        return total

    def interaction(self, system: Hamiltonian, arithmetic: str = DOUBLE) -> Function:
        """Make the function q -> gradient of the interaction, the potential without its Kepler part.

        q and the gradient are those of the original coordinates, arrays or tuples (d,).
        """
        U = system.potential - self.potential(system.q)
        T = codegen.value_type(system.d)
        return system.make_function(
            f"interaction {self}", [("q", system.q)], lambda: [[sp.diff(U, x) for x in system.q]], T(T), arithmetic
        )


def jacobi(masses: Sequence, G: sp.Expr | int, dimension: int = 3) -> KeplerPart:
    """The Kepler part of bodies with the given masses in Jacobi coordinates, the central body first.

    G is the gravitational constant.  Row 0 of the matrix ``change`` is the centre of mass, row k is body k relative to
    the centre of mass of the bodies before it.
    """
    masses = [sp.sympify(m) for m in masses]
    inside = [sum(masses[:k]) for k in range(len(masses) + 1)]
    rows, reduced, mu = [tuple(m / inside[-1] for m in masses)], [inside[-1]], [sp.Integer(0)]
    for k in range(1, len(masses)):
        rows.append(
            tuple(-m / inside[k] for m in masses[:k]) + (sp.Integer(1),) + (sp.Integer(0),) * (len(masses) - k - 1)
        )
        reduced.append(masses[k] * inside[k] / inside[k + 1])
        mu.append(sp.sympify(G) * inside[k + 1])
    return KeplerPart(dimension, tuple(reduced), tuple(mu), tuple(rows))


def corrector(order: int) -> tuple[tuple[mpmath.mpf, mpmath.mpf], ...]:
    """The symplectic corrector of order 3, 5, 7, ..., as kicks ((time, strength), ...) in units of h; () for order 1.

    Each pair of kicks, at the times plus and minus j alpha h, is applied twice with half its strength, the second time
    with the two kicks in reverse order (Wisdom 2006); the orders 5 to 17 are WHFast's.
    """
    n = (order - 1) // 2
    with mpmath.workdps(DIGITS):
        alpha = mpmath.sqrt(mpmath.mpf(7) / 40)
        # 1/(2 sinh(x/2)) - 1/x = -sum (2^(2k-1) - 1) B_2k / (2^(2k-1) (2k)!) x^(2k-1)
        wanted = [
            -(1 - mpmath.mpf(2) ** (1 - 2 * k)) * mpmath.bernoulli(2 * k) / mpmath.factorial(2 * k)
            for k in range(1, n + 1)
        ]
        if not n:
            return ()
        powers = mpmath.matrix(
            [
                [2 * (j * alpha) ** (2 * k - 1) / mpmath.factorial(2 * k - 1) for j in range(1, n + 1)]
                for k in range(1, n + 1)
            ]
        )
        strength = mpmath.lu_solve(powers, mpmath.matrix(wanted))
        half = []
        for j in range(n, 0, -1):
            half += [(-j * alpha, -strength[j - 1] / 2), (j * alpha, strength[j - 1] / 2)]
        return (*half, *reversed(half))


def _substeps(kicks: Sequence[tuple[mpmath.mpf, mpmath.mpf]]) -> list[list]:
    """Convert kicks (time, strength) to rows (drift, kick) in units of h, merging kicks at one time.

    The drift of a row leads from the time of the previous kick, at first 0, to that of the row's kick; a last row has a
    drift back to time 0 and no kick.
    """
    rows, at = [], mpmath.mpf(0)
    with mpmath.workdps(DIGITS):
        for time, strength in kicks:
            if rows and time == at:
                rows[-1][1] += strength
            else:
                rows.append([time - at, strength])
            at = time
        return [*rows, [-at, 0]] if rows else []


@jit
def drift(step: WisdomHolman, X: np.ndarray, h: Number) -> None:
    """Move all bodies along their Kepler orbits over the time h, exp(h A), in place.

    The rows of X are Q, P, and what rounding lost of each.
    """
    n = step.dimension
    for k in range(len(step.mu)):
        kepler_flow.advance(X, k * n, n, step.masses[k], step.mu[k], h, step.eps, step.series)


@jit
def convert(matrix: np.ndarray, X: np.ndarray, row: int, n: int, Y: np.ndarray, out: int) -> None:
    """Multiply the bodies' vectors in row ``row`` of X by a matrix that acts on bodies; write row ``out`` of Y.

    A row has the vectors of all bodies, one after the other, with n components each.
    """
    for k in range(len(matrix)):
        for i in range(n):
            total = X[row, i] * 0
            for j in range(len(matrix)):
                total = total + matrix[k, j] * X[row, j * n + i]
            Y[out, k * n + i] = total


@jit
def _kick(step: WisdomHolman, X: np.ndarray, h: Number, carry: Carry, counts: np.record) -> None:
    """Kick the momenta P by the interaction over the time h, exp(h B), in place.

    The rows of X are Q, P, and what rounding lost of each; rows 4 to 6 of ``carry.memory`` are overwritten.
    """
    memory, n = carry.memory, step.dimension
    convert(step.back, X, 0, n, memory, 4)
    store(memory, 5, step.dB(load(memory, 4, carry.zero)))
    convert(step.back.T, memory, 5, n, memory, 6)
    for i in range(len(carry.zero)):
        X[1, i], X[3, i] = add(X[1, i], X[3, i], -h * memory[6, i])
    counts.gradient += 1


@jit
def _correct(step: WisdomHolman, X: np.ndarray, sign: int, carry: Carry, counts: np.record) -> None:
    """Apply the symplectic corrector (sign 1), or its inverse (sign -1, kicks reversed), to X in place.

    The rows of X are Q, P, and what rounding lost of each.
    """
    rows = len(step.corrector)
    for k in range(rows):
        drift(step, X, step.corrector[k, 0] * step.h)
        if k + 1 < rows:
            _kick(step, X, sign * step.corrector[k, 1] * step.h, carry, counts)


def run(step: WisdomHolman, carry: Carry, samples: Samples, counts: np.record) -> tuple[int, int]:
    """The kernel: integrate the steps between rows of output and fill the rows; returns (rows filled, status 0).

    It has a loop of its own, since rows need the corrector's inverse, and drifts of neighbouring steps are merged.
    """
    state, memory, zero = carry.state, carry.memory, carry.zero
    a, n, h = step.substeps, step.dimension, step.h
    stages = len(a) - 1
    between = (a[stages, 0] + a[0, 0]) * h
    lead = between
    if counts.steps == 0:
        convert(step.change, state, 0, n, memory, 0)
        convert(step.back.T, state, 1, n, memory, 1)
        store(state, 0, load(memory, 0, zero))
        store(state, 1, load(memory, 1, zero))
        _correct(step, state, 1, carry, counts)
        lead = a[0, 0] * h
    for row in range(len(samples.q)):
        for _ in range(samples.every):
            drift(step, state, lead)  # exp(a_0 h A), with the last of the step before
            for k in range(stages):
                if k > 0:
                    drift(step, state, a[k, 0] * h)  # exp(a_k h A)
                _kick(step, state, a[k, 1] * h, carry, counts)  # exp(b_k h B)
            lead = between
        for i in range(4):
            store(memory, i, load(state, i, zero))
        drift(step, memory, a[stages, 0] * h)
        _correct(step, memory, -1, carry, counts)
        convert(step.back, memory, 0, n, samples.q, row)
        convert(step.change.T, memory, 1, n, samples.p, row)
    counts.steps += len(samples.q) * samples.every
    return len(samples.q), 0


def check_kinetic_energy(system: Hamiltonian) -> None:
    """Raise InvalidInput unless T is the sum of |P_k|^2 / (2 m_k) in the variables of the declared Kepler part."""
    part, d = system.kepler, system.d
    if not system.quadratic_kinetic or len(part.masses) * part.dimension != d:
        raise InvalidInput(
            f"the Kepler part is of {len(part.masses)} x {part.dimension} coordinates, the system of {d}"
        )
    B = part.matrix.inv()
    M = B * sp.diag(*(1 / sp.sympify(m) for m in part.masses)) * B.T
    for k, velocity in enumerate(system.dq):
        row = M.row(k // part.dimension)
        P = system.p[k % part.dimension :: part.dimension]
        if sp.expand(velocity - sum(c * p for c, p in zip(row, P, strict=True))) != 0:
            raise InvalidInput(f"the kinetic energy in {system.p[k]} is not that of the Kepler part declared")


def prepare(method: Method, system: Hamiltonian, arithmetic: str) -> Prepared:
    """Prepare the kernel (compiled loop over steps) of a Wisdom-Holman method for a system.

    ``method.data`` is (drifts, kicks, order of the corrector), drifts and kicks as fractions of h; masses and variables
    are those of the system's `KeplerPart`.  For several bodies in space the kernel of `planet_lanes` is used where it
    applies.
    """
    part = system.kepler
    check_kinetic_energy(system)
    drifts, kicks, order = method.data
    rows = [[a, b] for a, b in zip(drifts, (*kicks, 0), strict=True)]
    change = part.matrix
    tables = {
        "substeps": array(rows, arithmetic),
        "corrector": array(_substeps(corrector(order)), arithmetic),
        "series": array(kepler_flow.constants(arithmetic), arithmetic),
    }
    in_lanes = planet_pairs.prepare(part, system, tables) if arithmetic == DOUBLE else None
    if in_lanes is not None:
        return in_lanes
    step = WisdomHolman(
        dB=part.interaction(system, arithmetic),
        dimension=part.dimension,
        masses=numbers(part.masses, arithmetic),
        mu=numbers(part.mu, arithmetic),
        change=array(change.tolist(), arithmetic),
        back=array(change.inv().tolist(), arithmetic),
        **tables,
    )
    return Prepared(run, step, system.d, 1, implicit=False)
