"""SciPy's DOP853, Radau and LSODA as peers, with a Python right-hand side and with one compiled by Numba.

Both right-hand sides call the system's compiled vector field; the Python one builds tuples and arrays around it, which
takes most of its time.  SciPy's loops over steps are Python in both cases (LSODA's steps are compiled).  DOP853 and
LSODA in SciPy's older interfaces, `ode` and `odeint`, have compiled loops and take far less time: `fast` makes peers of
these, for comparison.

Sources: E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I (1993), II.5 (DOP853);
E. Hairer, G. Wanner, Solving Ordinary Differential Equations II (1996), IV.8 (Radau); L. Petzold, SIAM J. Sci. Stat.
Comput. 4 (1983) 136-148 (LSODA).
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from packaging.version import Version

from phasebench.reference.files import entries

from .field import compiled_field
from .record import NOT_FINITE, Calls, Claims, Peer, Run, Task

if TYPE_CHECKING:
    from scipy.integrate import OdeSolver, ode

    from phasebench.integrators.systems.hamiltonian import PartitionedSystem

#: SciPy's default tolerances.
DEFAULTS = {"rtol": 1e-3, "atol": 1e-6}
#: Largest number of steps: near a singularity LSODA's steps may shrink without end.
STEP_LIMIT = 1_000_000
DOCUMENTATION = "https://docs.scipy.org/doc/scipy/reference/generated/scipy.integrate.{}.html"


def _solve(solver_name: str, compiled: bool) -> Callable[[Task], Run]:
    def run(task: Task) -> Run:
        import scipy.integrate

        field = compiled_field(task.system) if compiled else task.system.vector_field()
        y, t = task.state, task.times
        field(0.0, y)
        rows = np.empty((len(t), len(y)))
        rows[0] = y
        row, steps, failure, way = 1, 0, None, np.sign(task.h)
        tolerances = DEFAULTS | task.tolerances("rtol", "atol")
        with np.errstate(all="ignore"), warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")  # LSODA reports the reason of a failure as a warning
            started = time.perf_counter()
            solver = getattr(scipy.integrate, solver_name)(field, 0.0, y, t[-1], **tolerances)
            while solver.status == "running":
                before = solver.t
                message = solver.step()
                failure = _failure(solver, message, before, steps)
                if failure:
                    break
                steps += 1
                if row < len(t) - 1 and way * t[row] <= way * solver.t:
                    inside = solver.dense_output()
                    while row < len(t) - 1 and way * t[row] <= way * solver.t:
                        rows[row] = inside(t[row])
                        row += 1
            seconds = time.perf_counter() - started
        if failure is None:
            rows[row], row = solver.y, row + 1
        else:
            failure = "; ".join(dict.fromkeys([failure.rstrip("."), *(str(w.message).rstrip(".") for w in warned)]))
        # SciPy's count leaves out the evaluations for a Jacobian by finite differences, one per component.
        evaluations = solver.nfev + (len(y) * solver.njev if solver_name == "Radau" else 0)
        return Run.of_states(rows[:row], steps, int(evaluations), seconds, failure)

    return run


def _prepare(solver_name: str, compiled: bool) -> Callable[[Task], Calls]:
    """Make the `Peer.prepare` of a SciPy solver: the loop over steps of ``solve_ivp``, without storing states."""

    def prepare(task: Task) -> Calls:
        import scipy.integrate

        solver_of = getattr(scipy.integrate, solver_name)
        field = compiled_field(task.system) if compiled else task.system.vector_field()
        tolerances = DEFAULTS | task.tolerances("rtol", "atol")
        return Calls.to_end(task, lambda y, t_end: _steps(solver_of(field, 0.0, y, t_end, **tolerances)))

    return prepare


def _steps(solver: OdeSolver) -> np.ndarray | None:
    """Run a solver to the end of its span and return the state there; None if it fails."""
    step, most = solver.step, STEP_LIMIT
    while solver.status == "running" and most:
        step()
        most -= 1
    return solver.y if solver.status == "finished" else None


def _failure(solver: OdeSolver, message: str | None, before: float, steps: int) -> str | None:
    """The reason why a run ends after this step, at whose start ``before`` and ``steps`` stood; None if it goes on."""
    if solver.status == "failed":
        return message or "SciPy gave no reason"
    if not np.isfinite(solver.y).all():
        return NOT_FINITE
    if solver.t == before:
        return "the step no longer changes the time"
    if steps + 1 >= STEP_LIMIT and solver.status == "running":
        return f"{STEP_LIMIT} steps did not reach the end"
    return None


def _off(problem: Any, system: PartitionedSystem) -> str | None:
    """The `Peer.lacks` of a peer that needs Numba: a reason if compilation is disabled, else None."""
    from phasebench.integrators.compile import codegen

    return None if codegen.compiled() else "compilation is off (NUMBA_DISABLE_JIT)"


def _peers(solver: str, name: str, source: str, order: int | None = None, more: str = "") -> tuple[Peer, ...]:
    """The records of a SciPy solver, with a Python and a compiled right-hand side; SciPy claims the ``order``."""
    about = f"rtol = atol = tol, by default SciPy's rtol = 0.001 and atol = 1e-06; {more}"
    kinds = (
        ("", "Python right-hand side", "the right-hand side is a Python call", {}),
        ("-numba", "right-hand side compiled by Numba", "the steps are SciPy's in Python", {"lacks": _off}),
    )
    return tuple(
        Peer(
            f"scipy-{solver.lower()}{suffix}",
            f"{name}, {side}",
            package="scipy",
            adaptive=True,
            license="BSD-3-Clause",
            about=f"{about}{side_more}",
            source=source,
            run=_solve(solver, bool(suffix)),
            prepare=_prepare(solver, bool(suffix)),
            claims=Claims(order=order, source=DOCUMENTATION.format(solver)),
            least=100 * float(np.finfo(float).eps),
            **options,
        )
        for suffix, side, side_more, options in kinds
    )


PEERS: tuple[Peer, ...] = tuple(p for entry in entries(__file__) for p in _peers(**entry))

SOLVED = "Integration successful."


def _lsoda(task: Task) -> Callable[..., tuple[np.ndarray, dict]]:
    """LSODA by SciPy's ``odeint`` for a task's system and tolerance: (y, times) -> (rows, what it tells)."""
    from scipy.integrate import odeint

    options = {"tfirst": True, "mxstep": STEP_LIMIT, "full_output": True} | task.tolerances("rtol", "atol")
    return partial(odeint, compiled_field(task.system), **options)


def _dop853(task: Task) -> ode:
    """DOP853 by SciPy's `ode`; before SciPy 1.17 a compiled right-hand side is wrapped in Python."""
    import scipy
    from scipy.integrate import ode

    field = compiled_field(task.system)
    wrapped = Version(scipy.__version__) < Version("1.17")
    f = (lambda t, y: field(t, y)) if wrapped else field
    return ode(f).set_integrator("dop853", nsteps=STEP_LIMIT, **task.tolerances("rtol", "atol"))


def _run_fast(solver: str, made: Any, task: Task) -> tuple[np.ndarray, int, int, str | None]:
    """Run a task by SciPy's ``odeint`` or ``ode``, as `_lsoda` or `_dop853` has ``made`` it.

    Returns (rows, steps, evaluations, failure or None); ``ode`` ends steps at the rows and counts none.
    """
    if solver == "odeint":
        rows, said = made(task.state, task.times)
        failure = None if said["message"] == SOLVED else said["message"]
        return rows if failure is None else rows[:1], int(said["nst"][-1]), int(said["nfe"][-1]), failure
    made.set_initial_value(task.state, 0.0)
    rows = [task.state]
    for t in task.times[1:]:
        rows.append(made.integrate(t))
        if not made.successful():
            return np.array(rows[:-1]), 0, 0, f"DOP853 returned {made.get_return_code()}"
    return np.array(rows), 0, 0, None


def fast(solver: str) -> Peer:
    """Make a peer outside the registry from SciPy's older interfaces, whose loops over steps are compiled.

    ``solver`` is "odeint" (LSODA) or "ode" (DOP853); the right-hand side is compiled, too.
    """
    name, build = {"odeint": ("LSODA", _lsoda), "ode": ("DOP853", _dop853)}[solver]

    def run(task: Task) -> Run:
        made = build(task)
        compiled_field(task.system)(0.0, task.state)
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the returned messages say the same
            started = time.perf_counter()
            rows, steps, evaluations, failure = _run_fast(solver, made, task)
            seconds = time.perf_counter() - started
        return Run.of_states(rows, steps, evaluations, seconds, failure)

    def prepare(task: Task) -> Calls:
        made = build(task)

        def lsoda(y: np.ndarray, t_end: float) -> np.ndarray | None:
            rows, said = made(y, (0.0, t_end))
            return rows[1] if said["message"] == SOLVED else None

        def dop853(y: np.ndarray, t_end: float) -> np.ndarray | None:
            end = made.set_initial_value(y, 0.0).integrate(t_end)
            return end if made.successful() else None

        return Calls.to_end(task, lsoda if solver == "odeint" else dop853)

    return Peer(
        f"scipy-{solver}({name})",
        f"{name} by scipy.integrate.{solver}, its loop compiled, right-hand side compiled by Numba",
        package="scipy",
        adaptive=True,
        license="BSD-3-Clause",
        about="rtol = atol = tol; SciPy's older interface",
        source="Petzold 1983; Hairer, Norsett & Wanner 1993, II.5",
        run=run,
        prepare=prepare,
        lacks=_off,
        claims=Claims(source=DOCUMENTATION.format(solver)),
        least=100 * float(np.finfo(float).eps),
    )
