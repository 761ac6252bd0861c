r"""Integrators for a fast linear part, H = |p|^2 / 2 + sum omega_i^2 q_i^2 / 2 + U(q), that resolve only the slow U.

Per component, with :math:`\xi = h\omega`, the slow force :math:`g = -\nabla U`, a propagator R of the linear part and
even functions :math:`\psi_1, \phi` of :math:`\xi`, a step is kick, linear flow, kick:

.. math::
    p \leftarrow p + \tfrac h2 \Psi_1 g(\Phi q),\qquad \binom qp \leftarrow R \binom qp,\qquad
    p \leftarrow p + \tfrac h2 \Psi_1 g(\Phi q).

With the rotation :math:`R_{11} = R_{22} = \cos\xi,\ R_{12} = h\,\mathrm{sinc}\,\xi,\ R_{21} = -\omega\sin\xi` these
are the symmetric trigonometric integrators

.. math::
    q_1 &= \cos\xi\,q_0 + h\,\mathrm{sinc}\,\xi\,p_0 + \tfrac{h^2}2 \Psi g(\Phi q_0), \\
    p_1 &= -\omega\sin\xi\,q_0 + \cos\xi\,p_0 + \tfrac h2\bigl(\Psi_0 g(\Phi q_0) + \Psi_1 g(\Phi q_1)\bigr)

with :math:`\psi = \mathrm{sinc}(\xi)\,\psi_1` and :math:`\psi_0 = \cos(\xi)\,\psi_1`, symplectic for every U
if and only if :math:`\psi = \mathrm{sinc}(\xi)\,\phi` (up to a factor that all frequencies share; of equal
frequencies every method is symplectic).  With the Cayley transform in place of the rotation the step is the
implicit-explicit method; with a power of the Stormer-Verlet matrix (several short steps of the linear part) it is
multiple time stepping.

Where :math:`\mathrm{sinc}\,\xi` vanishes and :math:`\psi` does not, as at odd multiples of pi for the methods of
Gautschi and of Hochbruck and Lubich, :math:`\psi_1` has a pole and p is infinite: h near such a pole is refused.

With :math:`s = \pm 1` such that :math:`c = sR_{11} \ge 0`, R is s times three shears,

.. math::
    p \leftarrow p - aq,\quad q \leftarrow q + bp,\quad p \leftarrow p - aq,\qquad
    b = sR_{12},\quad a = -sR_{21}/(1 + c),

whose determinant is 1 whatever the rounding of a and b, and whose increments are added with compensation.  A kick and
the shear at the same q are merged, so that a step is that of Stormer-Verlet with other coefficients: no rotation
matrix is applied, whose rounding would make the solution grow.

Sources: E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration (2006), XIII.2, equations (2.7)-(2.9);
B. Garcia-Archilla, J. M. Sanz-Serna, R. D. Skeel, SIAM J. Sci. Comput. 20 (1999) 930-963; M. Tuckerman, B. J. Berne,
G. J. Martyna, J. Chem. Phys. 97 (1992) 1990-2001; A. Stern, E. Grinspun, Multiscale Model. Simul. 7 (2009) 1779-1794.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import mpmath
import numpy as np

from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.stepping.codes import SOLVED
from phasebench.integrators.stepping.kernel import Carry, Prepared, array, zeros
from phasebench.integrators.stepping.loop import loop
from phasebench.integrators.values.vector import add, elementwise, inline, load, read_state, scale

if TYPE_CHECKING:
    from phasebench.integrators.record import Method
    from phasebench.integrators.systems.hamiltonian import Hamiltonian
    from phasebench.integrators.values.kinds import Value

#: Least number of digits of the functions of xi, whatever the arithmetic of the run.
DIGITS = 40
#: A kick magnified by more than this is taken for a pole.
POLE = 1e8
#: Rows of the filters.
PHI, BETA, A, B, SIGN = range(5)


class Trigonometric(NamedTuple):
    """The data of an integrator for a fast linear part.

    Attributes
    ----------
    dU : the gradient of the slow potential U
    filters : array (5, d), for each component: phi and (h/2) psi_1, which filter the slow force, and a, b, s of the
        linear flow, as `coefficients` computes them
    h, eps : the step size and the unit round-off, set by the run
    """

    dU: Callable
    filters: np.ndarray
    h: float = 0.0
    eps: float = 0.0


@elementwise()
def product(x, y):
    """The componentwise product of x and y."""
    return x * y


@elementwise()
def impulse(beta, gradient, a, q):
    """The increment of p by a half kick of the slow force and a shear of the linear flow, -(beta grad U + a q).

    All arguments are vectors of d components: ``gradient`` is grad U at the filtered q, beta = (h/2) psi_1, and a is
    the coefficient of the shear.
    """
    return -(beta * gradient + a * q)


class KickedState(NamedTuple):
    """The state (q, p), and the kick (increment of p) at its q that ends one step and also begins the next.

    Attributes
    ----------
    q, p : the state
    lost_q, lost_p : what rounding lost of each (compensation)
    kick : the increment of p at q; between two steps it is applied twice
    """

    q: Value
    p: Value
    lost_q: Value
    lost_p: Value
    kick: Value


@inline
def evaluate_kick(method: Trigonometric, q: Value) -> Value:
    """The merged kick and shear at q, an increment of p: it ends one step and begins the next."""
    phi, beta, a = load(method.filters, PHI, q), load(method.filters, BETA, q), load(method.filters, A, q)
    return impulse(beta, method.dU(product(phi, q)), a, q)


def begin(method: Trigonometric, carry: Carry, counts: np.record) -> KickedState:
    """Read the state from ``carry``, where the last call of the kernel left it, and evaluate the kick there.

    Returns the state with this kick, which `start` applies; adds the evaluation to ``counts``.
    """
    y = read_state(carry)
    counts.gradient += 1
    return KickedState(y.q, y.p, y.lost_q, y.lost_p, evaluate_kick(method, y.q))


def start(method: Trigonometric, y: KickedState) -> KickedState:
    """Apply the kick that begins a step; in later steps it is part of the kick that ends the step before."""
    p, lost_p = add(y.p, y.lost_p, y.kick)
    return KickedState(y.q, p, y.lost_q, lost_p, y.kick)


def step(method: Trigonometric, y: KickedState, carry: Carry, counts: np.record) -> tuple[KickedState, int]:
    """Apply the linear flow, then the kick twice: for the end of this step and the start of the next.

    Returns (state, `SOLVED`), and adds the evaluation of grad U to ``counts``; ``carry`` is not used.
    """
    b, sign = load(method.filters, B, y.q), load(method.filters, SIGN, y.q)
    q, lost_q = add(y.q, y.lost_q, product(b, y.p))
    q, lost_q, p, lost_p = product(sign, q), product(sign, lost_q), product(sign, y.p), product(sign, y.lost_p)
    kick = evaluate_kick(method, q)
    p, lost_p = add(p, lost_p, scale(2.0, kick))
    counts.gradient += 1
    return KickedState(q, p, lost_q, lost_p, kick), SOLVED


def finish(method: Trigonometric, y: KickedState) -> KickedState:
    """Undo the kick that begins the next step, before a row of output is stored."""
    p, lost_p = add(y.p, y.lost_p, scale(-1.0, y.kick))
    return KickedState(y.q, p, y.lost_q, lost_p, y.kick)


run = loop(step, begin, start, finish)


def coefficients(
    h: mpmath.mpf,
    omega: mpmath.mpf,
    propagator: Callable[..., tuple[mpmath.mpf, mpmath.mpf, mpmath.mpf]],
    psi1: Callable[[mpmath.mpf], mpmath.mpf],
    phi: Callable[[mpmath.mpf], mpmath.mpf],
    *arguments: int,
) -> tuple[mpmath.mpf, mpmath.mpf, mpmath.mpf, mpmath.mpf, int]:
    """Compute (phi, (h/2) psi_1, a, b, s) for a component of frequency omega, from mpmath numbers.

    phi and psi_1 filter the slow force: a kick is -(h/2) psi_1 grad U(phi q).  The matrix R of the linear flow is s = 1
    or -1 times the shears p - a q, q + b p and p - a q in turn.  ``propagator``, ``psi1`` and ``phi`` are functions of
    xi = h omega: the propagator of xi and the ``arguments`` returns (R_11, R_12 / h, -R_21 h / xi^2).  Raises
    InvalidInput if psi_1 has a pole at xi.
    """
    x = h * omega
    strength = psi1(x)
    if abs(strength) > POLE:
        times = mpmath.nstr(x / mpmath.pi, 12)
        raise InvalidInput(f"h omega is {times} pi, where the method's kick is infinite; take another h")
    c, sigma, tau = propagator(x, *arguments)
    s = 1 if c >= 0 else -1
    return phi(x), h / 2 * strength, s * h * omega**2 * tau / (1 + s * c), s * h * sigma, s


def prepare(method: Method, system: Hamiltonian, arithmetic: str) -> Prepared:
    """Prepare the kernel (compiled loop over steps) of an integrator for a fast linear part of a system.

    ``method.data`` are the arguments of `coefficients` after omega.  The coefficients are computed with at least 40
    digits once h is known.
    """
    step = Trigonometric(system.grad_U(arithmetic), zeros((5, system.d), arithmetic))
    return Prepared(
        run, step, 1, 1, implicit=False, begin=partial(with_filters, system.frequencies, method.data, arithmetic)
    )


def with_filters(
    frequencies: tuple, data: tuple, arithmetic: str, step: Trigonometric, q: Value, p: Value
) -> Trigonometric:
    """Complete the data ``step`` of a run: compute the filters for its step size and the frequencies of the system.

    ``data`` are the arguments of `coefficients` after omega.  Returns ``step`` with its field ``filters`` set; q and p
    are not used.
    """
    with mpmath.workdps(max(DIGITS, mpmath.mp.dps + 5)):
        exact = [mpmath.mpf(w.evalf(mpmath.mp.dps)) for w in frequencies]
        rows = [coefficients(mpmath.mpf(step.h), w, *data) for w in exact]
    return step._replace(filters=array(zip(*rows, strict=True), arithmetic))
