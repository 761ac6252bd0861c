r"""Measurements on trajectories for the talks' figures: images of sets, areas, errors, thinning, Poincare sections.

The area within a closed curve is that of its trigonometric interpolant, the polygon formula
:math:`\tfrac12\sum (q_i p_{i+1} - q_{i+1} p_i)` in the limit of many vertices: with
:math:`q + \mathrm ip = \sum_k c_k e^{\mathrm ik\theta}` it is :math:`\pi\sum_k k\,|c_k|^2`, exact to round-off for an
analytic curve if the n vertices are enough, while the polygon's own area has an error O(n^-2).

Source: E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration (2006), VI.2; M. Henon, Physica D 5 (1982)
412-414 (sections).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from phasebench.benchmarks import problems
from phasebench.benchmarks.measure.accuracy import end_state
from phasebench.benchmarks.store.arrays import pack
from phasebench.benchmarks.style import number
from phasebench.integrators import integrate
from phasebench.integrators.errors import InvalidInput

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from phasebench.benchmarks.problems.base import Problem
    from phasebench.integrators.solution import Solution
    from phasebench.integrators.systems.hamiltonian import Formula

#: The tables of the checks, and of the figures' curves.
CHECKS, CURVES = "talk_checks", "talk_curves"
#: The values of lambda in the talk's figures.
LAMBDAS = (Fraction(-1), Fraction(1, 3), Fraction(3, 2), Fraction(2))

#: Zero errors are drawn at this value on logarithmic axes.
FLOOR = 1e-18

#: Largest number of points of a stored curve, and their significant digits: a figure of 7 inches shows no more.
POINTS, DIGITS = 2500, 4

#: Refinement differences below this are not used for an order: round-off is near.
NOISE = 1e-12


@dataclass(frozen=True)
class Figure:
    """A figure of the talks: ``measure`` returns a row for each curve, None if it shows only formulae.

    ``draw`` makes of these rows (matplotlib figure, caption); all integration happens in ``measure``.
    """

    id: str
    title: str
    measure: Callable[[], list[dict[str, Any]]] | None
    draw: Callable[[pd.DataFrame], tuple]


@cache
def start(name: str) -> Problem:
    """The problem with the name "id" or "id:orbit", made only once so that its functions stay compiled."""
    return problems.problem(name)


def run(problem: Problem, id: str, h: float, t_end: float, **parameters: Any) -> Solution:
    """Integrate a problem by the method ``id`` with its ``parameters`` and step h to ``t_end``: its `Solution`."""
    return integrate(problem, id, h=h, t_end=t_end, parameters=parameters)


def error(problem: Problem, expression: Formula, solution: Solution) -> np.ndarray:
    """|F - F0| of an expression F in q and p along a solution, array (n,); F0 is its first value."""
    values = problem.system.observe(expression, solution.q, solution.p)
    return np.abs(values - values[0])


def energy_error(problem: Problem, solution: Solution) -> np.ndarray:
    """The energy error |H - H0| along a solution, array (n,)."""
    return error(problem, problem.system.H, solution)


def binned_maxima(t: np.ndarray, e: np.ndarray, bins: int = 200) -> tuple[np.ndarray, np.ndarray]:
    """Thin a curve (t, e) without losing peaks: (times, values) of the largest e in each of ``bins`` equal pieces."""
    edges = np.linspace(0, len(e), min(bins, len(e)) + 1).astype(int)
    best = np.array([a + np.argmax(e[a:b]) for a, b in pairwise(edges)])
    return t[best], e[best]


def for_log_axis(e: np.ndarray) -> np.ndarray:
    """The errors ``e`` for a logarithmic axis: values below `FLOOR`, such as zeros, are raised to `FLOOR`."""
    return np.maximum(e, FLOOR)


def floor_note(errors: Iterable[np.ndarray]) -> str:
    """The caption's sentence about zeros drawn at `FLOOR`; empty if no error is zero."""
    return f" Zeros are drawn at {number(FLOOR)}." if any((e == 0).any() for e in errors) else ""


def row(
    panel: str,
    curve: str,
    x: ArrayLike,
    y: ArrayLike,
    solution: Solution | None = None,
    digits: int = DIGITS,
    **values: Any,
) -> dict:
    """The row of one curve of a figure: its panel, label ``curve``, run, points (x, y), and further columns."""
    of_run = {}
    if solution is not None:
        of_run = {
            "method": solution.method.label,
            "name": solution.method.name,
            "h": solution.h,
            "t_end": float(solution.t[-1]),
            "status": solution.status,
            "reason": solution.reason,
            "steps": solution.counts["steps"],
            "fallbacks": solution.counts["fallbacks"],
        }
    return {"panel": panel, "curve": curve} | of_run | values | {"x": pack(x, digits), "y": pack(y, digits)}


def thin_path(q: np.ndarray, until: int | None = None, n: int = POINTS) -> np.ndarray:
    """Thin a plane path, array (steps, 2), to at most ``n`` points that are about equally spaced: array (m, 2)."""
    q = q[:until]
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(q, axis=0).T))])
    return q[np.unique(np.searchsorted(along, np.linspace(0, along[-1], n)).clip(max=len(q) - 1))]


def troubles(rows: pd.DataFrame) -> str:
    """The caption's sentences about failed integrations, and about steps without an energy-preserving lambda."""
    text = "".join(f" {r.method}: {r.status}." for r in rows[rows["status"] != "ok"].itertuples())
    sums = rows.groupby("name", sort=False)[["fallbacks", "steps"]].sum()
    missed = [f"{int(r.fallbacks)} of {int(r.steps)} ({r.Index})" for r in sums.itertuples() if r.fallbacks]
    return text + (f" Steps without a root λ, taken with λ = 1/2: {', '.join(missed)}." if missed else "")


def carry(
    problem: Problem, id: str, points: np.ndarray, h: float, snapshots: int, substeps: int = 1, **parameters: Any
) -> np.ndarray:
    """Map points (q, p), array (n, 2 d), by a method: array (snapshots + 1, n, 2 d), whose first entry is the points.

    Between two snapshots are ``substeps`` steps h.  Raises InvalidInput if the integration of a point fails.
    """
    d = points.shape[1] // 2
    rows = []
    for y in points:
        s = integrate(
            problem, id, h=h, steps=snapshots * substeps, q0=y[:d], p0=y[d:], save_every=substeps, parameters=parameters
        )
        if s.status not in ("ok", "inaccurate", "unstable"):  # the map is shown, whatever its energy error
            raise InvalidInput(f"the point {y.tolist()} is lost: {s.status}, {s.reason}")
        rows.append(np.hstack([s.q, s.p]))
    return np.stack(rows, axis=1)


def enclosed_area(curve: np.ndarray) -> float:
    """The oriented area within a closed curve through points (q, p), array (n, 2); counterclockwise is positive."""
    n = len(curve)
    c = np.fft.fft(curve[:, 0] + 1j * curve[:, 1]) / n
    return float(np.pi * np.sum(np.fft.fftfreq(n, 1 / n) * np.abs(c) ** 2))


def polygon_area(vertices: np.ndarray) -> float:
    """The oriented area of a polygon with vertices (x, y), array (n, 2); counterclockwise is positive."""
    (x, y), (x1, y1) = vertices.T, np.roll(vertices, -1, axis=0).T
    return float(np.sum(x * y1 - x1 * y) / 2)


def circle(centre: tuple[float, float], radius: float, n: int) -> np.ndarray:
    """N points on a circle, array (n, 2)."""
    angle = 2 * np.pi * np.arange(n) / n
    return np.array(centre) + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def cat(centre: tuple[float, float], size: float, n: int) -> np.ndarray:
    """N points on the outline of a cat's face, array (n, 2): an analytic curve, a circle with two ears."""
    angle = 2 * np.pi * np.arange(n) / n
    ears = sum(np.exp(18 * (np.cos(angle - at) - 1)) for at in (np.pi / 4, 3 * np.pi / 4))
    r = size * (1 + 0.55 * ears)
    return np.array(centre) + np.stack([r * np.cos(angle), r * np.sin(angle)], axis=1)


def section(problem: Problem, solution: Solution) -> np.ndarray:
    """The Poincare section q1 = 0, p1 > 0 of a solution with H = |p|^2 / 2 + U(q): (q2, p2), array (n, 2)."""
    q, p, h = solution.q, solution.p, solution.h
    y = np.hstack([q[:, :2], p[:, 1:2]])
    rates = [*problem.system.dq[:2], problem.system.dp[1]]
    dy = np.stack([problem.system.observe(e, q, p) for e in rates], axis=1)
    i = np.flatnonzero((q[:-1, 0] < 0) & (q[1:, 0] >= 0))

    def at(s: np.ndarray) -> np.ndarray:
        s = s[:, None]
        a, b = (1 + 2 * s) * (1 - s) ** 2, s * s * (3 - 2 * s)
        c, d = s * (1 - s) ** 2, s * s * (s - 1)
        return a * y[i] + b * y[i + 1] + h * (c * dy[i] + d * dy[i + 1])

    low, high = np.zeros(len(i)), np.ones(len(i))
    for _ in range(50):
        middle = (low + high) / 2
        before = at(middle)[:, 0] < 0
        low, high = np.where(before, middle, low), np.where(before, high, middle)
    return at((low + high) / 2)[:, 1:]


def refinement_differences(
    problem: Problem, id: str, steps: Sequence[int], t_end: float = 1.0, **parameters: Any
) -> tuple[np.ndarray, np.ndarray, list[Solution]]:
    """Integrate a problem with numbers of steps that double, and compare end states: (h, max |y_h - y_2h|, solutions).

    The differences are the largest over q and p at ``t_end``; for n numbers in ``steps``, h and differences are arrays
    (n - 1,), and there are n solutions.  A difference is NaN if a run failed.
    """
    runs = [integrate(problem, id, t_end=t_end, steps=n, save_every=0, parameters=parameters) for n in steps]
    ends = [end_state(s) + (0 if s.status == "ok" else np.nan) for s in runs]
    h = t_end / np.array(steps[1:])
    return h, np.abs(np.diff(ends, axis=0)).max(axis=1), runs


def observed_order(h: np.ndarray, differences: np.ndarray) -> float:
    """Fit the order: the log-log slope of ``differences`` over the three smallest h with differences above `NOISE`."""
    clear = differences > NOISE
    if clear.sum() < 2:
        return float("nan")
    return float(np.polyfit(np.log(h[clear][-3:]), np.log(differences[clear][-3:]), 1)[0])
