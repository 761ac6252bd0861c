r"""Wisdom-Holman splittings H = A + B: A is a sum of Kepler problems and free motions, B the interaction of positions.

In the variables :math:`Q = C q, P = C^{-T} p` (for N bodies Jacobi's),

.. math:: A = \sum_k \frac{|P_k|^2}{2 m_k} - \frac{m_k\mu_k}{|Q_k|},\qquad
          B = V(C^{-1} Q) + \sum_k \frac{m_k\mu_k}{|Q_k|},

``plan`` holds rows (drift along A, kick by B), the last with a drift alone.  The last drift of a step and the first of
the next are one; a stored row is finished on a copy, so that rows change nothing of the trajectory.  Q, P are kept
between pieces of a run (``state[4, 0]`` is 1 once they are), and converted for rows.

A symplectic corrector K is applied once at the start and undone on every row.  To first order in B the step
:math:`e^{hA/2}e^{hB}e^{hA/2}` has every kick in its middle; with :math:`B(t) = e^{t\,\mathrm{ad}_A} B` and
:math:`x = h\,\mathrm{ad}_A` what has to be added at the start is

.. math:: \Bigl[\frac{1}{2\sinh(x/2)} - \frac1x\Bigr] hB = h\Bigl[-\frac{x}{24} + \frac{7 x^3}{5760} - \dots\Bigr] B,

and n pairs of kicks :math:`\pm\beta_j` at the times :math:`\pm j\alpha h` make :math:`2\sum_j\beta_j\sinh(j\alpha x)`
agree with it up to :math:`x^{2n - 1}`: the corrector of order 2 n + 1, with an error of :math:`B h^{2n + 2} + B^2 h^2`.

Sources: J. Wisdom, M. Holman, Astron. J. 102 (1991) 1528-1538; J. Wisdom, M. Holman, J. Touma, Fields Inst. Commun. 10
(1996) 217-244 and J. Wisdom, Astron. J. 131 (2006) 2294-2298 (correctors); H. Rein, D. Tamayo, Mon. Not. R. Astron.
Soc. 452 (2015) 376-388 (mu_k = G times the mass inside and of body k).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import mpmath
import sympy as sp

from phasebench.integrators.coefficients.fractions import DIGITS
from phasebench.integrators.engine import codegen
from phasebench.integrators.engine import kepler_flow as kepler_solver
from phasebench.integrators.engine.codegen import DOUBLE
from phasebench.integrators.engine.kepler_flow import add
from phasebench.integrators.engine.kernel import Prepared, array
from phasebench.integrators.engine.vector import jit, load, store
from phasebench.integrators.errors import InvalidInput

#: Rows of the table: the solver's constants; (bodies, dimension, rows of the corrector); masses; mu; C; C^-1; the
#: corrector.
SIZES, MASSES, MU, CHANGE = kepler_solver.ROWS, kepler_solver.ROWS + 1, kepler_solver.ROWS + 2, kepler_solver.ROWS + 3


@dataclass(frozen=True)
class KeplerPart:
    """What a Hamiltonian's Kepler part is; numbers are exact (SymPy rationals).

    Attributes
    ----------
    dimension : of space, 2 or 3; coordinates stand body after body
    masses : N numbers, the masses m_k of the new variables
    mu : N numbers, their gravitational parameters; 0 where the motion is free
    change : N x N numbers, Q_k = sum_j change[k][j] q_j by bodies; () for the variables as they are
    """

    dimension: int
    masses: tuple
    mu: tuple
    change: tuple[tuple, ...] = ()

    @cached_property
    def matrix(self) -> sp.Matrix:
        """C, N x N."""
        return sp.Matrix(self.change) if self.change else sp.eye(len(self.masses))

    def potential(self, q: Sequence[sp.Symbol]) -> sp.Expr:
        """The sum of -m_k mu_k / |Q_k| as an expression in the original coordinates."""
        n, total = self.dimension, sp.Integer(0)
        for k, (m, mu) in enumerate(zip(self.masses, self.mu, strict=True)):
            Q = [sum(c * q[j * n + i] for j, c in enumerate(self.matrix.row(k))) for i in range(n)]
            total -= m * mu / sp.sqrt(sum(x**2 for x in Q))
        return total

    def interaction(self, system, arithmetic: str = DOUBLE):
        """q -> the gradient of the potential without the Kepler potentials, in the original coordinates."""
        U = system.potential - self.potential(system.q)
        T = codegen.value_type(system.d)
        return system.made(
            f"interaction {self}", [("q", system.q)], lambda: [[sp.diff(U, x) for x in system.q]], T(T), arithmetic
        )


def jacobi(masses: Sequence, G, dimension: int = 3) -> KeplerPart:
    """The Kepler part of bodies of those masses, the central one first: the centre of mass and Jacobi coordinates.

    Row 0 is the centre of mass, row k body k relative to the centre of mass of those before it.
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
    """The corrector of order 3, 5, 7, ...: kicks (time, strength) in units of h, in their order; () for order 1.

    Each pair comes in two halves, one in either order of time (Wisdom 2006); the orders 5 to 17 are WHFast's.
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


def _substeps(kicks):
    """Kicks (time, strength) as rows (drift, kick) with the drift back at the end; two at one time are one."""
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
def _drift(X, h, eps, table, counts):
    """The flow of A on the rows (Q, P, what rounding lost) of X."""
    dimension = int(table[SIZES, 1])
    for k in range(int(table[SIZES, 0])):
        counts[4] += kepler_solver.advance(X, k * dimension, dimension, table[MASSES, k], table[MU, k], h, eps, table)


@jit
def _convert(X, row, table, first, transposed, Y, out):
    """Row ``out`` of Y = the matrix in the rows ``first``, ... of the table, or its transpose, times a row of X."""
    bodies, dimension = int(table[SIZES, 0]), int(table[SIZES, 1])
    for k in range(bodies):
        for i in range(dimension):
            total = X[row, i] * 0
            for j in range(bodies):
                c = table[first + j, k] if transposed else table[first + k, j]
                total = total + c * X[row, j * dimension + i]
            Y[out, k * dimension + i] = total


@jit
def _kick(dB, X, h, zero, table, memory, counts):
    """The flow of B on the rows of X; rows 4 to 6 of ``memory`` are overwritten."""
    bodies = int(table[SIZES, 0])
    _convert(X, 0, table, CHANGE + bodies, False, memory, 4)
    store(memory, 5, dB(load(memory, 4, zero)))
    _convert(memory, 5, table, CHANGE + bodies, True, memory, 6)
    for i in range(len(zero)):
        X[1, i], X[3, i] = add(X[1, i], X[3, i], -h * memory[6, i])
    counts[1] += 1


@jit
def _correct(dB, X, h, sign, eps, zero, table, memory, counts):
    """The corrector (sign 1) or its inverse (-1) on the rows of X: it is the same backwards in time."""
    first = CHANGE + 2 * int(table[SIZES, 0])
    rows = int(table[SIZES, 2])
    for k in range(rows):
        _drift(X, table[first + k, 0] * h, eps, table, counts)
        if k + 1 < rows:
            _kick(dB, X, sign * table[first + k, 1] * h, zero, table, memory, counts)


def run(dB, plan, table, h, every, eps, zero, state, memory, work, Q, P, aux, counts):
    """Fill the rows of Q and P, each after ``every`` steps; returns (rows filled, status)."""
    bodies = int(table[SIZES, 0])
    stages = len(plan) - 1
    between = (plan[stages, 0] + plan[0, 0]) * h
    lead = between
    if state[4, 0] == 0:
        _convert(state, 0, table, CHANGE, False, memory, 0)
        _convert(state, 1, table, CHANGE + bodies, True, memory, 1)
        store(state, 0, load(memory, 0, zero))
        store(state, 1, load(memory, 1, zero))
        _correct(dB, state, h, 1, eps, zero, table, memory, counts)
        state[4, 0] = state[4, 0] + 1
        lead = plan[0, 0] * h
    for row in range(len(Q)):
        for _ in range(every):
            _drift(state, lead, eps, table, counts)
            for k in range(stages):
                if k > 0:
                    _drift(state, plan[k, 0] * h, eps, table, counts)
                _kick(dB, state, plan[k, 1] * h, zero, table, memory, counts)
            lead = between
        for i in range(4):
            store(memory, i, load(state, i, zero))
        _drift(memory, plan[stages, 0] * h, eps, table, counts)
        _correct(dB, memory, h, -1, eps, zero, table, memory, counts)
        _convert(memory, 0, table, CHANGE + bodies, False, Q, row)
        _convert(memory, 1, table, CHANGE, True, P, row)
    counts[0] += len(Q) * every
    return len(Q), 0


def _check(system) -> None:
    """Whether T is |P_k|^2 / (2 m_k) summed in the variables declared; raises InvalidInput where it is not."""
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


def prepare(method, system, arithmetic):
    """Drifts, kicks and the corrector of the record; the interaction's gradient."""
    part = system.kepler
    _check(system)
    drifts, kicks, order = method.data
    rows = [[a, b] for a, b in zip(drifts, (*kicks, 0), strict=True)]
    correcting = _substeps(corrector(order))
    n, change = len(part.masses), part.matrix
    table = [
        *kepler_solver.constants(arithmetic),
        [n, part.dimension, len(correcting)],
        part.masses,
        part.mu,
        *change.tolist(),
        *change.inv().tolist(),
        *correcting,
    ]
    functions = (part.interaction(system, arithmetic),)
    return Prepared(run, functions, array(rows, arithmetic), array(table, arithmetic), system.d, 1, implicit=False)
