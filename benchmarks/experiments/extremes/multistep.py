r"""Step-size resonances of symmetric multistep methods on Kepler's orbit, over the number N of steps an orbit.

Errors :math:`\delta` of the recursion :math:`\sum_j\alpha_j q_{n+j} = h^2\sum_j\beta_j f(q_{n+j})` move by

.. math:: \sum_j \alpha_j\,\delta_{n+j} = h^2\sum_j\beta_j\,f'(q_{n+j})\,\delta_{n+j}.

On the circle :math:`q_n = a e^{in\varphi}`, :math:`\varphi = 2\pi/N`, with complex numbers for points, that has
constant coefficients in the turning frame: with :math:`K = h^2/a^3 = -\rho(e^{i\varphi})/\sigma(e^{i\varphi})` and
:math:`\rho_\pm(z) = \rho(e^{\pm i\varphi}z) - \tfrac K2\sigma(e^{\pm i\varphi}z)` the errors grow like the roots of

.. math:: \rho_+(z)\,\rho_-(z) - \tfrac94 K^2\,\sigma(e^{i\varphi}z)\,\sigma(e^{-i\varphi}z) = 0.

On an ellipse the errors grow like the eigenvalues of the product of all steps of two orbits (Floquet), q being the
exact orbit.  At a resonance an orbit lasts a whole number of periods of a parasitic root of rho: errors grow, but only
linearly in time.

The control is Stormer's method of order 7, which is not symmetric, by the same kernel.

Sources: G. D. Quinlan, arXiv:astro-ph/9901136 (1999), whose abstract makes the claims that the page tests; the
polynomial and the product of steps are derived here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from phasebench.benchmarks.measure.drift import drift
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import Cell, ProblemKey, Rows, content
from phasebench.integrators.coefficients.multistep import QUINLAN_TREMAINE, Multistep, stable_intervals, stormer
from phasebench.integrators.driver import integrate
from phasebench.integrators.record import DRIFT, Method
from phasebench.integrators.registry import BY_ID

if TYPE_CHECKING:
    from phasebench.integrators.solution import Solution

METHODS = tuple(f"quinlan-tremaine-{order}" for order in QUINLAN_TREMAINE)
ECCENTRICITIES = (0.0, 0.2)
#: Runs: their orbits, the largest N, the distance of two N, the rows of the beginning with which the rest is compared.
ORBITS, LAST, APART, BEGINNING = 2000, 300.0, 0.5, 40
#: Rows are this many an orbit, no whole number, so that they meet all phases.
ROWS = 3.7
#: Long runs off all resonances: their orbits, steps an orbit, eccentricity, steps between rows.
LONG, OFF, ECCENTRIC, EVERY = 5000, 251.0, 0.2, 16
#: Orbits of the control, and of the runs in which parasitic parts are seen.
SHORT = 1000
#: Parasitic parts are seen in differences of this order, in so many windows of a run, each of so many steps.
DIFFERENCE, WINDOWS, STEPS = 12, 96, 240
#: (label of a long run, steps an orbit): the methods, one that is unstable, and the control.
UNSTABLE, CONTROL = 132.0, "stormer-7"
RUNS = (*((id, OFF) for id in METHODS), ("quinlan-tremaine-14", UNSTABLE), (CONTROL, OFF))
TABLES = ("extremes_multistep", "extremes_multistep_drift")


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`): each method at each eccentricity, and each long run; none if ``quick``."""
    if quick:
        return []
    maps = [
        _cell(TABLES[0], {"method": id, "e": e}, measure_steps, (id, e), BY_ID[id])
        for id in METHODS
        for e in ECCENTRICITIES
    ]
    return maps + [_cell(TABLES[1], {"method": id, "N": n}, measure_long, (id, n), chosen(id)) for id, n in RUNS]


def _cell(table: str, key: dict, measure: Callable[..., Rows], arguments: tuple, method: Method) -> Cell:
    needs = content("multistep", method, *arguments, ProblemKey("kepler"), code=[__name__])
    return Cell(
        "extremes",
        (table,),
        key,
        measure,
        arguments,
        needs,
        frozenset({key["method"].replace(CONTROL, METHODS[0]), "kepler"}),
    )


def chosen(label: str) -> Method:
    """Return the method with this id; for `CONTROL` Stormer's method of order 7."""
    if label != CONTROL:
        return BY_ID[label]
    data = tuple(stormer(7, 8))
    return replace(BY_ID["quinlan-tremaine-8"], id=label, order=7, symmetric=False, energy=DRIFT, data=data)


# -- theory ------------------------------------------------------------------------------------------------------------


def _numbers(table: Multistep) -> tuple[np.ndarray, np.ndarray]:
    return np.array(table.alpha, float), np.array(table.numerators, float) / table.denominator


def circular_rate(table: Multistep, N: float) -> float:
    """Compute the logarithm of the factor per orbit by which errors grow on a circular orbit with N steps an orbit."""
    rho, sigma = _numbers(table)
    turn = np.exp(2j * np.pi / N * np.arange(len(rho)))
    K = -((rho @ turn) / (sigma @ turn)).real
    sides = [(rho - K / 2 * sigma) * t for t in (turn, turn.conj())]
    polynomial = np.convolve(*sides) - 9 / 4 * K**2 * np.convolve(sigma * turn, sigma * turn.conj())
    roots = np.roots(polynomial[::-1])
    parasitic = roots[np.abs(roots - 1) > 2.5 * np.pi / N]  # the others are 1 and near e^(i phi), of the orbit itself
    return float(np.log(np.abs(parasitic).max()) * N)


def orbit(e: float, t: np.ndarray) -> np.ndarray:
    """Compute positions (n, 2) at the times t on Kepler's orbit of semi-major axis 1 from pericentre, mu = 1."""
    E = np.array(t, float)
    for _ in range(60):
        E = E - (E - e * np.sin(E) - t) / (1 - e * np.cos(E))
    return np.stack([np.cos(E) - e, np.sqrt(1 - e**2) * np.sin(E)], axis=1)


def floquet_rate(table: Multistep, N: float, e: float) -> float:
    """Compute the logarithm of the factor per orbit by which errors grow on an orbit of eccentricity e with N steps.

    It follows from the linearized steps of two orbits, so that 2 N must be an integer.
    """
    alpha, beta = _numbers(table)
    k, n, h = len(alpha) - 1, round(2 * N), 2 * np.pi / N
    q = orbit(e, h * np.arange(n))
    r = np.hypot(*q.T)[:, None, None]
    slope = h**2 * (3 * q[:, :, None] * q[:, None, :] / r**5 - np.eye(2) / r**3)
    q = list(np.eye(2 * k).reshape(k, 2, 2 * k))
    f = [slope[i % n] @ q[i] for i in range(k)]
    for i in range(k, k + n):
        new = sum(beta[j] * f[j] for j in range(1, k)) - sum(alpha[j] * q[j] for j in range(k))
        q, f = [*q[1:], new], [*f[1:], slope[i % n] @ new]
    return float(np.log(np.abs(np.linalg.eigvals(np.concatenate(q))).max()) / 2)


# -- runs --------------------------------------------------------------------------------------------------------------


def _run(method: Method, e: float, N: float, orbits: float, every: int) -> Solution:
    start = {"q0": [1 - e, 0.0], "p0": [0.0, ((1 + e) / (1 - e)) ** 0.5]}
    with np.errstate(all="ignore"):
        return integrate(problem("kepler"), method, h=2 * np.pi / N, steps=int(orbits * N), save_every=every, **start)


def steps_asked(table: Multistep) -> np.ndarray:
    """Return the numbers N of steps an orbit at which a method is run, an array.

    They go from the method's stability limit on the oscillator to `LAST`, `APART` from each other.
    """
    limit = 2 * np.pi / stable_intervals(table)[0][1]
    return np.arange(np.ceil(limit / APART) * APART, LAST + APART / 2, APART)


def measure_steps(id: str, e: float) -> Rows:
    """Run a method at each number N of steps an orbit of eccentricity e: a row for each N, by table name.

    A row has the energy error at the beginning of the run and the largest one of the run, and the growth rate by the
    linear theory: the logarithm of the factor by which errors grow in an orbit.
    """
    method, rows = BY_ID[id], []
    table = Multistep(*method.data)
    for N in map(float, steps_asked(table)):
        s = _run(method, e, N, ORBITS, max(1, int(N / ROWS)))
        error = np.abs(s.energy() - s.energy()[0])
        theory = floquet_rate(table, N, e) if e else circular_rate(table, N)
        row = {"method": id, "order": method.order, "e": e, "N": N, "rate": theory, "status": s.status}
        rows.append(row | {"first": float(error[:BEGINNING].max()), "largest": float(np.nanmax(error))})
    return {TABLES[0]: rows}


def parasitic_amplitudes(method: Method, N: float, orbits: int) -> tuple[np.ndarray, np.ndarray]:
    """Measure parasitic oscillations in windows of a run: (times in orbits, sizes of high differences of q).

    ``N`` is the number of steps an orbit.  The differences, of order `DIFFERENCE` in the step number, leave hardly
    anything of the orbit itself.
    """
    s = _run(method, ECCENTRIC, N, orbits, 1)
    begin = np.linspace(len(s.q) // WINDOWS, len(s.q) - STEPS - 1, WINDOWS).astype(int)
    sizes = [np.abs(np.diff(s.q[b : b + STEPS], DIFFERENCE, axis=0)).max() for b in begin]
    return begin / N, np.array(sizes)


def measure_long(label: str, N: float) -> Rows:
    """Integrate over many orbits of N steps: a row of the energy's drift and of parasitic growth, with intervals."""
    method = chosen(label)
    s = _run(method, ECCENTRIC, N, LONG if label != CONTROL and N == OFF else SHORT, EVERY)
    energy = drift(s.t / (2 * np.pi), s.energy())
    t, sizes = parasitic_amplitudes(method, N, SHORT)
    growth = drift(t, np.log(sizes))
    row = {"method": label, "N": N, "orbits": float(s.t[-1] / (2 * np.pi)), "status": s.status}
    row |= {"slope": energy.value, "low": energy.low, "high": energy.high}
    row |= {"growth": growth.value, "growth low": growth.low, "growth high": growth.high}
    return {TABLES[1]: [row | {"amplitude": float(sizes.max())}]}
