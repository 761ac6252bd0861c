r"""Brouwer's law: the power of time with which the energy's round-off grows, over an ensemble of Kepler orbits.

Orbits of eccentricity 0.2 start from states that differ by thousandths.  The rms relative energy error over the
ensemble is fitted by :math:`c\,n^a` after n orbits between a hundredth of the span and its end; the interval of a is
the 95 % range over resampled ensembles.  Energies are computed in extended precision.  A run whose truncation error
dominates, the control, has a = 1.

Source: D. Brouwer, Astron. J. 46 (1937) 149; H. Rein, D. S. Spiegel, Mon. Not. R. Astron. Soc. 446 (2015) 1424;
F. Biscani, D. Izzo, Mon. Not. R. Astron. Soc. 504 (2021) 2614.
"""

from __future__ import annotations

from math import pi

import numpy as np

from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import Cell, ProblemKey, Rows, Unavailable, content
from phasebench.integrators.driver import OK, SKIPPED

TABLE = "printed_numbers_brouwer"
PROBLEM, VALUES = "kepler", {"e": 0.2}
STARTS, ORBITS, ROWS, SEED, SPREAD = 24, 10_000, 100, 33, 1e-3
#: Integrator -> tolerance, or None for its own; steps an orbit of a method with fixed steps.
CONTROL = ("heyoka", 1e-9)
OWN = ("rebound-ias15", "heyoka", "rebound-whfast-plain", "gauss-8", "wisdom-holman")
RUNS = (*((id, None) for id in OWN), CONTROL)
STEPS = 30
RESAMPLED = 400


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`), one for each integrator; none if ``quick``."""
    return [] if quick else [_cell(id, tol) for id, tol in RUNS]


def _cell(id: str, tol: float | None) -> Cell:
    of, parts = ProblemKey(PROBLEM, tuple(VALUES.items())), (tol, STARTS, ORBITS, STEPS)
    needs = content(TABLE, integrator(id).record, of, *parts, code=[__name__])
    key = {"integrator": id, "tolerance": tol}
    return Cell("printed_numbers", (TABLE,), key, measure_rows, (id, tol), needs, frozenset({id, PROBLEM}))


def starts() -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the `STARTS` initial states (q, p) of the ensemble, arrays (2,) each; they are the same in every run."""
    made, random = problem(PROBLEM, **VALUES), np.random.default_rng(SEED)
    y = np.array([made.q0, made.p0])
    return [tuple(y * (1 + SPREAD * random.uniform(-1, 1, y.shape))) for _ in range(STARTS)]


def energies(q: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Compute Kepler's energy, array (n,), of states q, p (n, 2), in extended precision."""
    q, p = q.astype(np.longdouble), p.astype(np.longdouble)
    return (p**2).sum(axis=-1) / 2 - 1 / np.sqrt((q**2).sum(axis=-1))


def errors(id: str, tol: float | None, orbits: int = ORBITS) -> np.ndarray:
    """Integrate all starts by the integrator ``id`` and return relative energy errors at `ROWS` equidistant times.

    The errors are an array (starts, `ROWS`); the last time is that of ``orbits`` orbits.  ``tol`` is the tolerance,
    None for the integrator's own.  Raises Unavailable without the integrator's package, RuntimeError if a run fails.
    """
    made, chosen = problem(PROBLEM, **VALUES), integrator(id)
    if chosen.adaptive:
        span = {"h": 2 * pi * orbits / ROWS, "steps": ROWS, "save_every": 1, "tol": tol}
    else:
        span = {"h": 2 * pi / STEPS, "steps": STEPS * orbits, "save_every": STEPS * orbits // ROWS}
    out = []
    for q0, p0 in starts():
        s = chosen.run(made, q0=tuple(map(float, q0)), p0=tuple(map(float, p0)), **span)
        if s.status == SKIPPED:
            raise Unavailable(s.reason)
        if s.status != OK:
            raise RuntimeError(f"{id}: {s.reason}")
        E = energies(s.q, s.p)
        out.append(((E[1:] - E[0]) / abs(E[0])).astype(float))
    return np.array(out)


def exponent(error: np.ndarray) -> tuple[float, float, float]:
    """Fit the power of time with which the rms error of an ensemble grows: (power, low, high).

    ``error`` is an array (starts, times), at equidistant times; low and high are the ends of the 95 % interval.
    """
    count = error.shape[1]
    rows = np.unique(np.geomspace(1, count, 12).astype(int))

    def fit(sample: np.ndarray) -> float:
        rms = np.sqrt((sample[:, rows - 1] ** 2).mean(axis=0))
        return float(np.polyfit(np.log(rows), np.log(rms), 1)[0])

    random = np.random.default_rng(SEED)
    found = [fit(error[random.integers(0, len(error), len(error))]) for _ in range(RESAMPLED)]
    low, high = np.quantile(found, (0.025, 0.975))
    return fit(error), float(low), float(high)


def measure_rows(id: str, tol: float | None) -> Rows:
    """Measure the growth of the energy error of the integrator ``id`` at a tolerance: one row, by table name.

    The row has the exponent with its interval, the rms error of the ensemble at the end, and ``bias``, the mean error
    at the end over this rms.  ``tol`` is the tolerance, None for the integrator's own.
    """
    error = errors(id, tol)
    a, low, high = exponent(error)
    row = {
        "integrator": id,
        "tolerance": tol,
        "starts": STARTS,
        "orbits": ORBITS,
        "exponent": a,
        "low": low,
        "high": high,
    }
    end = error[:, -1]
    rms = float(np.sqrt((end**2).mean()))
    return {TABLE: [row | {"rms": rms, "bias": float(end.mean() / rms)}]}
