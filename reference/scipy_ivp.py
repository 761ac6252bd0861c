"""SciPy's DOP853 with a Python right-hand side: its time is mostly that of the calls into Python.

Source: E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I (1993), II.5; SciPy's
`scipy.integrate.DOP853`.
"""

from __future__ import annotations

import time

import numpy as np

#: SciPy's own defaults.
RTOL, ATOL = 1e-3, 1e-6


def run(problem, q0, p0, times, tol: float | None = None):
    """Integrate with rtol = atol = ``tol`` (SciPy's defaults without it) and give the states at ``times`` from 0.

    A row inside a step comes from the method's dense output, the last one is the end of the last step.

    Returns (q, p of shape (rows, d), steps, evaluations, seconds, what failed or None).
    """
    from scipy.integrate import DOP853

    system = getattr(problem, "system", problem)
    d = system.d
    field = system.vector_field()
    y = np.concatenate([q0, p0]).astype(float)
    field(0.0, y)
    rows = np.empty((len(times), 2 * d))
    rows[0] = y
    row, steps, failure = 1, 0, None
    with np.errstate(all="ignore"):
        started = time.perf_counter()
        solver = DOP853(field, 0.0, y, times[-1], rtol=RTOL if tol is None else tol, atol=ATOL if tol is None else tol)
        while solver.status == "running" and failure is None:
            message = solver.step()
            if solver.status == "failed" or not np.isfinite(solver.y).all():
                failure = message or "the state is no longer finite"
                break
            steps += 1
            if row < len(times) - 1 and times[row] <= solver.t:
                inside = solver.dense_output()
                while row < len(times) - 1 and times[row] <= solver.t:
                    rows[row] = inside(times[row])
                    row += 1
        seconds = time.perf_counter() - started
    if failure is None:
        rows[row], row = solver.y, row + 1
    return rows[:row, :d], rows[:row, d:], steps, int(solver.nfev), seconds, failure
