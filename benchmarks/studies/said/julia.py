r"""Methods that OrdinaryDiffEq.jl's guide names, as this suite has them: growth of errors, cost, orders.

- **Growth**: each revolution of a Kepler orbit gives the largest energy error within it, and the distance from the
  start at its end.  The largest errors up to n revolutions are fitted by :math:`c\,n^a` over the last decade.
- **Cost**: the error of the end state, against Gauss's method of order 16, at ever smaller steps.
- **Orders** for :math:`T = p^2/2` and for :math:`T = \sqrt{1 + p^2}`, :math:`V = q^2/2 + q^4/4`: kicks by b_i, then
  drifts by a_i.

Source: OrdinaryDiffEq.jl, documentation of OrdinaryDiffEqSymplecticRK; R. I. McLachlan, P. Atela, Nonlinearity 5 (1992)
541-562; E. Hairer, Ch. Lubich, G. Wanner, Geometric Numerical Integration (2006), X.3.1.
"""

from __future__ import annotations

from itertools import pairwise
from math import pi

import numpy as np
import pandas as pd

from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.study import Runs, over
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.benchmarks.store.cells import ProblemKey
from phasebench.integrators.driver import OK, integrate
from phasebench.integrators.registry import BY_ID

GROWTH, COST, ORDERS = "field_says_growth", "field_says_cost", "field_says_orders"
#: This suite's methods, by their names in OrdinaryDiffEq.jl, and two that are not symplectic.
METHODS = {
    "symplectic-euler-q": "SymplecticEuler",
    "stormer-verlet": "VelocityVerlet",
    "mclachlan-atela-2": "McAte2",
    "ruth-3": "Ruth3",
    "mclachlan-atela-3": "McAte3",
    "forest-ruth": "CandyRoz4",
    "mclachlan-atela-4": "McAte4",
    "calvo-sanz-serna-4": "CalvoSanz4",
    "mclachlan-atela-5": "McAte5",
    "kahan-li-6": "KahanLi6",
    "kahan-li-8": "KahanLi8",
}
STANDARD = {"rk4": "RK4", "dop853": "DP8"}
#: Growth: the error of KahanLi8 is round-off soon.  Steps of a revolution: the error is small, and above round-off.
GROWING = tuple(id for id in (*METHODS, *STANDARD) if id != "kahan-li-8")
STEPS = {"symplectic-euler-q": 2000, "kahan-li-6": 50, "dop853": 20}
KEPLER, USUAL, ORBITS = {"e": 0.2}, 200, 1000
#: Positions that are off by more are on another part of the orbit; rows of a revolution.
LARGEST, PHASES = 0.3, 100
#: Cost: problem -> (parameters, span, evaluations a unit of time that the ladder of steps begins with).
SCENES = {
    "henon-heiles:box": ({}, 100.0, 4),
    "pendulum:swinging": ({}, 100.0, 4),
    "kepler": ({"e": 0.3}, 20 * np.pi, 8),
    "outer-solar-system": ({}, 20_000.0, 1 / 400),
    "quadrupole-boson": ({}, 10.0, 32),
}
RUNGS = 20
#: The errors of the state for which evaluations are compared.
ERRORS = tuple(10.0**-k for k in range(1, 11))
#: Orders: the stated ones, kinetic energies, start, span and numbers of steps.
STATED = {"mclachlan-atela-4": 4, "mclachlan-atela-5": 5}
QUADRATIC, OTHER = "p²/2", "√(1 + p²)"
START, SPAN, HALVED = (0.7, 0.4), 4.0, (64, 128, 256)
MCATE2, VERLET = "mclachlan-atela-2", "stormer-verlet"


def power(errors: np.ndarray) -> float:
    """The power with which the running maximum of the errors of n revolutions grows, over the last decade of n."""
    n = np.arange(1, len(errors) + 1)
    late = n >= len(errors) / 10
    return float(np.polyfit(np.log(n[late]), np.log(np.maximum.accumulate(errors)[late]), 1)[0])


def growth(method: str) -> dict:
    """The powers of time of the errors of energy and position, the largest energy error and the last position error."""
    made, steps = problem_of("kepler", **KEPLER), STEPS.get(method, USUAL)
    s = integrate(made, method, h=2 * pi / steps, steps=steps * ORBITS, save_every=max(1, steps // PHASES))
    rows = len(s.q) // ORBITS
    off = np.hypot(*(s.q[rows::rows] - s.q[0]).T)
    off = off[: next((k for k, x in enumerate(off) if x > LARGEST), len(off))]
    energy = np.abs(s.energy()[1:] / s.energy()[0] - 1).reshape(ORBITS, rows).max(axis=1)
    row = {"called": (METHODS | STANDARD)[method], "symplectic": method in METHODS, "status": s.status}
    row |= {"energy power": power(energy), "position power": power(off)}
    return row | {"energy error": float(energy.max()), "position error": float(off[-1])}


def reference(problem: str) -> tuple[np.ndarray, float]:
    """The end state (q, p) by Gauss's method of order 16, and its distance from that at half as many steps."""
    values, span, least = SCENES[problem]
    made, ends = problem_of(problem, **values), []
    for n in (1, 2):
        s = integrate(made, "gauss-8", t_end=span, steps=round(span * least * 4 * n), save_every=0)
        ends.append(np.concatenate([s.q[-1], s.p[-1]]))
    return ends[1], float(np.abs(ends[1] - ends[0]).max())


def cost(problem: str, method: str) -> list[dict]:
    """The error of the end state and gradient evaluations, a row for each run that reaches the end.

    Steps are about sqrt(2) times shorter each time.  A gradient shared with the next step counts once.
    """
    values, span, least = SCENES[problem]
    made, (exact, uncertainty), rows = problem_of(problem, **values), reference(problem), []
    stages = round(integrate(problem_of("pendulum"), method, h=0.01, steps=100).counts["gradient"] / 100)
    for k in range(RUNGS):
        n = max(1, round(span * least * 2 ** (k / 2) / stages))
        s = integrate(made, method, t_end=span, steps=n, save_every=0)
        if s.status == OK:
            error = float(np.abs(np.concatenate([s.q[-1], s.p[-1]]) - exact).max())
            row = {"called": METHODS[method], "uncertainty": uncertainty, "steps": n}
            rows.append(row | {"evaluations": s.counts["gradient"], "error": error})
    return rows


def end(id: str, steps: int, quadratic: bool) -> np.ndarray:
    """The end state (q, p) after `SPAN`, with T = p^2 / 2 if ``quadratic``, else sqrt(1 + p^2)."""
    a, b = (tuple(map(float, x)) for x in BY_ID[id].data)
    (q, p), h = START, SPAN / steps
    for _ in range(steps):
        for drift, kick in zip(a, b, strict=True):
            p -= h * kick * (q + q**3)
            q += h * drift * (p if quadratic else p / np.sqrt(1 + p * p))
    return np.array([q, p])


def orders(method: str) -> list[dict]:
    """The order from the errors at the smaller steps, and ``before`` at the larger ones, for each kinetic energy."""
    rows = []
    for T in (QUADRATIC, OTHER):
        finest = end(method, 16 * HALVED[-1], T == QUADRATIC)
        errors = [np.abs(end(method, n, T == QUADRATIC) - finest).max() for n in HALVED]
        before, order = (float(np.log2(x / y)) for x, y in pairwise(errors))
        row = {"called": METHODS[method], "said": STATED[method], "T": T}
        rows.append(row | {"order": order, "before": before})
    return rows


def _needs(problem: str, method: str, reference: str = "gauss-8") -> tuple:
    return BY_ID[method], BY_ID[reference], ProblemKey(problem, tuple(SCENES[problem][0].items()))


RUNS = (
    Runs(GROWTH, growth, over(method=GROWING), needs=(ProblemKey("kepler", tuple(KEPLER.items())),)),
    Runs(COST, cost, [{"problem": p, "method": m} for p in SCENES for m in METHODS], needs=_needs),
    Runs(ORDERS, orders, over(method=tuple(STATED))),
)


def fewest(rows: pd.DataFrame) -> pd.DataFrame:
    """The fewest evaluations with which a method meets an error, infinite if it does not, by "problem to error"."""
    found = {
        (f"{name} to {error:g}", id): part.loc[part["error"] <= error, "evaluations"].astype(float).min()
        for (name, id), part in rows.groupby(["problem", "method"], sort=False)
        for error in ERRORS
    }
    return pd.Series(found, dtype=float).unstack().reindex(columns=list(METHODS)).fillna(np.inf)


def than_verlet(rows: pd.DataFrame) -> pd.Series:
    """VelocityVerlet's evaluations over McAte2's, where both reach an error."""
    found = fewest(rows)[[VERLET, MCATE2]]
    found = found[found.max(axis=1) < np.inf]
    return found[VERLET] / found[MCATE2]


def than_best(rows: pd.DataFrame) -> pd.Series:
    """McAte2's evaluations over the fewest, where it reaches an error."""
    found = fewest(rows)
    return (found[MCATE2] / found.min(axis=1)).replace(np.inf, np.nan).dropna()


def best(rows: pd.DataFrame) -> pd.Series:
    """Percent of problems and errors that some method reaches in which McAte2 or McAte3 is best, by the usual best."""
    found = fewest(rows)
    first = found[found.min(axis=1) < np.inf].idxmin(axis=1)
    usual = first.map(METHODS).value_counts().index[:1]
    return pd.Series(100 * first.isin([MCATE2, "mclachlan-atela-3"]).mean(), [f"most often {name}" for name in usual])


def quadratic(rows: pd.DataFrame, every: pd.DataFrame, text: str) -> str:
    """The order of the rows' method where the kinetic energy is quadratic, in a text with {order}."""
    there = every[every["method"].isin(rows["method"]) & (every["T"] == QUADRATIC)]
    return text.format(order=", ".join(map(number, there["order"])))
