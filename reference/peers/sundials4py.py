r"""The symplectic methods of SUNDIALS as peers: ARKODE's SPRKStep, through its Python interface sundials4py.

For :math:`H = T(p) + V(q)` a step of s stages with coefficients a and :math:`\hat a` is, for i = 1, ..., s,

.. math:: p \leftarrow p - h \hat a_i V'(q), \qquad q \leftarrow q + h a_i T'(p).

Every method is a peer with the plain sums that are the package's default, and another one, ``-compensated``, with
ARKodeSetUseCompensatedSums: the increment of a whole step is added to the state with compensation.  A step is a call of
ARKodeEvolve in the mode ARK_ONE_STEP, so that every step is h, and no row is interpolated.

MCLACHLAN_4_4 and MCLACHLAN_5_6 meet the order conditions of Nystrom methods alone: they have order 3 where T is not
quadratic.  All methods have order 1 where H depends on time (the script ``sundials_time_dependent`` of the audit).

The wheel of sundials4py needs Python 3.12 or newer; on older ones these peers count as not installed.

Source: C. J. Balos et al., SUNDIALS 7.9, ARKODE user guide, SPRKStep; the methods' own, below.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from phasebench.integrators.record import BOUNDED
from phasebench.reference.files import entries

from .field import split_gradients
from .record import Claims, Peer, Run, Task, older_python, split_alone
from .run import by_rows

if TYPE_CHECKING:
    from types import ModuleType

    from phasebench.integrators.systems.hamiltonian import Hamiltonian

#: The oldest Python for which the package has a wheel.
OLDEST = (3, 12)
GUIDE = "https://sundials.readthedocs.io/en/latest/arkode/Mathematics_link.html"
CLAIMED = f"{GUIDE}, SPRKStep; orders in the table of Butcher tables, Symplectic partitioned Butcher tables"
ABOUT = (
    "a Python loop over steps, each a call of ARKodeEvolve; right-hand sides are Python that calls functions compiled "
    "by Numba"
)


def load(name: str = "sundials4py") -> ModuleType:
    """Import sundials4py; the error on a Python that is too old for its wheel says so."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise ImportError(older_python(OLDEST) or error) from error


@lru_cache(maxsize=1)
def _context() -> Any:
    """The SUNDIALS context object of this process, created once."""
    from sundials4py import core

    status, context = core.SUNContext_Create(core.SUN_COMM_NULL)
    if status != core.SUN_SUCCESS:
        raise RuntimeError(f"SUNContext_Create returned {status}")
    return context


@lru_cache(maxsize=128)
def _callbacks(system: Hamiltonian) -> tuple[Callable[..., int], Callable[..., int]]:
    """SPRKStep's two right-hand sides (t, y, y', user data) -> 0: of p, and of q."""
    import numba
    from sundials4py import core

    d, (gradient, rate), array = system.d, split_gradients(system), core.N_VGetArrayPointer

    def callback(gradient: Callable, first: int, sign: float) -> Callable[..., int]:
        @numba.njit("void(float64[::1], float64[::1])", error_model="numpy")
        def fill(y: np.ndarray, out: np.ndarray) -> None:
            slope = gradient(y)
            for i in range(d):
                out[first + i] = sign * slope[i]

        def side(t: float, y: Any, slope: Any, data: Any) -> int:
            fill(array(y), array(slope))
            return 0

        return side

    return callback(gradient, d, -1.0), callback(rate, 0, 1.0)


def _integrator(method: str, compensated: bool, system: Hamiltonian, state: np.ndarray, h: float) -> tuple[Any, Any]:
    """Make SPRKStep's integrator with constant step h: (integrator, SUNDIALS vector with the memory of ``state``).

    Steps overwrite ``state``.

    A step of symplectic Euler is taken first, and undone: version 7.9 never sets the vector in which it keeps a stage's
    slope, and a method whose first coefficient is 0 multiplies what that contains, NaN at worst, by 0.
    """
    from sundials4py import arkode, core

    vector = core.N_VMake_Serial(len(state), state, _context())
    start = state.copy()
    integrator = arkode.SPRKStepCreate(*_callbacks(system), 0.0, vector, _context())
    memory = integrator.get()
    arkode.SPRKStepSetMethodName(memory, "ARKODE_SPRK_EULER_1_1")
    arkode.ARKodeSetFixedStep(memory, h)
    arkode.ARKodeEvolve(memory, h, vector, arkode.ARK_ONE_STEP)
    state[:] = start
    for code in (
        arkode.SPRKStepSetMethodName(memory, method),
        arkode.ARKodeSetUseCompensatedSums(memory, int(compensated)),
        arkode.ARKodeReset(memory, 0.0, vector),
        arkode.ARKodeSetFixedStep(memory, h),
    ):
        if code:
            raise RuntimeError(f"SPRKStep with {method} and the step {h:g} returned {code}")
    return integrator, vector


def _counts(memory: Any) -> np.ndarray:
    """The integrator's counts so far: steps, evaluations of p's right-hand side and of q's."""
    from sundials4py import arkode

    evaluations = [arkode.ARKodeGetNumRhsEvals(memory, part)[1] for part in (0, 1)]
    return np.array([arkode.ARKodeGetNumSteps(memory)[1], *evaluations])


def _build_run(method: str, compensated: bool) -> Callable[[Task], Run]:
    def run(task: Task) -> Run:
        from sundials4py import arkode

        state, end = task.state, task.h * max(task.steps, 1)
        integrator, vector = _integrator(method, compensated, task.system, state, task.h)
        memory, evolve, mode = integrator.get(), arkode.ARKodeEvolve, arkode.ARK_ONE_STEP
        before = _counts(memory)

        def advance(i: int, n: int) -> str | None:
            for _ in range(n):
                code, reached = evolve(memory, end, vector, mode)
                if code < 0:
                    return f"ARKodeEvolve returned {code} after t = {reached:.6g}"
            return None

        found = by_rows(task, advance, state.copy)
        steps, *evaluations = _counts(memory) - before
        return found._replace(steps=int(steps), gradient=int(max(evaluations)))

    return run


def sprk(name: str, source: str, about: str = "", *, compensated: bool = False) -> Peer:
    """Make the record of SPRKStep with the method ARKODE_SPRK_<name>, a name that ends with order and stages."""
    order, stages = map(int, name.split("_")[-2:])
    sums = "ARKodeSetUseCompensatedSums on" if compensated else "plain sums, the package's default"
    return Peer(
        f"sundials-{name.lower().replace('_', '-')}{'-compensated' if compensated else ''}",
        f"SUNDIALS's ARKODE_SPRK_{name}{', compensated sums' if compensated else ''}",
        package="sundials4py",
        order=order,
        license="BSD-3-Clause",
        about="; ".join(filter(None, [f"{stages} stages" if stages > 1 else "1 stage", about, sums, ABOUT])),
        source=source,
        run=_build_run(f"ARKODE_SPRK_{name}", compensated),
        claims=Claims(order=order, symplectic=True, energy=BOUNDED, source=CLAIMED),
        load=load,
        settings={"ARKodeSetUseCompensatedSums": compensated},
        python=OLDEST,
        **split_alone("SPRKStep's stages update q and p in turn: H must be T(p) + V(q)"),
    )


PEERS: tuple[Peer, ...] = (
    *(sprk(**entry) for entry in entries(__file__)),
    *(sprk(**entry, compensated=True) for entry in entries(__file__)),
)
