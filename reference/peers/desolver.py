r"""desolver's integrators as peers, at constant steps and, for embedded methods, at adaptive ones too.

A step is a call ``integrator(rhs, t, y, constants, h) -> (next step, (h taken, change of y))``, as `desolver.OdeSystem`
makes it.  In version 5.1 `OdeSystem` cannot keep an implicit method's step constant: after a step of 0.1 the next one
is near 0.3, even for methods listed with fixed steps, since an error estimate of 0 lengthens the step.  The peers with
constant steps therefore disable the step-size control by the integrator's ``adaptation_fn``.  If Newton's iteration
fails, desolver still shortens the step; such a step is discarded and repeated with h and a new Jacobian, and if that
fails too the run ends.

The explicit symplectic integrators require :math:`H = T(p) + V(q)`: stages update q and p in turn and use half of the
right-hand side.  `desolver.integrators.generate_richardson_integrator` derives the class of the Richardson
extrapolation of any other class; one such class is a peer here.

Sources: the methods' own, below; E. Hairer, G. Wanner, Solving Ordinary Differential Equations II (1996), IV.5.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import warnings
from collections.abc import Callable, Iterator
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from phasebench.reference.files import entries

from .field import right_hand_side
from .record import NOT_FINITE, Claims, Peer, Run, Task, split_alone
from .run import by_rows

if TYPE_CHECKING:
    from types import ModuleType

    from phasebench.integrators.systems.hamiltonian import PartitionedSystem

#: Largest number of steps of an adaptive run: near a singularity steps may shrink without end.
STEP_LIMIT = 100_000
#: rtol and atol of Newton's iteration; with desolver's default, 32 eps, round-off in the residual often fails the test.
TOLERANCE = 1e-13
#: Rows of Richardson's table; with desolver's default of 2 the result is that of the underlying method.
RICHARDSON_ROWS = 4
RICHARDSON = "richardson "


def load(name: str = "desolver") -> ModuleType:
    """Import desolver without the line that it prints on stderr."""
    with contextlib.redirect_stderr(io.StringIO()):
        return importlib.import_module(name)


@lru_cache(maxsize=64)
def integrator_class(which: str) -> type[Any]:
    """The integrator class named ``which``, or the Richardson extrapolation of it for "richardson " and a name."""
    integrators = load().integrators
    if which.startswith(RICHARDSON):
        base = getattr(integrators, which.removeprefix(RICHARDSON))
        return integrators.generate_richardson_integrator(base, richardson_iter=RICHARDSON_ROWS)
    return {c.__name__: c for c in integrators.explicit_methods() + integrators.implicit_methods()}[which]


def _integrator(which: str, size: int, h: float) -> Any:
    """Make an object of the integrator class named ``which``, for ``size`` components and a constant step h."""
    integrator = integrator_class(which)((size,), dtype=np.dtype(float), rtol=TOLERANCE, atol=TOLERANCE)
    integrator.adaptation_fn = lambda _: (h, False)
    return integrator


def _right_hand_side(system: PartitionedSystem, sign: float = 1.0) -> Any:
    """A right-hand side (t, y) -> y' that counts its calls; ``sign`` -1 reverses time."""
    field = right_hand_side(system)
    return load().DiffRHS(lambda t, y: sign * field(float(t), y))  # t may be a 0-dimensional array


@lru_cache(maxsize=256)
def _warm(which: str, size: int) -> None:
    """Take one step with the integrator class ``which`` before any timing, so that lazy imports and set-up are done."""
    _integrator(which, size, 0.1)(load().DiffRHS(lambda t, y: -y), np.float64(0.0), np.ones(size), {}, np.float64(0.1))


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Silence NumPy's warnings at a blow-up, which is detected from the rows instead."""
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def _run_constant(which: str) -> Callable[[Task], Run]:
    def run(task: Task) -> Run:
        # With a negative step the Richardson integrators never end their search for an error estimate.
        state, h, steps, size = task.state, np.float64(abs(task.h)), 0, 2 * len(task.q)
        rhs = _right_hand_side(task.system, np.sign(task.h))
        stops = ArithmeticError, ValueError, np.linalg.LinAlgError, load().exception_types.FailedToMeetTolerances
        rhs(0.0, state)
        rhs.nfev = 0

        def advance(i: int, n: int) -> str | None:
            nonlocal integrator, state, steps
            for _ in range(n):
                try:
                    taken, change = integrator(rhs, h * steps, state, {}, h)[1]
                    if taken != h:
                        integrator = _integrator(which, size, h)
                        taken, change = integrator(rhs, h * steps, state, {}, h)[1]
                except stops as error:
                    return f"step {steps + 1}: {str(error) or type(error).__name__}"
                state, steps = state + change, steps + 1
                if taken != h:
                    return f"Newton's iteration does not converge in step {steps}"
                if not np.isfinite(state).all():
                    return NOT_FINITE
            return None

        with _quiet():
            _warm(which, size)
            integrator = _integrator(which, size, h)
            found = by_rows(task, advance, lambda: state)
        return found._replace(steps=steps, gradient=rhs.nfev)

    return run


class _Stuck(RuntimeError):
    """Raised to end a run whose steps no longer advance."""


def _run_adaptive(which: str) -> Callable[[Task], Run]:
    def run(task: Task) -> Run:
        desolver, sign, state = load(), np.sign(task.h), task.state
        times, last, rhs = sign * task.times, [-1.0], _right_hand_side(task.system, sign)
        rhs(0.0, state)

        def advancing(ode: Any) -> None:
            if len(ode) > STEP_LIMIT:
                raise _Stuck(f"{STEP_LIMIT} steps did not reach the end")
            if not ode.t[-1] > last[0] or not np.isfinite(ode.y[-1]).all():
                raise _Stuck("the step no longer changes the time, or the state is no longer finite")
            last[0] = ode.t[-1]

        def advance(i: int, n: int) -> str | None:
            try:
                ode.integrate(times[i], callback=advancing)
            except desolver.exception_types.FailedIntegration as error:
                return str(error.__cause__ or error)
            return None

        with _quiet():
            _warm(which, len(state))
            tolerances = task.tolerances("rtol", "atol")
            ode = desolver.OdeSystem(rhs, y0=state, t=(0.0, times[-1]), dt=abs(task.h), **tolerances)
            ode.method = integrator_class(which)
            ode.equ_rhs.nfev = 0  # a copy of rhs
            found = by_rows(task, advance, lambda: np.array(ode.y[-1]))
        return found._replace(steps=len(ode) - 1, gradient=ode.equ_rhs.nfev)

    return run


def _peer(
    *,
    id: str,
    which: str,
    name: str,
    source: str,
    order: int | None = None,
    about: str = "",
    claim: int | None = None,
    symplectic: bool = False,
    adaptive: bool = False,
) -> Peer:
    """The record of desolver's integrator class ``which``; ``claim`` is the order that it states, if it differs."""
    richardson = which.startswith(RICHARDSON)
    class_name = which.removeprefix(RICHARDSON)
    attributes = f"{class_name}.symplectic, which its Richardson extrapolation takes over" if richardson else class_name
    how = "its choice of the step is switched off; a Python loop over steps"
    if adaptive:
        how = "through OdeSystem: tol is rtol = atol; its steps end at every row"
    about = f"{about}; {how}" if about else how
    return Peer(
        f"desolver-{id}-adaptive" if adaptive else f"desolver-{id}",
        f"{name}, adaptive" if adaptive else name,
        package="desolver",
        adaptive=adaptive,
        order=None if adaptive else order,
        license="MIT",
        about=f"{about}; right-hand side compiled by Numba, the rest NumPy in Python",
        source=source,
        run=_run_adaptive(which) if adaptive else _run_constant(which),
        claims=Claims(
            order=None if richardson else (claim or order),
            symplectic=symplectic,
            source=f"desolver.integrators.{attributes}" + ("" if richardson else ".__order__ and .symplectic"),
        ),
        load=load,
        tol=1e-10 if adaptive else None,
        least=1e-14 if adaptive else 0.0,
        rows_end_steps=adaptive,
        **(split_alone("its stages update q and p in turn: H must be T(p) + V(q)") if which in SPLITTING else {}),
    )


SPLITTING = ("SymplecticEulerSolver", "BABs9o7HSolver", "ABAs5o6HSolver", f"{RICHARDSON}SymplecticEulerSolver")

PEERS: tuple[Peer, ...] = tuple(_peer(**entry) for entry in entries(__file__))
