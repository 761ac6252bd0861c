r"""The expected acceptance of Hamiltonian Monte Carlo with each method, at equal numbers of gradient evaluations.

A proposal is a run over the time T from a state (q, p) that is drawn from the density :math:`e^{-H}`; it is accepted
with the probability :math:`\min(1, e^{-\Delta H})`.  The mean of this probability over independent draws is the
expected acceptance in the stationary state, with a normal interval; no chain is run, and there is no burn-in.  All
methods get the same draws.

.. math::
    H = \tfrac12 |p|^2 + \sum_{i=1}^{d} v(\omega_i q_i),\qquad \omega_i = 2 i,

with :math:`v(x) = x^2/2`, the Gaussian target, or :math:`v(x) = x^2/2 + x^4/4`, the quartic one, for which x is drawn
by rejection from the normal density.  The budget of a run is its number of gradient evaluations: a method with n
evaluations a step has h = T n / budget; a kick with a gradient of the force counts as two.

Source: S. Blanes, F. Casas, J. M. Sanz-Serna, SIAM J. Sci. Comput. 36 (2014) A1556-A1580.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.measure.oscillator import find
from phasebench.benchmarks.measure.timing import median, time_in_turns
from phasebench.benchmarks.page.page import ROWS, Data, Picture, Table, of
from phasebench.benchmarks.page.study import Claim, Runs, Study, over
from phasebench.benchmarks.page.verdict import NONE, at_most
from phasebench.benchmarks.store.cells import ALONE
from phasebench.integrators.ensemble import integrate_ensemble
from phasebench.integrators.registry import BY_ID
from phasebench.integrators.systems.hamiltonian import Hamiltonian

if TYPE_CHECKING:
    from phasebench.integrators.ensemble import Ensemble

ACCEPTANCE, TIMES, LIMITS = "sampling_acceptance", "sampling_times", "sampling_limits"
#: Degrees of freedom, length of a proposal's run, number of proposals, seed of the draws.
D, TIME, DRAWS, SEED = 8, 2.25, 1500, 30
#: Target -> v(x).
TARGETS = {"Gaussian": "x**2/2", "quartic": "x**2/2 + x**4/4"}
#: Target -> evaluations of the gradient in a run, such that the frequencies are resolved.
BUDGETS = {"Gaussian": (36, 48, 72, 96), "quartic": (72, 96, 144, 192)}
#: Budgets that both targets have.
COMMON = sorted(set.intersection(*map(set, BUDGETS.values())))
#: Standard deviations of a normal mean's 95 % interval.
NORMAL = 1.96
VERLET = "stormer-verlet"
#: Method -> evaluations of the gradient in a step.
STAGES = {
    VERLET: 1,
    "mclachlan-s2": 2,
    "omelyan-2": 2,
    "blanes-casas-sanz-serna-2": 2,
    "blanes-casas-sanz-serna-3": 3,
    "predescu-3": 3,
    "blanes-casas-sanz-serna-4": 4,
    "pefrl": 4,
}
GRADIENTS = {"takahashi-imada": 2, "chin-4a": 3, "hessian-free-badab": 3, "omelyan-4-3f1g-p": 4}
EVALUATIONS = STAGES | GRADIENTS
SEVERAL = [m for m in STAGES if m != VERLET]
#: Steps of a timed run; rounds of the timing.
STEPS, ROUNDS = 2000, 9
#: Method -> the limit of h omega as printed by Blanes, Casas and Sanz-Serna 2014.
PRINTED = {"blanes-casas-sanz-serna-3": "4.67", "blanes-casas-sanz-serna-4": "5.35"}
#: Smallest rejection that the figure shows.
FLOOR = 1e-4


# -- acceptance --------------------------------------------------------------------------------------------------------


def system(target: str) -> Hamiltonian:
    """The system of a target, H = |p|^2 / 2 + sum of v(2 i q_i) over i = 1, ..., `D`."""
    q, p = ([f"{x}{i}" for i in range(1, D + 1)] for x in "qp")
    terms = [TARGETS[target].replace("x", f"({2 * i}*q{i})") for i in range(1, D + 1)]
    return Hamiltonian(q=q, p=p, H=f"({' + '.join(f'{x}**2' for x in p)})/2 + {' + '.join(terms)}")


def draws(target: str, n: int = DRAWS) -> tuple[np.ndarray, np.ndarray]:
    """``n`` independent states (q, p) of the density exp(-H), arrays (n, `D`), the same at each call."""
    generator = np.random.default_rng(SEED)
    p = generator.standard_normal((n, D))
    x = generator.standard_normal((n, D))
    if target == "quartic":
        rejected = generator.random((n, D)) > np.exp(-(x**4) / 4)
        while rejected.any():
            x[rejected] = generator.standard_normal(rejected.sum())
            rejected[rejected] = generator.random(rejected.sum()) > np.exp(-(x[rejected] ** 4) / 4)
    return x / (2 * np.arange(1, D + 1)), p


def _budgets(target: str, method: str) -> list[int]:
    return [budget for budget in BUDGETS[target] if budget % EVALUATIONS[method] == 0]


def _propose(of: Hamiltonian, q: np.ndarray, p: np.ndarray, method: str, budget: int) -> Ensemble:
    steps = budget // EVALUATIONS[method]
    return integrate_ensemble(of, method, q, p, h=TIME / steps, steps=steps, threads=1)


def mean_acceptance(target: str, method: str, budget: int, n: int = DRAWS) -> dict[str, float]:
    """The expected acceptance of ``n`` proposals with its 95 % interval, the failed ones, which count as rejected,
    and the median of |Delta H|.
    """
    of, (q, p) = system(target), draws(target, n)
    found = _propose(of, q, p, method, budget)
    reached = np.isclose(found.t, TIME)
    with np.errstate(all="ignore"):
        error = np.where(reached, of.energies(found.q, found.p) - of.energies(q, p), np.inf)
        accepted = np.exp(-np.clip(error, 0.0, 700.0)) * np.isfinite(error)
    half = NORMAL * accepted.std(ddof=1) / np.sqrt(n)
    mean = float(accepted.mean())
    return {
        "acceptance": mean,
        "low": float(max(0.0, mean - half)),
        "high": float(min(1.0, mean + half)),
        "failed": int((~reached).sum()),
        "median energy error": float(np.median(np.abs(error))),
    }


def acceptance(target: str, method: str) -> list[dict]:
    """The expected acceptance at each budget that is a whole number of steps."""
    each = EVALUATIONS[method]
    return [
        {"evaluations per step": each, "budget": n, "h": TIME * each / n} | mean_acceptance(target, method, n)
        for n in _budgets(target, method)
    ]


# -- times and limits --------------------------------------------------------------------------------------------------


def times(target: str) -> list[dict]:
    """Acceptance and nanoseconds of a proposal, and of an accepted one: a row for each method and budget.

    A step is timed in a long run of all draws on one thread, the methods in turns.
    """
    of, (q, p) = system(target), draws(target)
    runs = {id: partial(_propose, of, q, p, id, STEPS * each) for id, each in EVALUATIONS.items()}
    rows = []
    for id, seconds in time_in_turns(runs, ROUNDS).items():
        step = median(seconds / DRAWS / STEPS * 1e9)
        for budget in _budgets(target, id):
            steps, accepted = budget // EVALUATIONS[id], mean_acceptance(target, id, budget)["acceptance"]
            row = {"method": id, "budget": budget, "acceptance": accepted}
            row |= {"ns a proposal": steps * step.value, "ns, low": steps * step.low, "ns, high": steps * step.high}
            rows.append(row | {"ns an accepted proposal": steps * step.value / accepted if accepted else inf})
    return rows


def limits(method: str) -> dict:
    """The end of the first interval of stable h omega, whole and per evaluation, and the printed one ("" if none)."""
    limit, each = find(integrator(method)).limit, EVALUATIONS[method]
    printed = PRINTED.get(method, "")
    return {"evaluations per step": each, "limit": limit, "limit per evaluation": limit / each, "printed": printed}


# -- judging -----------------------------------------------------------------------------------------------------------


def best(frame: pd.DataFrame, methods: Iterable[str]) -> pd.DataFrame:
    """The row of that one of the methods which accepts most, by target and budget."""
    rows = frame[frame["method"].isin(methods)]
    at = ["target", "budget"]
    return rows.loc[rows.groupby(at, sort=False)["acceptance"].idxmax()].set_index(at)


def ahead(methods: Iterable[str], others: Iterable[str]) -> Callable[[Data], pd.DataFrame | None]:
    """Whether the best of the methods is ``ahead`` of the best of others: their 95 % intervals do not overlap."""

    @of(ACCEPTANCE)
    def judged(frame: pd.DataFrame) -> pd.DataFrame:
        both = best(frame, methods).join(best(frame, others).add_suffix(" of others"), how="inner")
        return both.assign(ahead=both["low"] > both["high of others"]).reset_index()

    return judged


def _behind(rows: pd.DataFrame) -> str:
    wrong = [str(budget) for budget in rows["budget"][~rows["ahead"]]]
    return f"{', '.join(wrong)} evaluations" if wrong else ""


def least(rows: pd.DataFrame) -> pd.DataFrame:
    """The row of the least time an accepted proposal, by target and method."""
    at = ["target", "method"]
    return rows.loc[rows.groupby(at, sort=False)["ns an accepted proposal"].idxmin()].set_index(at)


def several_over_verlet(rows: pd.DataFrame) -> pd.Series:
    """The least time of splittings of several stages over that of Stormer-Verlet, by target with the fastest one."""
    found = least(rows)["ns an accepted proposal"].unstack()
    several = found.reindex(columns=SEVERAL).dropna(axis=1, how="all")
    if VERLET not in found or several.empty:
        return pd.Series(dtype=float)
    return (several.min(axis=1) / found[VERLET]).set_axis(several.index + ", " + several.idxmin(axis=1))


def agrees(rows: pd.DataFrame) -> pd.Series:
    """True where a limit, rounded to the digits of the printed one, equals it."""
    printed = rows["printed"].astype(str)
    digits = printed.str.partition(".")[2].str.len()
    return pd.Series([f"{x:.{n}f}" == s for x, n, s in zip(rows["limit"], digits, printed, strict=True)], rows.index)


# -- what is shown -----------------------------------------------------------------------------------------------------


@of(ACCEPTANCE)
@style.styled
def _draw(frame: pd.DataFrame, folder: Path) -> list[Picture]:
    figure, (panels,) = style.panels(1, len(BUDGETS), 3.4, sharey=True)
    for axes, target in zip(panels, BUDGETS, strict=True):
        rows = frame[frame["target"] == target]
        for k, (method, part) in enumerate(rows.groupby("method", sort=False)):
            look = style.curve(k) | {"linestyle": ":" if method in GRADIENTS else "-"}
            axes.loglog(part["budget"], (1 - part["acceptance"]).clip(lower=FLOOR), label=method, **look)
        axes.set(title=f"{target} target", xlabel="evaluations in a run")
        axes.grid(color="0.93", linewidth=0.5)
    panels[0].set_ylabel("share rejected")
    style.legend_above(figure, panels[0], 3)
    caption = "Share of proposals that are rejected over the evaluations of a run. Dotted lines: force gradients."
    return [Picture(style.save(figure, folder, "sampling.png"), "rejected proposals over the cost", caption)]


def _table(data: Data) -> Table | None:
    frame, stable, timed = (data(name) for name in (ACCEPTANCE, LIMITS, TIMES))
    if frame is None or stable is None:
        return None
    shown = frame[frame["budget"].isin(COMMON)].pivot_table(
        index=["target", "method"], columns="budget", values="acceptance", sort=False
    )
    shown.columns = [f"accepted at {c}" for c in shown.columns]
    limit = stable.set_index("method")[["evaluations per step", "limit", "limit per evaluation"]]
    shown = shown.reset_index().join(limit, on="method")
    caption = (
        "Shares accepted with so many evaluations a run, and the stability limits of h ω, whole and per evaluation"
    )
    if timed is not None:
        cheapest = least(timed)[["ns an accepted proposal", "budget"]].rename(columns={"budget": "with evaluations"})
        shown = shown.join(cheapest, on=["target", "method"])
        caption += "; the least time an accepted proposal, and the evaluations of that run"
    return Table(shown.head(ROWS), f"{caption}.", 4)


METHODS = tuple(BY_ID[id] for id in EVALUATIONS)
STUDY = Study(
    id="sampling",
    place=330,
    question="Which explicit splitting accepts most in Hamiltonian Monte Carlo?",
    answer="Splittings of several stages accept more than Störmer–Verlet in {gaussian.n} of "
    "{gaussian.of} Gaussian cases and {quartic.n} of {quartic.of} quartic ones; force gradients are best in "
    "{gradients.n} of {gradients.of}.",
    setting=(
        "H = |p|²/2 + Σ v(2 i qᵢ), i = 1 … 8, with v = x²/2 (Gaussian) or v = x²/2 + x⁴/4 (quartic).",
        f"{DRAWS} independent draws (q, p) of the density exp(−H); a run over T = {TIME:g} from each.",
        "Accepted is the mean of min(1, exp(−ΔH)): the expected acceptance in the stationary state, without a chain.",
        "All methods have the same number of gradients in a run; a kick with a force gradient counts as two.",
        "Time: of a step in a long run of all draws on one thread, methods in turns, times the steps, divided by the "
        "acceptance. Stability limits: of the step's matrix on the harmonic oscillator.",
    ),
    runs=(
        Runs(ACCEPTANCE, acceptance, [{"target": t, "method": m} for t in TARGETS for m in EVALUATIONS]),
        Runs(TIMES, times, over(target=tuple(TARGETS)), needs=METHODS, where=ALONE, own=True),
        Runs(LIMITS, limits, over(method=tuple(EVALUATIONS))),
    ),
    claims={
        "gaussian": Claim(
            "A splitting of several stages accepts more than Störmer–Verlet, Gaussian target",
            ahead(SEVERAL, [VERLET]), "ahead", rows="target == 'Gaussian'", unit="numbers of evaluations",
            where=_behind,
        ),
        "quartic": Claim(
            "A splitting of several stages accepts more than Störmer–Verlet, quartic target",
            ahead(SEVERAL, [VERLET]), "ahead", rows="target == 'quartic'", unit="numbers of evaluations",
            where=_behind,
        ),
        "gradients": Claim(
            "No force gradient accepts more than every splitting at equal evaluations",
            ahead(GRADIENTS, STAGES), "ahead", NONE, unit="targets and numbers of evaluations",
            where="{target}, {budget} evaluations",
        ),
        "cheapest": Claim(
            "A splitting of several stages takes less time an accepted proposal than Störmer–Verlet",
            TIMES, several_over_verlet, at_most(1.0), unit="times its time", span=True,
        ),
        "printed": Claim(
            "Stability limits round to those that the authors print",
            LIMITS, agrees, rows="printed == printed", unit="limits", where="{method}, printed {printed}",
        ),
    },
    checks={
        "shares": Claim(
            "Acceptances are probabilities in their own intervals",
            ACCEPTANCE, "(0 <= low) & (low <= acceptance) & (acceptance <= high) & (high <= 1)",
        ),
        "takes": Claim("Every proposal takes a time", TIMES, "`ns a proposal` > 0"),
        "accepts": Claim("Every method accepts", TIMES, lambda rows: rows.groupby("method")["acceptance"].max() > 0),
        "stable": Claim("Every method has a limit", LIMITS, "limit > 0"),
    },
    figure=_draw,
    shown=_table,
    limits=(
        "More is said where the 95 % intervals do not overlap; methods share their draws, so that this is strict.",
        "A run that fails or leaves the finite numbers counts as rejected.",
        "Acceptance alone is no efficiency of sampling: how far a proposal moves is the same for all, as T is.",
        "The least time is among the numbers of evaluations in the figure; fewer might be cheaper still.",
        "Eight frequencies in a ratio of one to eight; other spectra may rank the methods otherwise.",
    ),
)  # fmt: skip
