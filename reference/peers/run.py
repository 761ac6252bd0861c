"""Loops over the rows of a run of a peer, an integrator of another package, and the status at its end."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from .record import NOT_FINITE, Run, Task

if TYPE_CHECKING:
    from phasebench.integrators.systems.hamiltonian import PartitionedSystem

#: For a singular system a relative change of the energy by more than this is a collision.
LOST = 10.0


def by_rows(
    task: Task, advance: Callable[[int, int], str | None], state: Callable[[], np.ndarray], gradients: int = 0
) -> Run:
    """Run a task from row to row, by calls of a package; they alone are timed.

    ``advance(i, n)`` takes n steps to row i and returns the reason if it fails, else None; ``state()`` is the state
    (q, p) reached, a new array (2 d,).  ``gradients`` is the number of gradient evaluations in a step.
    """
    rows, seconds, steps, failure = [task.state], 0.0, 0, None
    for i, (before, number) in enumerate(pairwise(task.numbers), start=1):
        started = time.perf_counter()
        failure = advance(i, number - before)
        seconds += time.perf_counter() - started
        if failure:
            break
        steps, y = number, state()
        if not np.isfinite(y).all():
            failure = NOT_FINITE
            break
        rows.append(y)
    return Run.of_states(np.array(rows), steps, gradients * steps, seconds, failure)


def by_pieces(
    task: Task, pieces: Iterable[int], integrate: Callable[[np.ndarray, int], np.ndarray | None], gradients: int = 0
) -> Run:
    """Run a task by calls of a package that return the states after each of their steps; the calls alone are timed.

    ``pieces`` are the numbers of steps of the calls; ``integrate(y, n)`` returns the states after 1, ..., n steps from
    y = (q, p), array (n, 2 d), or None if Newton's method did not converge.
    """
    y, steps, rows, seconds, failure = task.state, 0, [task.state[None]], 0.0, None
    numbers = np.asarray(task.numbers[1:])
    for n in pieces:
        started = time.perf_counter()
        states = integrate(y, n)
        seconds += time.perf_counter() - started
        if states is None:
            failure = f"Newton's method did not converge within {n} steps after {steps}"
            break
        rows.append(states[numbers[(numbers > steps) & (numbers <= steps + n)] - steps - 1])
        y, steps = np.array(states[-1]), steps + n
        if not np.isfinite(y).all():
            failure = NOT_FINITE
            break
    return Run.of_states(np.concatenate(rows), steps, gradients * steps, seconds, failure)


def ending(
    system: PartitionedSystem, times: np.ndarray, q: np.ndarray, p: np.ndarray, failure: str | None
) -> tuple[str, str, int]:
    """Judge a peer's run by its states: (status, reason, number of rows to keep).

    q and p, arrays (n, d), are the states (rows) at the first n of ``times``; ``failure`` is the reason for which the
    package stopped, or None.  The rows before the first one in which the state or H is not finite are kept.
    """
    from phasebench.integrators.outcome import COLLISION, DIVERGED, energy_unit, judge

    finite = np.isfinite(q).all(axis=1) & np.isfinite(p).all(axis=1)
    rows = len(q) if finite.all() else int(np.argmin(finite))
    if rows < len(times):
        why = (failure or NOT_FINITE).rstrip(".")
        return DIVERGED, f"{why}; the rows end at t = {times[rows - 1]:.6g} of {times[-1]:.6g}", rows
    H = system.observe(system.H, q, p) if system.H is not None else np.zeros(rows)
    if not np.isfinite(H).all():
        rows = int(np.isfinite(H).argmin())
        return DIVERGED, f"the state is outside H's domain; the rows end at t = {times[rows - 1]:.6g}", rows
    if system.singular and system.H is not None:
        worst = float(np.abs(H - H[0]).max())
        if worst > LOST * energy_unit(system, q, p):
            return COLLISION, f"the energy {H[0]:.6g} changed by {worst:.3g}: the orbit met the singularity", rows
    return *judge(system, times[:rows], q, p, "take a smaller step or tolerance"), rows
