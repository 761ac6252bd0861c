"""Energy errors of guides' examples: of SciMLBenchmarks.jl's orbits over growing times, and of IAS15 on Kepler orbits.

KahanLi8 (Kahan and Li's method of order 8) has the benchmarks' step of 0.01, once with compensated sums and once, as in
the benchmarks, with plain ones.  SciPy's DOP853 at its smallest tolerance stands for the benchmarks' Vern9 and DPRKN12
at tolerance 1e-14, heyoka's Taylor series for their Taylor methods.  IAS15's error is the largest over 100 revolutions,
at 1009 times whose phases all differ, with energies in extended precision.

Source: SciMLBenchmarks.jl, benchmarks/DynamicalODE; REBOUND's documentation of IAS15.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import pi
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from phasebench.benchmarks.measure.integrator import integrator as integrator_of
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.study import Runs, over
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.benchmarks.store.cells import ProblemKey
from phasebench.integrators.driver import OK
from phasebench.integrators.registry import BY_ID
from phasebench.reference.peers.field import split_gradients

from .runs import kepler_energies, ran

if TYPE_CHECKING:
    from phasebench.integrators.systems.hamiltonian import Hamiltonian

TABLE, IAS15 = "field_says_energy", "field_says_ias15"
HENON, BOSON = "henon-heiles", "quadrupole-boson"
#: Problem -> (initial state q, p; times).
SCENES = {
    HENON: (((0.1, 0.0), (0.0, 0.5)), (1e2, 1e3, 1e4, 5e4)),
    BOSON: (((4.919080920016389, 2.836942666663649), (0.0, 0.0)), (1e2, 1e3, 1e4, 2e4)),
}
COMPENSATED, PLAIN, STEP = "kahan-li-8", "kahan-li-8, plain sums", 0.01
#: Integrator -> its tolerance; None with steps of `STEP`.
RUN = {COMPENSATED: None, PLAIN: None, "scipy-dop853-numba": 2.3e-14, "heyoka": 1.2e-16}
OTHERS = tuple(id for id in RUN if id not in (COMPENSATED, PLAIN))
#: Rows up to the last time; at constant steps every `EVERY`-th step.
ROWS, EVERY = 50_000, 100
#: IAS15's eccentricities, revolutions and rows.
ECCENTRICITIES, ORBITS, TIMES = (0.0, 0.3, 0.6, 0.9, 0.99, 0.999), 100, 1009


def plain(system: Hamiltonian, q: Sequence[float], p: Sequence[float], h: float, steps: int, every: int) -> np.ndarray:
    """States (q, p) at the start and after each ``every`` steps of KahanLi8 without compensated sums: (rows, 2 d)."""
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


def energy(problem: str, integrator: str) -> list[dict]:
    """The largest relative energy error up to each time of a problem that the run reaches."""
    made, ((q, p), times), tol = problem_of(problem), SCENES[problem], RUN[integrator]
    steps, status = round(times[-1] / STEP), OK
    if integrator == PLAIN:
        states = plain(made.system, q, p, STEP, steps, EVERY)
        t = np.arange(len(states)) * EVERY * STEP
        values = made.system.energies(states[:, : made.system.d], states[:, made.system.d :])
    else:
        size = {"tol": tol, "t_end": times[-1], "steps": ROWS} if tol else {"h": STEP, "steps": steps}
        s = ran(made, integrator, **size, q0=q, p0=p, save_every=1 if tol else EVERY)
        t, values, status = s.t, s.energy(), s.status
    off = np.abs(values / values[0] - 1)
    found = [float(off[t <= end * (1 + 1e-9)].max()) if t[-1] > end * (1 - 1e-9) else np.nan for end in times]
    return [{"tol": tol, "status": status, "t": end, "energy error": x} for end, x in zip(times, found, strict=True)]


def ias15(e: float) -> dict:
    """IAS15's largest relative energy error on the Kepler orbit of eccentricity e."""
    s = ran(problem_of("kepler", e=e), "rebound-ias15", t_end=2 * pi * ORBITS, steps=TIMES)
    E = kepler_energies(s.q, s.p)
    return {"status": s.status, "energy error": float(np.abs(E / E[0] - 1).max())}


def _needs(problem: str, integrator: str) -> tuple:
    record = BY_ID[COMPENSATED] if integrator == PLAIN else integrator_of(integrator).record
    return record, ProblemKey(problem), integrator


RUNS = (
    Runs(TABLE, energy, [{"problem": p, "integrator": i} for p in SCENES for i in RUN], needs=_needs),
    Runs(IAS15, ias15, over(e=ECCENTRICITIES),
         needs=lambda e: (integrator_of("rebound-ias15").record, ProblemKey("kepler", (("e", e),)))),
)  # fmt: skip


def beside(rows: pd.DataFrame) -> pd.DataFrame:
    """KahanLi8's energy error over the smallest of the others, by time, with each kind of its sums."""
    errors = rows.pivot_table(index="t", columns="integrator", values="energy error").reindex(columns=[*RUN])
    return errors[[COMPENSATED, PLAIN]].div(errors[list(OTHERS)].min(axis=1), axis=0).dropna()


def short(rows: pd.DataFrame) -> pd.Series:
    """The ratio with plain sums at the first time."""
    first = beside(rows).head(1)
    names = [f"plain sums, t = {t:g}; {number(x)} with compensated ones" for t, x in first[COMPENSATED].items()]
    return first[PLAIN].set_axis(names)


def later(rows: pd.DataFrame) -> pd.Series:
    """The ratio with plain sums at the last time over that at the first."""
    found = beside(rows)[PLAIN]
    if found.empty:
        return found
    found = found.iloc[[0, -1]]
    ends = ", ".join(f"{number(x)} at t = {t:g}" for t, x in found.items())
    return pd.Series({f"plain sums; {ends}": found.iloc[1] / found.iloc[0]})


def harder(rows: pd.DataFrame) -> pd.Series:
    """The energy error of each other integrator at t = 1000 on the quadrupole boson over that on Henon-Heiles."""
    errors = rows[rows["integrator"].isin(OTHERS)].pivot_table(
        index="integrator", columns="problem", values="energy error"
    )
    found = (errors[BOSON] / errors[HENON]).dropna() if {HENON, BOSON} <= {*errors} else pd.Series(dtype=float)
    return found.set_axis([f"t = 1000; {id}" for id in found.index])


def largest(rows: pd.DataFrame) -> str:
    """The eccentricity with the largest error."""
    row = rows.loc[rows["energy error"].idxmax()]
    return f"e = {row['e']:g}: {number(row['energy error'])}"
