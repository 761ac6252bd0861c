"""The largest energy errors of an orbit over growing times: benchmarks of SciMLBenchmarks.jl, with other integrators.

KahanLi8 (Kahan and Li's method of order 8) is run with the benchmarks' step of 0.01, once with compensated sums and
once, as in the benchmarks, with plain ones.  SciPy's DOP853 at its smallest tolerance stands for the benchmarks' Vern9
and DPRKN12 at tolerance 1e-14, heyoka's Taylor series for their Taylor methods.

Source: SciMLBenchmarks.jl, benchmarks/DynamicalODE, Henon-Heiles and quadrupole boson.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import Cell, ProblemKey, Rows, Unavailable, content
from phasebench.integrators.driver import OK, SKIPPED
from phasebench.integrators.registry import BY_ID
from phasebench.reference.peers.field import split_gradients

if TYPE_CHECKING:
    from phasebench.integrators.systems.hamiltonian import Hamiltonian

TABLE = "field_says_energy"
#: Problem -> (initial state q, p; times).
SCENES = {
    "henon-heiles": (((0.1, 0.0), (0.0, 0.5)), (1e2, 1e3, 1e4, 5e4)),
    "quadrupole-boson": (((4.919080920016389, 2.836942666663649), (0.0, 0.0)), (1e2, 1e3, 1e4, 2e4)),
}
COMPENSATED, PLAIN, STEP = "kahan-li-8", "kahan-li-8, plain sums", 0.01
#: Integrator -> its tolerance; None with steps of `STEP`.
RUNS = {COMPENSATED: None, PLAIN: None, "scipy-dop853-numba": 2.3e-14, "heyoka": 1.2e-16}
#: Rows up to the last time; at constant steps every `EVERY`-th step.
ROWS, EVERY = 50_000, 100


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`), one for each problem and integrator; none if ``quick``."""
    return [] if quick else [_cell(name, id) for name in SCENES for id in RUNS]


def _record(id: str) -> Any:
    return BY_ID[COMPENSATED] if id == PLAIN else integrator(id).record


def _cell(name: str, id: str) -> Cell:
    parts = id, SCENES[name], RUNS[id], STEP, ROWS, EVERY
    needs = content(TABLE, _record(id), ProblemKey(name), *parts, code=[__name__])
    key = {"problem": name, "integrator": id}
    return Cell("field_says", (TABLE,), key, measure_rows, (name, id), needs, frozenset({COMPENSATED, id, name}))


def plain(system: Hamiltonian, q: Sequence[float], p: Sequence[float], h: float, steps: int, every: int) -> np.ndarray:
    """Integrate by KahanLi8 with plain sums, without compensation, from the state q, p in ``steps`` steps of length h.

    Returns the states (q, p) at the start and after each ``every`` steps, array (rows, 2 d).
    """
    import numba

    slope, velocity = split_gradients(system)
    weights = np.array([float(2 * c) for c, _, lam in BY_ID[COMPENSATED].data[1] if lam == 1])

    @numba.njit(error_model="numpy")
    def run(y: np.ndarray, h: float, steps: int, every: int) -> np.ndarray:
        d = len(y) // 2
        rows = np.empty((steps // every + 1, 2 * d))
        rows[0] = y
        for n in range(1, steps + 1):
            for w in weights:
                for half in range(2):
                    force = slope(y)
                    for i in range(d):
                        y[d + i] -= w * h / 2 * force[i]
                    if half == 0:
                        rate = velocity(y)
                        for i in range(d):
                            y[i] += w * h * rate[i]
            if n % every == 0:
                rows[n // every] = y
        return rows

    return run(np.concatenate([q, p]).astype(float), h, steps, every)


def measure_rows(name: str, id: str) -> Rows:
    """Measure an integrator's largest relative energy error up to each time of a problem: a row for each time.

    ``name`` is a key of `SCENES`, ``id`` one of `RUNS`.  Raises Unavailable if the integrator is not installed.
    """
    made, ((q, p), times), tol = problem(name), SCENES[name], RUNS[id]
    steps = round(times[-1] / STEP)
    if id == PLAIN:
        states = plain(made.system, q, p, STEP, steps, EVERY)
        t, status = np.arange(len(states)) * EVERY * STEP, OK
        energy = made.system.energies(states[:, : made.system.d], states[:, made.system.d :])
    else:
        size = {"tol": tol, "t_end": times[-1], "steps": ROWS} if tol else {"h": STEP, "steps": steps}
        s = integrator(id).run(made, **size, q0=q, p0=p, save_every=1 if tol else EVERY)
        if s.status == SKIPPED:
            raise Unavailable(s.reason)
        t, energy, status = s.t, s.energy(), s.status
    off = np.abs(energy / energy[0] - 1)
    head = {"problem": name, "integrator": id, "tol": tol, "status": status}
    found = [float(off[t <= end * (1 + 1e-9)].max()) if t[-1] > end * (1 - 1e-9) else np.nan for end in times]
    return {TABLE: [head | {"t": end, "energy error": x} for end, x in zip(times, found, strict=True)]}
