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
from typing import TYPE_CHECKING, Any

import numpy as np
from packaging.version import Version

from .field import compiled_field
from .record import NOT_FINITE, Claims, Peer, Run, Start, Task

if TYPE_CHECKING:
    from scipy.integrate import OdeSolver, ode

    from phasebench.integrators.systems.hamiltonian import PartitionedSystem

    from .prepared import Calls

#: SciPy's default tolerances.
RTOL, ATOL = 1e-3, 1e-6
#: Largest number of steps: near a singularity LSODA's steps may shrink without end.
STEP_LIMIT = 1_000_000
DOCUMENTATION = "https://docs.scipy.org/doc/scipy/reference/generated/scipy.integrate.{}.html"


def _solve(solver_name: str, compiled: bool) -> Callable[[Task], Run]:
    def run(task: Task) -> Run:
        import scipy.integrate

        field = compiled_field(task.system) if compiled else task.system.vector_field()
        y, t, tol = task.state, task.times, task.tol
        field(0.0, y)
        rows = np.empty((len(t), len(y)))
        rows[0] = y
        row, steps, failure = 1, 0, None
        tolerances = {"rtol": RTOL if tol is None else tol, "atol": ATOL if tol is None else tol}
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
                if row < len(t) - 1 and t[row] <= solver.t:
                    inside = solver.dense_output()
                    while row < len(t) - 1 and t[row] <= solver.t:
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


def _prepare(solver_name: str, compiled: bool) -> Callable[[Start], Calls]:
    """Make the `Peer.prepare` of a SciPy solver: the loop over steps of ``solve_ivp``, without storing states."""

    def prepare(start: Start) -> Calls:
        import scipy.integrate

        solver_of = getattr(scipy.integrate, solver_name)
        field = compiled_field(start.system) if compiled else start.system.vector_field()
        tolerances = {"rtol": start.tol, "atol": start.tol} if start.tol else {"rtol": RTOL, "atol": ATOL}
        return _calls(start, lambda y, t_end: _steps(solver_of(field, 0.0, y, t_end, **tolerances)))

    return prepare


def _steps(solver: OdeSolver) -> np.ndarray | None:
    """Run a solver to the end of its span and return the state there; None if it fails."""
    step, most = solver.step, STEP_LIMIT
    while solver.status == "running" and most:
        step()
        most -= 1
    return solver.y if solver.status == "finished" else None


def _calls(start: Start, integrate: Callable[[np.ndarray, float], np.ndarray | None]) -> Calls:
    """The `Calls` of a prepared run, given ``integrate``: (y, t_end) -> the final state, or None if it failed."""
    from .prepared import SOLVED, STALLED, Calls

    begin, end = start.state, [start.state]

    def restart(y: np.ndarray) -> None:
        begin[:] = y

    def advance(t_end: float) -> int:
        y = integrate(begin, t_end)
        if y is None:
            return STALLED
        end[0] = y
        return SOLVED

    return Calls(restart, advance, lambda: np.array(end[0]))


def _failure(solver: OdeSolver, message: str | None, before: float, steps: int) -> str | None:
    """The reason why a run of a SciPy solver ends after this step; None if it goes on.

    ``message`` is the step's result, ``before`` the time before it, ``steps`` the number of steps before it.
    """
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


def _peers(solver: str, name: str, more: str, source: str, order: int | None) -> tuple[Peer, Peer]:
    """Make the records of a SciPy solver: with a Python right-hand side, and with a compiled one.

    ``more`` is added to the records' text ``about``; ``order`` is the order that SciPy claims.
    """
    about = f"rtol = atol = tol, by default SciPy's rtol = {RTOL:g} and atol = {ATOL:g}; {more}"
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
            order=None,
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


PEERS = (
    *_peers("DOP853", "DOP853, Dormand-Prince of order 8(5,3)", "", "Hairer, Norsett & Wanner 1993, II.5", 8),
    *_peers(
        "Radau",
        "Radau IIA of order 5",
        "the Jacobian is SciPy's by differences, and its evaluations are counted; ",
        "Hairer & Wanner 1996, IV.8",
        5,
    ),
    *_peers(
        "LSODA",
        "LSODA, Adams and BDF of adaptive order",
        "it changes between Adams and BDF by itself, with the Jacobian by differences; ",
        "Petzold 1983, SIAM J. Sci. Stat. Comput. 4, 136-148",
        None,
    ),
)


def _odeint(field: Callable[[float, np.ndarray], np.ndarray], task: Task) -> tuple[np.ndarray, int, int, str | None]:
    """Run LSODA by SciPy's ``odeint``, whose loop is compiled: (rows, steps, evaluations, failure or None)."""
    from scipy.integrate import odeint

    tolerances = {"rtol": task.tol, "atol": task.tol} if task.tol is not None else {}
    rows, said = odeint(field, task.state, task.times, tfirst=True, mxstep=STEP_LIMIT, full_output=True, **tolerances)
    good = said["message"] == "Integration successful."
    return rows if good else rows[:1], int(said["nst"][-1]), int(said["nfe"][-1]), None if good else said["message"]


def _dop853(field: Callable[[float, np.ndarray], np.ndarray], tolerances: dict[str, float]) -> ode:
    """Make SciPy's `ode` with DOP853 for a right-hand side; before SciPy 1.17 a compiled one is wrapped in Python."""
    import scipy
    from scipy.integrate import ode

    wrapped = Version(scipy.__version__) < Version("1.17")
    f = (lambda t, y: field(t, y)) if wrapped else field
    return ode(f).set_integrator("dop853", nsteps=STEP_LIMIT, **tolerances)


def _ode(field: Callable[[float, np.ndarray], np.ndarray], task: Task) -> tuple[np.ndarray, int, int, str | None]:
    """Run DOP853 by SciPy's ``ode``, whose loop is compiled: (rows, 0, 0, failure or None).

    The zeros stand for steps and evaluations, which are not counted; steps end at the rows.
    """
    tolerances = {"rtol": task.tol, "atol": task.tol} if task.tol is not None else {}
    solver = _dop853(field, tolerances).set_initial_value(task.state, 0.0)
    rows = [task.state]
    for t in task.times[1:]:
        rows.append(solver.integrate(t))
        if not solver.successful():
            return np.array(rows[:-1]), 0, 0, f"DOP853 returned {solver.get_return_code()}"
    return np.array(rows), 0, 0, None


def _prepare_fast(solver: str) -> Callable[[Start], Calls]:
    """Make the `Peer.prepare` of SciPy's ``odeint`` or ``ode``, which are called for the final state only."""

    def prepare(start: Start) -> Calls:
        from scipy.integrate import odeint

        field = compiled_field(start.system)
        tolerances = {"rtol": start.tol, "atol": start.tol} if start.tol else {}
        if solver == "odeint":

            def integrate(y: np.ndarray, t_end: float) -> np.ndarray | None:
                rows, said = odeint(
                    field, y, (0.0, t_end), tfirst=True, mxstep=STEP_LIMIT, full_output=True, **tolerances
                )
                return rows[1] if said["message"] == "Integration successful." else None

            return _calls(start, integrate)
        made = _dop853(field, tolerances)

        def whole(y: np.ndarray, t_end: float) -> np.ndarray | None:
            end = made.set_initial_value(y, 0.0).integrate(t_end)
            return end if made.successful() else None

        return _calls(start, whole)

    return prepare


def fast(solver: str) -> Peer:
    """Make a peer outside the registry from SciPy's older interfaces, whose loops over steps are compiled.

    ``solver`` is "odeint" (LSODA) or "ode" (DOP853); the right-hand side is compiled, too.
    """
    work = {"odeint": _odeint, "ode": _ode}[solver]
    name = {"odeint": "LSODA", "ode": "DOP853"}[solver]

    def run(task: Task) -> Run:
        field = compiled_field(task.system)
        field(0.0, task.state)
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the returned messages say the same
            started = time.perf_counter()
            rows, steps, evaluations, failure = work(field, task)
            seconds = time.perf_counter() - started
        return Run.of_states(rows, steps, evaluations, seconds, failure)

    return Peer(
        f"scipy-{solver}({name})",
        f"{name} by scipy.integrate.{solver}, its loop compiled, right-hand side compiled by Numba",
        package="scipy",
        adaptive=True,
        order=None,
        license="BSD-3-Clause",
        about="rtol = atol = tol; SciPy's older interface",
        source="Petzold 1983; Hairer, Norsett & Wanner 1993, II.5",
        run=run,
        prepare=_prepare_fast(solver),
        lacks=_off,
        claims=Claims(source=DOCUMENTATION.format(solver)),
        least=100 * float(np.finfo(float).eps),
    )
