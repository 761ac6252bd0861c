r"""Brouwer's law: the power of time with which the energy's round-off grows, over an ensemble of Kepler orbits.

Orbits of eccentricity 0.2 start from states that differ by thousandths.  The rms relative energy error over the
ensemble is fitted by :math:`c\,n^a` after n orbits between a hundredth of the span and its end; the interval of a is
the 95 % range over resampled ensembles.  A run whose truncation error dominates, the control, has a = 1.

Source: D. Brouwer, Astron. J. 46 (1937) 149; H. Rein, D. S. Spiegel, Mon. Not. R. Astron. Soc. 446 (2015) 1424;
F. Biscani, D. Izzo, Mon. Not. R. Astron. Soc. 504 (2021) 2614.
"""

from __future__ import annotations

from math import pi

import numpy as np
import pandas as pd

from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.page.study import Runs
from phasebench.benchmarks.page.verdict import Between
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import ProblemKey

from .runs import finished, kepler_energies

TABLE = "printed_numbers_brouwer"
PROBLEM, VALUES = "kepler", {"e": 0.2}
STARTS, ORBITS, ROWS, SEED, SPREAD = 24, 10_000, 100, 33, 1e-3
#: Integrator and its tolerance, None for its own; steps an orbit of a method with fixed steps.
CONTROL = ("heyoka", 1e-9)
OWN = ("rebound-ias15", "heyoka", "rebound-whfast-plain", "gauss-8", "wisdom-holman")
STEPS = 30
RESAMPLED = 400


def errors(id: str, tol: float | None, orbits: int = ORBITS) -> np.ndarray:
    """Relative energy errors of all starts at equidistant times up to that of ``orbits`` orbits: (starts, `ROWS`)."""
    made, random = problem(PROBLEM, **VALUES), np.random.default_rng(SEED)
    if integrator(id).adaptive:
        span = {"h": 2 * pi * orbits / ROWS, "steps": ROWS, "save_every": 1, "tol": tol}
    else:
        span = {"h": 2 * pi / STEPS, "steps": STEPS * orbits, "save_every": STEPS * orbits // ROWS}
    y, out = np.array([made.q0, made.p0]), []
    for _ in range(STARTS):
        q0, p0 = (tuple(map(float, x)) for x in y * (1 + SPREAD * random.uniform(-1, 1, y.shape)))
        s = finished(made, id, q0=q0, p0=p0, **span)
        E = kepler_energies(s.q, s.p)
        out.append(((E[1:] - E[0]) / abs(E[0])).astype(float))
    return np.array(out)


def exponent(error: np.ndarray) -> tuple[float, float, float]:
    """The power of time with which the rms error of an ensemble (starts, times) grows, and its 95 % interval."""
    count = error.shape[1]
    rows = np.unique(np.geomspace(1, count, 12).astype(int))

    def fit(sample: np.ndarray) -> float:
        rms = np.sqrt((sample[:, rows - 1] ** 2).mean(axis=0))
        return float(np.polyfit(np.log(rows), np.log(rms), 1)[0])

    random = np.random.default_rng(SEED)
    found = [fit(error[random.integers(0, len(error), len(error))]) for _ in range(RESAMPLED)]
    low, high = np.quantile(found, (0.025, 0.975))
    return fit(error), float(low), float(high)


def growth(integrator: str, tolerance: float | None) -> dict:
    """The exponent with its interval, the ensemble's rms error at the end, and the mean error over it (``bias``)."""
    error = errors(integrator, tolerance)
    a, low, high = exponent(error)
    end = error[:, -1]
    rms = float(np.sqrt((end**2).mean()))
    row = {"starts": STARTS, "orbits": ORBITS, "exponent": a, "low": low, "high": high}
    return row | {"rms": rms, "bias": float(end.mean() / rms)}


def root(rows: pd.DataFrame) -> Between:
    """1/2 within the farther end of an exponent's own interval."""
    (row,) = rows.itertuples()
    spread = max(row.high - row.exponent, row.exponent - row.low)
    return Between(0.5 - spread, 0.5 + spread)


RUNS = Runs(
    TABLE,
    growth,
    [{"integrator": id, "tolerance": tol} for id, tol in (*((id, None) for id in OWN), CONTROL)],
    needs=lambda **key: (integrator(key["integrator"]).record, ProblemKey(PROBLEM, tuple(VALUES.items()))),
)
