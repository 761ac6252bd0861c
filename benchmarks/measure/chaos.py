r"""``lyapunov``: the largest Lyapunov exponent of orbits, with an interval, and MEGNO.

A tangent vector delta is carried along an orbit's rows by the tangent maps of `lyapunov`.  The exponent is the mean of
its growth :math:`\ln(|\delta_{k+1}| / |\delta_k|)` over the time, after a first part in which delta turns to the
direction that grows most; the interval is that of the means of blocks of time, by Student's t.  For regular orbits the
exponent falls as ln t / t, and

.. math:: Y(t) = \frac2t\int_0^t \frac{d\ln|\delta|}{ds}\,s\,ds

averages to 2 (MEGNO), while it grows as the exponent times t / 2 for chaotic ones.

Source: G. Benettin, L. Galgani, A. Giorgilli, J.-M. Strelcyn, Meccanica 15 (1980) 9-30; P. M. Cincotta, C. Simo,
Astron. Astrophys. Suppl. 147 (2000) 205-228 (MEGNO).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from phasebench.benchmarks.problems import problem as problem_of
from phasebench.integrators.driver import OK
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.keywords import Parameters, State, States, method_parameters

from .integration import integrate
from .integrator import AnyProblem, Integrator, integrator, parameters_of
from .lyapunov import tangent_maps
from .metrics import CONFIDENCE
from .tabular import TabularResult

if TYPE_CHECKING:
    import pandas as pd

    from phasebench.integrators.record import Method
    from phasebench.reference.peers import Peer

#: The share of the time in which the tangent vector turns, and the number of blocks of the rest.
TURNING, BLOCKS = 0.1, 20
#: The fewest rows from which an exponent is told, and rows whose tangent maps are in memory at once.
FEWEST, AT_ONCE = 200, 4096


@dataclass(frozen=True, repr=False)
class Lyapunov(TabularResult):
    """Largest Lyapunov exponents, one for each orbit, in units of 1 / time.

    Attributes
    ----------
    exponent, low, high : arrays (n,), with the 95 % interval from blocks of time
    megno : array (n,), the mean of Y(t): 2 for a regular orbit
    t_end : array (n,), the time of each orbit
    status : array (n,) of texts, of the orbits; without "ok" there is no exponent
    """

    exponent: np.ndarray
    low: np.ndarray
    high: np.ndarray
    megno: np.ndarray
    t_end: np.ndarray
    status: np.ndarray

    def to_frame(self) -> pd.DataFrame:
        """A row for each orbit."""
        import pandas as pd

        return pd.DataFrame(vars(self))


@method_parameters(parameters_of)
def lyapunov(
    problem: AnyProblem,
    method: str | Path | Method | Peer | Integrator,
    *,
    h: float | str | None = None,
    t_end: float | str | None = None,
    steps: int | None = None,
    tol: float | None = None,
    q0: State | States | None = None,
    p0: State | States | None = None,
    save_every: int = 1,
    parameters: Parameters | None = None,
) -> Lyapunov:
    """Measure the largest Lyapunov exponent of an orbit, or of each of many orbits.

    Parameters
    ----------
    problem, method, h, t_end, steps, tol, parameters : as in `integrate`
    q0, p0 : arrays (d,), or (n, d) for n orbits; by default the problem's initial state
    save_every : the tangent map is taken over so many steps; its error is of the order of their time to the power 4

    Returns
    -------
    Lyapunov
        The exponent with its interval, MEGNO and the status of each orbit.

    Raises
    ------
    InvalidInput
        For unusable input, and for a run of fewer than 200 rows.

    Examples
    --------
    >>> found = lyapunov("henon-heiles:chaotic", "gauss-4", h=0.1, t_end=300)
    >>> bool(found.low[0] > 0 and found.megno[0] > 4)
    True
    """
    found = problem_of(problem) if isinstance(problem, (str, Path)) else problem
    chosen: Any = integrator(method, parameters=parameters)
    system = getattr(found, "system", found)
    if system.constrained or not hasattr(system, "dq"):
        raise InvalidInput("the tangent map is that of a Hamiltonian system without constraints")
    starts = _pairs(q0, p0)
    size: dict[str, Any] = {"h": h, "t_end": t_end, "steps": steps, "tol": tol, "save_every": save_every}
    rows = [_of_orbit(system, integrate(found, chosen, **size, q0=q, p0=p)) for q, p in starts]
    columns = zip(*rows, strict=True)
    return Lyapunov(*(np.array(column) for column in columns))


def _pairs(q0: Any, p0: Any) -> list[tuple[Any, Any]]:
    if np.ndim(q0) < 2 and np.ndim(p0) < 2:
        return [(q0, p0)]
    if np.shape(q0) != np.shape(p0):
        raise InvalidInput(f"q0 and p0 have shapes {np.shape(q0)} and {np.shape(p0)}; orbits are rows of two (n, d)")
    return list(zip(np.asarray(q0), np.asarray(p0), strict=True))


def _of_orbit(system: Any, s: Any) -> tuple[float, float, float, float, float, str]:
    """(Exponent, low, high, MEGNO, time, status) of a solution."""
    from scipy.special import stdtrit

    span = float(s.t[-1] - s.t[0])
    if s.status != OK:
        return (*4 * (float("nan"),), span, s.status)
    if len(s.t) < FEWEST:
        raise InvalidInput(f"the orbit has {len(s.t)} rows; an exponent needs {FEWEST}: take more steps")
    whole = s.whole or s
    grown = _growth(system, s.t, whole.q, whole.p)
    t = np.abs(s.t - s.t[0])
    first = int(np.searchsorted(t, TURNING * t[-1]))
    total = np.concatenate([[0.0], np.cumsum(grown)])
    edges = np.linspace(first, len(grown), BLOCKS + 1).astype(int)
    means = np.diff(total[edges]) / np.diff(t[edges])
    exponent = (total[-1] - total[first]) / (t[-1] - t[first])
    half = float(stdtrit(BLOCKS - 1, 0.5 + CONFIDENCE / 2)) * float(np.std(means, ddof=1)) / np.sqrt(BLOCKS)
    Y = 2 * np.cumsum(grown * (t[1:] + t[:-1]) / 2) / t[1:]
    megno = float(np.sum(Y * np.diff(t)) / t[-1])
    return float(exponent), float(exponent - half), float(exponent + half), megno, span, s.status


def _growth(system: Any, t: np.ndarray, q: np.ndarray, p: np.ndarray) -> np.ndarray:
    """The logarithm of the growth of a tangent vector from row to row, array (n - 1,)."""
    d = q.shape[1] - system.driven
    real = np.ix_(*2 * (np.concatenate([np.arange(d), q.shape[1] + np.arange(d)]),))  # the time is not displaced
    delta = np.cos(np.arange(1, 2 * d + 1))
    delta /= np.linalg.norm(delta)
    out = np.empty(len(t) - 1)
    for k in range(0, len(out), AT_ONCE):
        part = slice(k, k + AT_ONCE + 1)
        for j, M in enumerate(tangent_maps(system, t[part], q[part], p[part]), start=k):
            delta = M[real] @ delta
            size = np.linalg.norm(delta)
            out[j] = np.log(size)
            delta /= size
    return out
