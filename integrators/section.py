r"""Poincare sections of ensembles: where orbits cross a plane :math:`x = c` of one coordinate or momentum.

Between the two rows of an orbit that have the plane between them, the flow itself is integrated to the plane, with x as
the independent variable in the place of time (Henon 1982):

.. math::
    \frac{\mathrm dy}{\mathrm dx} = \frac{f(y)}{f_x(y)},\qquad \frac{\mathrm dt}{\mathrm dx} = \frac1{f_x(y)},

from the row that is nearer, by `SUBSTEPS` steps of the classical Runge-Kutta method.  The point is on the plane to the
last bit, and as exact as the rows as long as these are close.

Source: M. Henon, On the numerical computation of Poincare maps, Physica D 5 (1982) 412-414.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from .ensemble import Ensemble, integrate_ensemble
from .errors import InvalidInput

SUBSTEPS = 8


@dataclass(frozen=True)
class Section:
    """The crossings of an ensemble, in the order of the orbits and of time; m of them in all.

    Attributes
    ----------
    orbit : array (m,), the number of the orbit
    t : array (m,), the times
    q, p : arrays (m, d)
    status : array (n,) of text, how each orbit ended; its crossings before are there
    seconds : of the integration and of the search
    """

    orbit: np.ndarray
    t: np.ndarray
    q: np.ndarray
    p: np.ndarray
    status: np.ndarray
    seconds: float

    def counts(self) -> np.ndarray:
        """The number of crossings of each orbit, array (n,)."""
        return np.bincount(self.orbit, minlength=len(self.status))


def section(
    problem, method, Q, P, *, of: str, at: float = 0.0, rising: bool = True, every: int = 1, **options
) -> Section:
    """Integrate an ensemble and find its crossings of a plane.

    Parameters
    ----------
    problem, method, Q, P : as of `integrate_ensemble`
    of, at : the coordinate or momentum by its name, such as "q1", and its value on the plane
    rising : whether crossings with a rising coordinate count, else those with a falling one
    every : look at every so many-th step; two crossings between two looks are missed
    options : h, t_end, steps, parameters, lanes, threads of `integrate_ensemble`

    Returns
    -------
    Section

    Raises
    ------
    InvalidInput
        For input that cannot be used.
    """
    system = getattr(problem, "system", problem)
    names = [str(x) for x in (*getattr(system, "q", ()), *getattr(system, "p", ()))]
    if of not in names:
        raise InvalidInput(f"there is no coordinate or momentum {of!r}; there are {', '.join(names)}")
    if isinstance(every, bool) or not isinstance(every, int) or every < 1:
        raise InvalidInput(f"every is {every!r}; it must be a positive integer")
    if "save_every" in options:
        raise InvalidInput("a section keeps no rows: say how often it looks with every")
    ensemble = integrate_ensemble(problem, method, Q, P, save_every=every, **options)
    began = time.perf_counter()
    orbit, t, q, p = _crossings(system, ensemble, names.index(of), float(at), 1.0 if rising else -1.0)
    return Section(orbit, t, q, p, ensemble.status, ensemble.seconds + time.perf_counter() - began)


def _crossings(system, ensemble: Ensemble, k: int, at: float, sign: float):
    """(orbit, t, q, p) of the crossings of component k of (q, p) with sign * y[k] rising through the plane."""
    x = sign * ((ensemble.Q[..., k] if k < system.d else ensemble.P[..., k - system.d]) - at)
    with np.errstate(invalid="ignore"):
        orbit, row = np.nonzero((x[:, :-1] < 0) & (x[:, 1:] >= 0))
    row = row + (np.abs(x[orbit, row + 1]) < np.abs(x[orbit, row]))
    y = np.hstack([ensemble.Q[orbit, row], ensemble.P[orbit, row], ensemble.times[orbit, row, None]])
    y = _to_plane(system, y, k, at)
    there = np.isfinite(y).all(1)
    y, orbit = y[there], orbit[there]
    return orbit, y[:, -1], y[:, : system.d], y[:, system.d : -1]


def _to_plane(system, y: np.ndarray, k: int, at: float) -> np.ndarray:
    """States with their times, rows (m, 2 d + 1), carried by the flow to where component k is ``at``."""
    sides = (*system.dq, *system.dp)

    def slope(y):
        f = np.stack([system.observe(e, y[:, : system.d], y[:, system.d : -1]) for e in sides], axis=1)
        with np.errstate(all="ignore"):
            return np.hstack([f, np.ones((len(y), 1))]) / f[:, k, None]

    dx = ((at - y[:, k]) / SUBSTEPS)[:, None]
    for _ in range(SUBSTEPS):
        a = slope(y)
        b = slope(y + dx / 2 * a)
        c = slope(y + dx / 2 * b)
        y = y + dx / 6 * (a + 2 * b + 2 * c + slope(y + dx * c))
    y[:, k] = at
    return y
