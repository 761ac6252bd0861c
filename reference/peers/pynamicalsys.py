r"""pynamicalsys's symplectic integrators as peers: velocity Verlet, Yoshida's method of order 4, the midpoint rule.

The package's loops are Numba's, and so are the functions that it is given: the gradients of T and V, or, for the
implicit midpoint rule, the equations of motion and the Hessian of H, from which Newton's method solves a step until its
residual is below ``tol`` (1e-12, the package's default).

`HamiltonianSystem.trajectory` returns all states and takes steps ahead only.  A run is split into pieces of at most
`PIECE` steps, which begin at the last state of the piece before; states between rows are dropped.

Source: M. Rolim Sales et al., pynamicalsys, https://github.com/mrolims/pynamicalsys.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from phasebench.reference.files import entries

from .record import Calls, Claims, Peer, Run, Task, split_alone
from .run import by_pieces

if TYPE_CHECKING:
    import sympy as sp

    from phasebench.integrators.systems.hamiltonian import Hamiltonian, PartitionedSystem

#: Largest number of steps in one call, which returns the state after each.
PIECE = 16_384
#: Most degrees of freedom for which the Hessian of H is compiled; it has 4 d^2 entries.
LARGEST = 20


@lru_cache(maxsize=128)
def _functions(system: Hamiltonian, implicit: bool) -> dict[str, Callable[..., Any]]:
    """Compile the functions on arrays (d,) that pynamicalsys calls, as arguments of its ``HamiltonianSystem``."""
    import numba
    from numba import types

    from phasebench.integrators.compile import codegen
    from phasebench.integrators.values import vector

    d, load, zero = system.d, vector.load, (0.0,) * system.d
    if codegen.compiled() and codegen.value_kind(d) == "tuple":
        read = numba.njit(lambda x: load(x.reshape(1, d), 0, zero))
    else:
        read = numba.njit(lambda x: x)
    if not implicit:
        return _gradients(system, read)
    field, value = system.field(), codegen.value_type(d)

    def second_derivatives() -> list[list[sp.Expr]]:
        matrix = system.hessian()
        return [list(matrix[i, k * d : (k + 1) * d]) for i in range(2 * d) for k in (0, 1)]

    arguments, signature = [("q", system.q), ("p", system.p)], types.UniTuple(value, 4 * d)(value, value)
    hessian = system.make_function("hessian", arguments, second_derivatives, signature, codegen.DOUBLE)

    @numba.njit(error_model="numpy")
    def equations(q: np.ndarray, p: np.ndarray, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        velocity, force = field(read(q), read(p), 0.0, 0.0)
        of_q, of_p = np.empty(d), np.empty(d)
        for i in range(d):
            of_q[i], of_p[i] = velocity[i], force[i]
        return of_q, of_p

    @numba.njit(error_model="numpy")
    def matrix(q: np.ndarray, p: np.ndarray, parameters: np.ndarray) -> np.ndarray:
        halves, found = hessian(read(q), read(p)), np.empty((2 * d, 2 * d))
        for i in range(2 * d):
            for j in range(d):
                found[i, j], found[i, d + j] = halves[2 * i][j], halves[2 * i + 1][j]
        return found

    return {"eom": equations, "hess_H": matrix}


def _gradients(system: Hamiltonian, read: Callable[[np.ndarray], Any]) -> dict[str, Callable[..., Any]]:
    """Compile the gradients of T and V; ``read`` turns an array (d,) into what this project's gradients take."""
    import numba

    def on_arrays(gradient: Callable) -> Callable:
        d = system.d

        @numba.njit(error_model="numpy")
        def function(x: np.ndarray, parameters: np.ndarray) -> np.ndarray:
            slope, found = gradient(read(x)), np.empty(d)
            for i in range(d):
                found[i] = slope[i]
            return found

        return function

    return {"grad_T": on_arrays(system.grad_T() or numba.njit(lambda p: p)), "grad_V": on_arrays(system.grad_V())}


def _system(system: Hamiltonian, implicit: bool) -> Any:
    """Make pynamicalsys's ``HamiltonianSystem`` from a system of this project, for its explicit or implicit methods."""
    from pynamicalsys import HamiltonianSystem

    return HamiltonianSystem(**_functions(system, implicit), degrees_of_freedom=system.d, number_of_parameters=0)


def _states(made: Any, y: np.ndarray, h: float, n: int) -> np.ndarray | None:
    """Integrate n steps of h from y = (q, p): the states after each, array (n, 2 d); None if a step was not solved."""
    d = len(y) // 2
    with contextlib.redirect_stdout(io.StringIO()):
        try:
            return made.trajectory(y[:d], y[d:], n * h)[1:, 1:]
        except (RuntimeError, np.linalg.LinAlgError):
            return None


def _build_run(name: str, gradients: int) -> Callable[[Task], Run]:
    def run(task: Task) -> Run:
        made, h = _system(task.system, not gradients), task.h
        made.integrator(name, time_step=h)
        _states(made, task.state, h, 1)
        pieces = [PIECE] * (task.steps // PIECE) + [task.steps % PIECE]
        return by_pieces(task, filter(None, pieces), lambda y, n: _states(made, y, h, n), gradients)

    return run


def _build_prepare(name: str, implicit: bool) -> Callable[[Task], Calls]:
    def prepare(task: Task) -> Calls:
        made = _system(task.system, implicit)
        made.integrator(name, time_step=1e-6)
        _states(made, task.state, 1e-6, 1)

        def integrate(y: np.ndarray, h: float, n: int) -> np.ndarray | None:
            made.integrator(name, time_step=h)
            while n:
                states = _states(made, y, h, min(n, PIECE))
                if states is None:
                    return None
                y, n = states[-1], n - len(states)
            return y

        return Calls.to_end(task, integrate)

    return prepare


def _lack_of_midpoint(problem: Any, system: PartitionedSystem) -> str | None:
    if not system.canonical:
        return "its equations are q' = dH/dp and p' = -dH/dq: the variables must be canonical"
    return f"it takes the Hessian of H, compiled up to d = {LARGEST}" if system.d > LARGEST else None


def _peer(id: str, name: str, title: str, order: int, gradients: int, about: str, source: str) -> Peer:
    facts = {"lacks": _lack_of_midpoint, "scope": f"any canonical H up to d = {LARGEST}"}
    if gradients:
        why = "it takes the gradients of T(p) and V(q): H must be T(p) + V(q)"
        facts = split_alone(why)
    return Peer(
        f"pynamicalsys-{id}",
        f"pynamicalsys's {title}",
        package="pynamicalsys",
        order=order,
        license="GPL-3.0",
        about=f"{about}; loops and right-hand sides are compiled by Numba, every state is stored",
        source=source,
        run=_build_run(name, gradients),
        prepare=_build_prepare(name, not gradients),
        claims=Claims(order=order, symplectic=True, source="docstrings of HamiltonianSystem and of its step functions"),
        ahead=True,
        settings={"integrator": name},
        **facts,
    )


PEERS: tuple[Peer, ...] = tuple(_peer(**entry) for entry in entries(__file__))
