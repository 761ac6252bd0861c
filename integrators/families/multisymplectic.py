r"""Box schemes of multisymplectic equations: a symplectic Runge-Kutta method in time and a symplectic one in space.

The equation :math:`K z_t + L z_x = \nabla S(z)` is discretized in space as in `systems.multisymplectic`: z = (y, w) in
each cell, where y evolves in time and w is a difference of y in space; D is the difference.  A step of a (partitioned)
Runge-Kutta method (A, b) for y has the stages :math:`Y_i`, the y of :math:`Z_i`, with the time derivatives :math:`T_i`,

.. math::
    K T_i + L\,D Z_i = \nabla S(Z_i),\qquad Y_i = y_n + h\sum_j a_{ij} T_j,\qquad y_{n+1} = y_n + h\sum_i b_i T_i .

Where the method is symplectic, :math:`b_i a^q_{ij} + b_j a^p_{ji} = b_i b_j`, the multisymplectic law holds in each
cell of space-time, with the densities at :math:`t_n` and the fluxes :math:`\sum_i b_i (\cdot)_i` of the stages.

- Euler box: symplectic Euler in time and in space (B. Moore, S. Reich, Numer. Math. 95 (2003) 625-652).
- Preissmann's box: the midpoint rule in both (T. J. Bridges, S. Reich, Phys. Lett. A 284 (2001) 184-193).
- Gauss box: two Gauss nodes in time, the midpoint rule in space (S. Reich, J. Comput. Phys. 157 (2000) 473-499).
- EQUIP box: Gauss-EQUIP in time, :math:`A(\alpha) = A - \alpha S B`, see `families.equip`: multisymplectic for every
  fixed alpha, which is chosen in each step such that the total energy is conserved (C. Chen, J. Hong, C. Sim, K. Sonwu,
  J. Comput. Phys. 418 (2020) 109599).
- Controls, not multisymplectic: the averaged vector field in time, which keeps the energy in every cell
  (Y. Gong, J. Cai, Y. Wang, J. Comput. Phys. 279 (2014) 80-102), with :math:`a_{ij} = c_i b_j` of a rule that is exact
  for the quartic S; Radau IIA; and the midpoint rule with a perturbed coefficient.

Stages are solved by Newton's method with the exact Jacobian to round-off; y is summed with compensation.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np

from phasebench.integrators.coefficients.tableaus import runge_kutta
from phasebench.integrators.errors import InvalidInput, unknown_name
from phasebench.integrators.systems.multisymplectic import Box, Division, Equation, Staggered

from .equip import skew

NEWTON_LIMIT, SECANT_LIMIT = 30, 20
#: Newton's method may stop when its correction is below this share of the stages.
CLOSE = 1e-10
#: The energy is met within UNITS of its round-off, by a parameter of at most RADIUS.
UNITS, RADIUS = 8.0, 0.5
EPS = float(np.finfo(float).eps)


@dataclass(frozen=True)
class Scheme:
    """A box scheme: a Runge-Kutta method in time with a discretization in space.

    Attributes
    ----------
    id, name, source : a key, the name and the paper of the scheme
    division : the class that discretizes space, `Box` or `Staggered`
    A_q, A_p, b : the tableau in time: its matrix for q and for p, and its weights
    S : the skew matrix (s, s) in A - alpha S diag(b) if a parameter alpha conserves the energy, else None
    order : the order in time
    multisymplectic : True if the scheme is said to conserve the multisymplectic law
    keeps : the energy that it is said to conserve: "total"; "cell", by the local law in every cell; or "", none
    means : True if fluxes are evaluated at the mean of the stages, False if they are the mean of the stages' fluxes
    """

    id: str
    name: str
    source: str
    division: type[Division]
    A_q: np.ndarray = field(repr=False)
    A_p: np.ndarray = field(repr=False)
    b: np.ndarray = field(repr=False)
    order: int
    S: np.ndarray | None = field(default=None, repr=False)
    multisymplectic: bool = True
    keeps: str = ""
    means: bool = False

    def at(self, alpha: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the tableaus (A_q, A_p), arrays (s, s), for the value alpha of the parameter."""
        less = 0.0 if self.S is None else alpha * self.S * self.b
        return self.A_q - less, self.A_p - less


def _collocation(kind: str, s: int) -> tuple[np.ndarray, np.ndarray, list]:
    A, _, b, c = runge_kutta(kind, s)
    return np.array(A.tolist(), float), np.array(list(b), float), c


@cache
def schemes() -> dict[str, Scheme]:
    """Return all box schemes as a dictionary id -> `Scheme`."""
    half, one = np.array([[0.5]]), np.array([1.0])
    gauss, b, c = _collocation("gauss", 2)
    radau, radau_b, _ = _collocation("radau-iia", 2)
    mean = np.array(c, float)[:, None] * b
    off = half + 1e-3
    box = Scheme("preissmann-box", "Preissmann box", "Bridges & Reich 2001", Box, half, half, one, 2)
    two = Scheme("gauss-box", "Gauss box", "Reich 2000", Box, gauss, gauss, b, 4)
    equip = {"id": "equip-box", "name": "EQUIP box", "source": "Chen, Hong, Sim & Sonwu 2020", "keeps": "total"}
    vector = {"id": "avf-box", "name": "AVF box", "source": "Gong, Cai & Wang 2014", "keeps": "cell", "means": True}
    control = {"source": "control", "multisymplectic": False}
    known = (
        Scheme("euler-box", "Euler box", "Moore & Reich 2003", Staggered, 0 * half, 2 * half, one, 1),
        box,
        two,
        replace(two, S=np.array(skew(2, c), float), **equip),
        replace(two, A_q=mean, A_p=mean, order=2, multisymplectic=False, **vector),
        replace(two, id="radau-box", name="Radau IIA box", A_q=radau, A_p=radau, b=radau_b, order=3, **control),
        replace(box, id="perturbed-box", name="perturbed Preissmann box", A_q=off, A_p=off, order=1, **control),
    )
    return {s.id: s for s in known}


def scheme(id: str) -> Scheme:
    """Return the box scheme of an id; raises InvalidInput for an unknown one, naming the nearest."""
    if id not in schemes():
        raise unknown_name("box scheme", id, schemes())
    return schemes()[id]


@dataclass(frozen=True)
class Tangent:
    """A solution of the scheme linearized about one step.

    Attributes
    ----------
    start, end : the tangent vector before and after the step, arrays (N, m): m components in N cells
    Y, T : the tangent at the s stages and its time derivatives there, arrays (s, N, m)
    """

    start: np.ndarray
    end: np.ndarray
    Y: np.ndarray
    T: np.ndarray


@dataclass(frozen=True)
class Step:
    """One step of a box scheme.

    Attributes
    ----------
    start, end : y before and after the step, arrays (N, m): m components in N cells
    Y, T : the stages and their time derivatives, arrays (s, N, m)
    alpha : the parameter of the tableau; 0 if there is none
    found : True if a parameter conserves the energy, or none is needed
    tangents : solutions of the scheme linearized with the parameter held fixed, a `Tangent` for each vector given to
        `run`
    moving : solutions from the same vectors, linearized with the parameter that follows the state so that the energy is
        conserved
    """

    start: np.ndarray
    end: np.ndarray
    Y: np.ndarray
    T: np.ndarray
    alpha: float
    found: bool
    tangents: tuple[Tangent, ...]
    moving: tuple[Tangent, ...]


class Stages:
    """The stages of a step of length h from y with the parameter alpha: solves the stage equations and linearizes them.

    ``space`` is the discretization in space, ``scheme`` the box scheme, y an array (N, m) of m components in N cells;
    Newton's method starts from the time derivatives ``T`` if they are given.  The attribute ``Y`` has the stages and
    ``T`` their time derivatives, arrays (s, N, m).  Raises ArithmeticError if the equations cannot be solved.
    """

    def __init__(
        self, space: Division, scheme: Scheme, y: np.ndarray, h: float, alpha: float, T: np.ndarray | None = None
    ) -> None:
        self.space, self.scheme, self.y, self.h, self.alpha = space, scheme, y, h, alpha
        m = y.shape[-1]
        self._A = np.repeat(np.stack(scheme.at(alpha)), m // 2, axis=0)
        self.T = self._solve(np.stack([space.field(y)] * len(scheme.b)) if T is None else T)

    def along(self, T: np.ndarray, A: np.ndarray | None = None) -> np.ndarray:
        """The increments h sum_j a_ij T_j of the stages i, for time derivatives T (s, N, m): array (s, N, m).

        A has a tableau for each component, array (m, s, s), by default that of the step.
        """
        return self.h * np.einsum("cij,jnc->inc", self._A if A is None else A, T)

    def _solve(self, T: np.ndarray) -> np.ndarray:
        before = np.inf
        for _ in range(NEWTON_LIMIT):
            Y = self.y + self.along(T)
            rest = np.stack([self.space.field(x) for x in Y]) - T
            change = np.linalg.solve(self._matrix(Y), rest.ravel()).reshape(T.shape)
            T = T + change
            now = np.abs(change).max() / max(np.abs(T).max(), EPS)
            if not np.isfinite(now):
                break
            if now == 0 or (now < CLOSE and now >= before / 2):
                self.Y = self.y + self.along(T)
                return T
            before = now
        raise ArithmeticError(f"Newton's method does not solve the stages of h = {self.h:g}; take a smaller h")

    def _matrix(self, Y: np.ndarray) -> np.ndarray:
        s, N, m = Y.shape
        self.J = [self.space.jacobian(x) for x in Y]
        M = np.eye(s * N * m).reshape(s, N * m, s, N * m)
        for i in range(s):
            for j in range(s):
                M[i, :, j, :] -= self.h * self.J[i] * np.tile(self._A[:, i, j], N)
        return M.reshape(s * N * m, s * N * m)

    @property
    def increment(self) -> np.ndarray:
        """The increment of y over the step, h sum_i b_i T_i: array (N, m)."""
        return self.h * np.tensordot(self.scheme.b, self.T, 1)

    def linearize(self, u: np.ndarray, more: np.ndarray | float = 0.0) -> Tangent:
        """Carry a tangent u, array (N, m), through the step by the scheme linearized about it; returns a `Tangent`.

        ``more``, array (s, N, m), is a further change of the stages, such as that by a change of the parameter alpha.
        """
        right = u + more + np.zeros_like(self.Y)
        matrix = self._matrix(self.Y)
        forced = np.stack([J @ x.ravel() for J, x in zip(self.J, right, strict=True)])
        T = np.linalg.solve(matrix, forced.ravel()).reshape(self.Y.shape)
        return Tangent(u, u + self.h * np.tensordot(self.scheme.b, T, 1), right + self.along(T), T)

    def by_parameter(self) -> np.ndarray:
        """The derivative of the stages by the parameter alpha, at fixed time derivatives T: array (s, N, m)."""
        d = -np.repeat(np.stack([self.scheme.S * self.scheme.b] * 2), self.y.shape[-1] // 2, axis=0)
        return self.along(self.T, d)


def _magnitude(space: Division, y: np.ndarray) -> float:
    z = space.lift(y)
    return float(np.abs(z * space.equation.gradient(z)).sum() * space.dx)


def solve_for_energy(space: Division, scheme: Scheme, y: np.ndarray, h: float, energy: float) -> tuple[Stages, bool]:
    """Find the tableau's parameter alpha, nearest zero, with which a step from y ends with the total energy ``energy``.

    The equation is solved by the secant method.  Returns (the `Stages` with that parameter, True), or (those with the
    parameter 0, False) if none is found.
    """
    first = Stages(space, scheme, y, h, 0.0)
    bound = UNITS * EPS * _magnitude(space, y)

    def energy_defect(stages: Stages) -> float:
        return space.total_energy(y + stages.increment) - energy

    a, E = 0.0, energy_defect(first)
    if abs(E) <= bound:
        return first, True
    b, stages = 0.1 * h * h, first
    for _ in range(SECANT_LIMIT):
        stages = Stages(space, scheme, y, h, b, stages.T)
        F = energy_defect(stages)
        if abs(F) <= bound:
            return stages, True
        if F == E:
            break
        a, b, E = b, b - F * (b - a) / (F - E), F
        if not abs(b) <= RADIUS:
            break
    return first, False


def _follow_parameter(stages: Stages, tangents: tuple[Tangent, ...], energy_is_kept: bool) -> tuple[Tangent, ...]:
    """Correct the tangents of a step for the parameter, which changes with the state so that the energy is conserved.

    ``stages`` are those of the step; ``tangents`` solve the scheme linearized with the parameter held fixed.  Returns a
    tuple of `Tangent`: the given ones if the scheme has no parameter, or if ``energy_is_kept`` is False since no
    parameter was found.
    """
    if stages.scheme.S is None or not energy_is_kept:
        return tangents
    space = stages.space
    m = space.equation.moving
    gradient = space.field(stages.y + stages.increment) @ space.equation.K[:m, :m].T
    more = stages.by_parameter()
    unit = stages.linearize(0 * stages.y, more)
    slope = np.sum(gradient * unit.end)
    if slope == 0:
        return tangents
    return tuple(stages.linearize(t.start, -np.sum(gradient * t.end) / slope * more) for t in tangents)


def run(
    equation: Equation,
    scheme: Scheme,
    y: np.ndarray,
    dx: float,
    h: float,
    steps: int,
    tangents: Sequence[np.ndarray] = (),
) -> Iterator[Step]:
    """Integrate a multisymplectic equation by a box scheme, and yield each `Step`.

    Parameters
    ----------
    equation, scheme : the equation to solve, and the box scheme
    y : array (N, m), the initial values of m components in the N cells of a period
    dx : the width of a cell
    h, steps : the step in time and the number of steps
    tangents : arrays (N, m), initial values of tangents, carried along by the scheme linearized at each step's fixed
        parameter

    Raises
    ------
    InvalidInput
        If h is not positive, y has the wrong shape, or the discretization in space does not admit N and dx.
    ArithmeticError
        If the stages cannot be solved.
    """
    y = np.array(y, float)
    if not h > 0 or y.ndim != 2 or y.shape[1] != equation.moving:
        raise InvalidInput(f"h = {h} and y of shape {y.shape}: h > 0 and (N, {equation.moving}) are needed")
    space = scheme.division(equation, len(y), dx)
    energy = space.total_energy(y)
    lost = np.zeros_like(y)
    for _ in range(steps):
        stages, found = (Stages(space, scheme, y, h, 0.0), True) if scheme.S is None else (
            solve_for_energy(space, scheme, y, h, energy))  # fmt: skip
        change = stages.increment + lost
        new = y + change
        lost = change - (new - y)
        carried = tuple(stages.linearize(u) for u in tangents)
        yield Step(y, new, stages.Y, stages.T, stages.alpha, found, carried, _follow_parameter(stages, carried, found))
        y, tangents = new, [t.end for t in carried]
