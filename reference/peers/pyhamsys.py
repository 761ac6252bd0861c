r"""pyhamsys's symplectic splitting integrators as peers: for H = T(p) + V(q), and for any H on a doubled phase space.

A separable H is given by ``chi`` and ``chi_star``, the compositions of the flows of T and V in the two orders.  Methods
for H = A(p) + B(q) with a declared order of flows get that order: "exp(h X_B) exp(h X_A)" means the flow of B first.
General methods get the order of `pyhamsys.chi_potential`, V first.  Without a splitting (``extension=True``) the
integrator works on two copies of the state with :math:`H(q, P) + H(Q, p)`, and after each step

- sets both to their mean (no ``omega``, its default), a map of phase space that need not be symplectic, or
- lets them evolve, coupled by :math:`\omega |y - \bar y|^2 / 2` (with ``omega``), and returns their mean in rows.

Version 0.90 does not read the field ``projection`` of pyhamsys.Parameters: "symmetric" has no effect and is no peer.

Steps: pyhamsys chooses the number of steps itself, at least two.  If n rows are requested and its ``step`` exceeds
their distance, it takes n steps of t_end / n.  To make this exactly h, runs are split into pieces of at most `PIECE`
steps whose numbers are powers of two; pieces are short because pyhamsys searches all rows at every step, at a cost of
the square of their number.  A single step is the first of two.  With omega the two copies cannot be passed on: there is
one piece, and the step is h up to a rounding.

Source: C. Chandre, pyhamsys, https://github.com/cchandre/pyhamsys; P. Pihajoki, Celest. Mech. Dyn. Astron. 121 (2015)
211-231; M. Tao, Phys. Rev. E 94 (2016) 043303.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from phasebench.integrators.errors import InvalidInput
from phasebench.reference.files import entries

from .field import right_hand_side, split_gradients
from .record import Claims, Peer, Run, Task, only, split_alone
from .run import by_pieces

if TYPE_CHECKING:
    from phasebench.integrators.systems.hamiltonian import Hamiltonian

#: Largest number of steps in one call of pyhamsys, and in one with two copies coupled by omega.
PIECE, MOST = 256, 100_000
#: The coupling constant omega of the two copies.
OMEGA = 10.0
README = "README of pyhamsys 0.90, Symplectic Integrators"
EXTENDED = "README of pyhamsys 0.90, Symplectic Integrators and Parameters (extension, omega)"


@lru_cache(maxsize=128)
def _flows(
    system: Hamiltonian,
) -> tuple[Callable[[float, float, np.ndarray], np.ndarray], Callable[[float, float, np.ndarray], np.ndarray]]:
    """Two compiled maps (h, t, y) -> y after h: the flow of V and then that of T, and the reverse; t is not used."""
    import numba

    d, (gradient, rate) = system.d, split_gradients(system)

    @numba.njit
    def kick(h: float, y: np.ndarray) -> None:
        slope = gradient(y)
        for i in range(d):
            y[d + i] -= h * slope[i]

    @numba.njit
    def drift(h: float, y: np.ndarray) -> None:
        velocity = rate(y)
        for i in range(d):
            y[i] += h * velocity[i]

    def composed(first: Callable, second: Callable) -> Callable[[float, float, np.ndarray], np.ndarray]:
        @numba.njit("float64[::1](float64, float64, float64[::1])", error_model="numpy")
        def flows(h: float, t: float, y: np.ndarray) -> np.ndarray:
            y = y.copy()
            first(h, y)
            second(h, y)
            return y

        return flows

    return composed(kick, drift), composed(drift, kick)


def _separable_system(system: Hamiltonian, position_first: bool) -> Any:
    """Make pyhamsys's system for H = T(p) + V(q); the flow of T comes first in ``chi`` if ``position_first``."""
    from pyhamsys import HamSys

    kick_drift, drift_kick = _flows(system)
    chi, chi_star = (drift_kick, kick_drift) if position_first else (kick_drift, drift_kick)
    return HamSys(ndof=system.d, chi=chi, chi_star=chi_star)


def _general_system(system: Hamiltonian) -> Any:
    """Make pyhamsys's system for any H, from its equations of motion."""
    from pyhamsys import HamSys

    return HamSys(ndof=system.d, y_dot=right_hand_side(system))


def _piece(system: Any, options: dict, state: np.ndarray, h: float, n: int) -> np.ndarray:
    """Take n steps of h by one call of pyhamsys: the states after 1, ..., n steps, array (n, 2 d)."""
    from pyhamsys import Parameters

    times = np.arange(max(n, 2) + 1) * h
    # rows coincide with steps only if times[-1] / step is less than the number of rows
    parameters = Parameters(step=2.0 * times[-1], display=False, **options)
    return system.integrate(state, times, parameters).y.T[1 : n + 1]


def _pieces(steps: int, one: bool) -> list[int]:
    """Numbers of steps that sum to ``steps``: powers of two up to `PIECE`, or a single piece if ``one``."""
    if one:
        return [steps]
    parts = [PIECE] * (steps // PIECE)
    rest = steps % PIECE
    return parts + [1 << k for k in reversed(range(rest.bit_length())) if rest >> k & 1]


@lru_cache(maxsize=1)
def _warm() -> None:
    """Take one step before any timing, so that lazy imports and set-up are done."""
    from pyhamsys import HamSys

    _piece(HamSys(y_dot=lambda t, y: -y), {"solver": "Verlet", "extension": True}, np.ones(2), 0.1, 2)


def _build_run(solver: str, position_first: bool, extension: bool, omega: float | None) -> Callable[[Task], Run]:
    def run(task: Task) -> Run:
        one = omega is not None
        if one and task.steps > MOST:
            raise InvalidInput(f"pyhamsys's time grows as the square of the steps: at most {MOST} with omega")
        system = _general_system(task.system) if extension else _separable_system(task.system, position_first)
        options = {"solver": solver, "extension": extension, "omega": omega}
        _warm()
        with np.errstate(all="ignore"):
            return by_pieces(task, _pieces(task.steps, one), lambda y, n: _piece(system, options, y, task.h, n))

    return run


SPLIT = split_alone("chi and chi_star are flows of T(p) and V(q): H must be their sum (the extended peers take any H)")
EXTENSION = only(
    "any Hamiltonian",
    "two copies of phase space need H in canonical coordinates",
    lambda system: system.canonical,
)
SPLIT_ABOUT = (
    "flows of T and V compiled by Numba, the composition a Python loop; the time includes pyhamsys's set-up of each "
    f"{PIECE} steps and its search for rows"
)
MEAN_ABOUT = "two copies, set to their mean after each step; symplectic in the doubled phase space before that"
BOUND_ABOUT = f"two copies bound by omega = {OMEGA:g}; rows are their mean; symplectic in the doubled phase space"


def _peer(solver: str, order: int, about: str, source: str, *, position_first: bool = False, kind: str = "") -> Peer:
    """Make the record of pyhamsys's integrator ``solver``.

    ``kind`` is "" for T + V, "extended" for two copies of phase space set to their mean, "omega" for two coupled ones.
    """
    extension = bool(kind)
    claim = Claims(order=order, symplectic=None if extension else True, source=EXTENDED if extension else README)
    how = {"": SPLIT_ABOUT, "extended": MEAN_ABOUT, "omega": BOUND_ABOUT}[kind]
    name = {"": "", "extended": ", extended phase space", "omega": ", extended phase space with restraint"}[kind]
    return Peer(
        f"pyhamsys-{solver.lower()}{f'-{kind}' if kind else ''}",
        f"pyhamsys's {solver}{name}",
        package="pyhamsys",
        ahead=True,
        order=order,
        license="BSD-2-Clause",
        about=f"{about}; {how}",
        source=source,
        run=_build_run(solver, position_first, extension, OMEGA if kind == "omega" else None),
        claims=claim,
        **(EXTENSION if extension else SPLIT),
    )


PEERS: tuple[Peer, ...] = tuple(_peer(**entry) for entry in entries(__file__))
