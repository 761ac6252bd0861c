"""Splittings of H into many parts with known flows, around black holes, beside ordinary methods."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas as pd

from phasebench.benchmarks.measure.global_error import end_error
from phasebench.benchmarks.measure.orders import successive
from phasebench.benchmarks.page.shared import growth, order_off
from phasebench.benchmarks.page.study import Claim, Curves, Runs, Shown, Study, over
from phasebench.benchmarks.page.verdict import at_least, at_most
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.integrators.driver import integrate
from phasebench.integrators.registry import BY_ID, METHODS

ACCURACY, ENERGY = "parts_accuracy", "parts_energy"
PROBLEMS = ("kerr", "magnetized-schwarzschild:inner")
SPLIT = tuple(m.id for m in METHODS if m.family == "parts")
ORDINARY = ("rk4", "implicit-midpoint", "gauss-4")
SPAN, STEPS = 1000.0, tuple(125 * 2**k for k in range(6))
#: Errors above this many times the reference's uncertainty, and above this, are errors of the method.
ABOVE, ROUNDING = 10.0, 5e-13
#: Step and number of steps of the long runs.
H, LONG = 4.0, 1_000_000


def accuracy(method: str, problem: str) -> list[dict]:
    """The error of the end state against the certified one for falling steps, with the order: a row for each step."""
    made, rows = problem_of(problem), []
    for steps in STEPS:
        s = integrate(made, method, h=SPAN / steps, steps=steps, save_every=0)
        found = end_error(made, s, SPAN)
        row = {"split": method in SPLIT, "status": s.status, "h": SPAN / steps}
        row |= {"error": found["global_error"], "uncertainty": found["reference"]["uncertainty"]}
        rows.append(row | {"evaluations": s.counts["gradient"] / steps, "declared": BY_ID[method].order})
    floors = [max(ROUNDING, ABOVE * r["uncertainty"]) for r in rows]
    orders = successive([r["error"] for r in rows], floors)
    return [row | {"order": order} for row, order in zip(rows, orders, strict=True)]


def energy(method: str, problem: str) -> dict:
    """The spread of the energy over a long run (``all``), and over its first tenth (``first``)."""
    s = integrate(problem_of(problem), method, h=H, steps=LONG, save_every=LONG // 10_000)
    values = s.energy()
    about = {"split": method in SPLIT, "status": s.status, "h": H, "steps": LONG}
    return about | {"first": float(np.ptp(values[: len(values) // 10])), "all": float(np.ptp(values))}


def ratio(worse: str, better: str) -> Callable[[pd.DataFrame], pd.Series]:
    """The error of a method over that of another at every step at which both are above round-off, by "problem, h"."""

    def of(rows: pd.DataFrame) -> pd.Series:
        clear = rows[rows["error"] > np.maximum(ROUNDING, ABOVE * rows["uncertainty"])]
        errors = clear.pivot_table(index=["problem", "h"], columns="method", values="error")
        if not {worse, better} <= {*errors}:
            return pd.Series(dtype=float)
        found = (errors[worse] / errors[better]).dropna()
        return found.set_axis([f"{problem}, h = {h:g}" for problem, h in found.index])

    return of


FIRST = "times the spread over the first tenth"
STUDY = Study(
    id="parts",
    place=300,
    question="Around black holes, do explicit splittings of H into many parts do what papers claim?",
    answer="The energy's spread grows at most {bounded} times with splittings through parts, at least {grows} with "
    "rk4; an optimized composition is at least {optimized} times more accurate than Yoshida's.",
    setting=(
        "H is a sum of parts whose exact flows are known: five for Kerr's geodesics, in a time chosen for that, and "
        "four for a charge around a Schwarzschild black hole in a magnetic field.",
        "`abc-2` is Strang's splitting, `abc-yoshida-4` three of its steps, `abc-4` and `abc-6` are optimized "
        "compositions, `abc-processed-6` is processed.",
        f"Long runs: a million steps of h = {H:g}.",
        "Claims: bounded energies, and better than implicit methods of the same order (Wang et al. 2021, Wu et al. "
        "2021); optimized compositions several orders of magnitude better than Yoshida's (Zhou et al. 2022, "
        "arXiv:2201.02922).",
    ),
    runs=(
        Runs(ACCURACY, accuracy, over(method=(*SPLIT, *ORDINARY), problem=PROBLEMS)),
        Runs(ENERGY, energy, over(method=(*SPLIT, *ORDINARY[:2]), problem=PROBLEMS)),
    ),
    claims={
        "bounded": Claim(
            "The energy of explicit splittings through parts stays bounded",
            ENERGY, growth, at_most(2.0), rows="split", unit=FIRST, checked=True,
        ),
        "grows": Claim(
            "The energy of the fourth-order Runge-Kutta method grows",
            ENERGY, growth, at_least(5.0), rows="method == 'rk4'", unit=FIRST, fault=True,
        ),
        "orders": Claim(
            "Splittings through parts converge with the declared order",
            ACCURACY, order_off, at_most(0.3), rows="split", unit="from the declared order", fault=True,
        ),
        "optimized": Claim(
            "An optimized composition is orders of magnitude better than Yoshida's at one step",
            ACCURACY, ratio("abc-yoshida-4", "abc-4"), at_least(100.0), unit="times smaller error",
        ),
        "midpoint": Claim(
            "At one step Strang's splitting is as accurate as the implicit midpoint rule",
            ACCURACY, ratio("implicit-midpoint", "abc-2"), at_least(1.0), unit="times smaller error",
        ),
    },
    figure=(
        Curves(ACCURACY, "h", "error", "step h", "error of the end state", panel="problem", rows="method != 'gauss-4'",
               ticks=True),
    ),
    title="error against step",
    caption=f"Errors at t = {SPAN:g} against the certified states.",
    shown=Shown(
        ACCURACY,
        ("problem", "method", "error", "uncertainty", "order", "evaluations"),
        "At h = 1: the error of the end state with the reference's uncertainty, the order from this step and twice "
        "it, and evaluations a step: flows of a part for splittings through parts, of the whole field for the others.",
        rows="abs(h - 1) < 1e-9",
    ),
    limits=(
        "Of the papers the abstracts were read; orbits and steps are this suite's. Their optimized methods are of "
        "the same class as `abc-4`, not shown to be the same.",
        "A flow of a part costs less than the whole field; times are in the trade.",
        "That a composition costs twice a step of Yoshida's is in the table, not in the ratio.",
    ),
)  # fmt: skip
