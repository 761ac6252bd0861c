"""Brouwer's law where the frequency depends on the energy: Wisdom-Holman's method on the Kepler problem.

The method solves this problem exactly, so that all errors are round-off.  On the oscillator every orbit has the same
period, and a random walk of the energy gives the phase a random walk of its own, n^(1/2).  Here a change of the energy
changes the period: the error of the mean anomaly M = E - e sin E is the sum of the random walk, n^(3/2).  Energy,
semi-axis and anomaly are computed from the rows in extended precision.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import mpmath
import numpy as np

from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import Cell, ProblemKey, Rows, content
from phasebench.integrators.driver import integrate

from . import brouwer
from .methods import record

METHOD, PROBLEM = "wisdom-holman", "kepler"
LABEL = f"{METHOD} on Kepler"
#: Step size, steps of a run, range of the starts' eccentricities.
H, STEPS, ECCENTRICITIES = 0.0987654321, 262_144, (0.1, 0.6)


def cells(quick: bool = False) -> list[Cell]:
    """List the single measurement (`Cell`), of one ensemble of orbits; none if ``quick``."""
    needs = content("growth-kepler", record(METHOD), ProblemKey(PROBLEM), code=[__name__])
    key = {"label": LABEL, "h": H, "steps": STEPS}
    return (
        [] if quick else [Cell("extremes", brouwer.TABLES, key, measure_rows, (), needs, frozenset({METHOD, PROBLEM}))]
    )


def elements(q: Sequence[float] | np.ndarray, p: Sequence[float] | np.ndarray) -> tuple:
    """Compute (semi-major axis, mean anomaly) of a Kepler state q, p, (2,) each, in the working precision."""
    x, y, u, v = (mpmath.mpf(float(c)) for c in (*q, *p))
    r = mpmath.sqrt(x**2 + y**2)
    a = 1 / (2 / r - u**2 - v**2)
    cosine, sine = 1 - r / a, (x * u + y * v) / mpmath.sqrt(a)  # e cos E, e sin E
    return a, mpmath.atan2(sine, cosine) - sine


def errors(
    n: Sequence[int] | np.ndarray, Q: Sequence | np.ndarray, P: Sequence | np.ndarray, h: float
) -> tuple[np.ndarray, np.ndarray]:
    """Compute (relative errors of the energy, errors of the mean anomaly) at step numbers n, arrays as n.

    Q, P are the states, arrays (m, 2); row 0 is the start.
    """
    found = [elements(q, p) for q, p in zip(Q, P, strict=True)]
    a, first = found[0]
    rate = mpmath.mpf(h) / a ** mpmath.mpf(1.5)
    late = [mpmath.arg(mpmath.expj(M - first - rate * int(k))) for k, (_, M) in zip(n, found, strict=True)]
    return np.array([float(a / b - 1) for b, _ in found]), np.array([float(x) for x in late])


def _starts(count: int) -> Iterator[tuple[tuple[float, float], tuple[float, float]]]:
    """Yield random pericentres of orbits with semi-major axis 1: pairs (q, p)."""
    generator = np.random.default_rng(brouwer.SEED)
    for e, angle in zip(generator.uniform(*ECCENTRICITIES, count), generator.uniform(0, 2 * np.pi, count), strict=True):
        speed, c, s = ((1 + e) / (1 - e)) ** 0.5, np.cos(angle), np.sin(angle)
        yield ((1 - e) * c, (1 - e) * s), (-speed * s, speed * c)


def measure_rows() -> Rows:
    """Measure round-off of Wisdom-Holman's method on Kepler orbits: a row on its growth, rows of rms errors over n."""
    made, every = problem(PROBLEM), STEPS // brouwer.ROWS
    rows = [0, *(brouwer.ROWS // 2**k for k in range(9, -1, -1))]
    n = np.array(rows) * every
    with mpmath.workdps(brouwer.DIGITS):
        found = []
        for q0, p0 in _starts(brouwer.STARTS):
            s = integrate(made, METHOD, h=H, steps=STEPS, q0=q0, p0=p0, save_every=every)
            found.append(errors(n, s.q[rows], s.p[rows], H))
    energy, phase = (np.array([f[k] for f in found])[:, 1:] for k in (0, 1))
    row = {"label": LABEL, "h": H, "steps": STEPS, "kind": brouwer.USUAL} | brouwer.summary(n[1:], H, energy, phase)
    del row["in units"]  # a unit that holds on the oscillator only
    return {brouwer.TABLES[0]: [row], brouwer.TABLES[1]: brouwer.curves(row, n[1:], energy, phase)}
