"""The report page on options that change the step map: a scheme's parameter lambda, order, energy-preserving method."""

from __future__ import annotations

import pandas as pd

from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import ROWS, Data, Page, Table, of

from . import figures, findings, ladders, lambdas, verdicts

TABLES = (lambdas.ERRORS, lambdas.COSTS, ladders.TABLE)


def line(option: str, scene: str, setting: str, gives: str, costs: str) -> dict:
    """Make a line of the page's table: the best setting of an option on a scene (orbit), its gain and its cost.

    All arguments are texts; ``gives`` is the gain.
    """
    return {"option": option, "scene": scene, "best setting": setting, "gives": gives, "costs": costs}


def times(x: float) -> str:
    """Format a factor as text, such as "1.4 times"."""
    return f"{number(float(x), 2)} times"


def table_or_none(data: Data, name: str) -> pd.DataFrame | None:
    """Return a table of ``data`` (name -> table); None if it is missing or empty."""
    found = data(name)
    return None if found is None or found.empty else found


def _lambdas(errors: pd.DataFrame, costs: pd.DataFrame | None) -> list[dict]:
    out = []
    for _, r in verdicts.coarse(errors).iterrows():
        gives = f"error {number(r['least'], 2)}, at λ = 1/2 {times(r['gain'])} that"
        out.append(line(f"λ of {r['method']}", r["scene"], number(r["best"], 2), gives, _dearer(r, costs)))
    return out


def _dearer(row: pd.Series, costs: pd.DataFrame | None) -> str:
    """Write, as text, the ratio of the gradients of a step at a scheme's best parameter lambda to those at 1/2.

    ``row`` is a row of `findings.best_lambdas`: an orbit, a scheme and its best lambda.  ``costs``, the table of costs
    of `lambdas`, has the gradients a step; the lambda nearest to the best one is read.  "" if ``costs`` is None or has
    no row at 1/2.
    """
    if costs is None:
        return ""
    part = costs[(costs["scene"] == row["scene"]) & (costs["method"] == row["method"])]
    half = part[part["lam"] == findings.HALF]
    if half.empty:
        return ""
    near = part.loc[(part["lam"] - row["best"]).abs().idxmin()]
    return f"{times(near['gradients per step'] / half['gradients per step'].iloc[0])} the gradients"


def _ladders(rungs: pd.DataFrame) -> list[dict]:
    out = []
    for option in (ladders.COMPOSITION, ladders.GENERATING, ladders.ENERGY):
        found = findings.cheapest(rungs, option)
        for scene, part in found.groupby("scene", sort=False) if len(found) else ():
            last = part.iloc[-1]
            gives = f"error {findings.power(last['error'])} in {number(last['us'])} µs"
            others = len(last["costs"]) - 1
            dearest = (
                f"the slowest takes {times(last['dearest / cheapest'])} as long" if others else "no other gets there"
            )
            out.append(line(option, scene, last["setting"], gives, dearest))
    return out


def answer(data: Data) -> str | None:
    """Write the page's answer: how often the parameter lambda = 1/2 is best, and which settings are the fastest.

    The settings are those of compositions and of energy-preserving methods, at the smallest error that is reached.
    ``data`` maps a table's name to the table; None if none was measured.
    """
    errors, rungs = (table_or_none(data, name) for name in (lambdas.ERRORS, ladders.TABLE))
    parts = []
    if errors is not None and len(found := verdicts.coarse(errors)):
        held = int(found["half is best"].sum())
        parts.append(f"Schemes I and III err least at λ = 1/2 in {held} of {len(found)} cases")
    if rungs is not None and len(found := findings.cheapest(rungs, ladders.COMPOSITION)):
        error = found["error"].min()
        parts.append(f"compositions of order {_best(found)} reach an error of {findings.power(error)} fastest")
    if rungs is not None and len(found := findings.cheapest(rungs, ladders.ENERGY)):
        parts.append(f"among energy-preserving methods {_best(found)} does")
    return f"{'; '.join(parts)}." if parts else None


def _best(found: pd.DataFrame) -> str:
    """Write the names of the fastest settings at the smallest error that is reached on any scene (orbit).

    ``found`` is the result of `findings.cheapest`.
    """
    return " or ".join(found[found["error"] == found["error"].min()]["setting"].unique())


def table(data: Data) -> Table | None:
    """Make the page's table: for each option and scene (orbit) the best setting, its gain and its cost.

    ``data`` maps a table's name to the table; None if none was measured.
    """
    errors, costs, rungs = (table_or_none(data, name) for name in TABLES)
    rows = [] if errors is None else _lambdas(errors, costs)
    rows += [] if rungs is None else _ladders(rungs)
    caption = (
        "The best setting of each option on each scene. λ: the one of the smallest trajectory error, and its gradients a "
        "step over those at 1/2. The others: the fastest at the smallest error reached of "
        f"{findings.power(findings.ERRORS[0])} to {findings.power(findings.ERRORS[-1])}, and how long the slowest takes there."
    )
    return Table(pd.DataFrame(rows[:ROWS]), caption) if rows else None


@of(ladders.TABLE)
def full_table(rungs: pd.DataFrame) -> pd.DataFrame | None:
    """Make the page's longer table: for each option and scene (orbit), the fastest setting at every error.

    ``rungs`` is the table of the module `ladders`.
    """
    out = pd.concat([findings.cheapest(rungs, option).assign(option=option) for option in ladders.SETTINGS])
    if out.empty:
        return None
    return out.assign(ties=out["ties"].map(", ".join))[
        ["option", "scene", "error", "setting", "ties", "us", "dearest / cheapest"]
    ]


PAGE = Page(
    id="options",
    question="Which λ, which order and which energy-preserving method are best?",
    tables=TABLES,
    setting=(
        "Scheme I takes the step (q, p) + h J⁻¹∇H(q + (1 − λ)Δq, p + λΔp); Scheme III composes it with its adjoint; a "
        "composition of III has order 4.",
        f"λ runs from {lambdas.LOW} to {lambdas.HIGH} at fixed h, on {', '.join(s.problem for s in lambdas.SCENES)}; the error is "
        "the largest of the trajectory against a certified solution.",
        "Compositions of Störmer–Verlet have order 2 to 10; generating functions are expanded to the power r of h, at λ = "
        "1/3 and at 1/2, where an odd r gives order r + 1.",
        "Energy-preserving: Schemes IV and V with compositions, projection, relaxation. Orders and energy-preserving methods "
        "run a ladder of steps; the error is that of the end, the times are taken in turns.",
    ),
    verdicts=(
        verdicts.half_is_best,
        verdicts.half_is_longest,
        verdicts.order_rises,
        verdicts.higher_r_pays,
        verdicts.schemes_pay,
    ),
    answer=answer,
    figures=figures.draw,
    table=table,
    whole=full_table,
    limits=(
        f"λ = 1/2 counts as best where its error is at most {findings.SAME:g} times the smallest; λ is on a grid of "
        f"1/{lambdas.PARTS_OF_ONE}, its steps and gradients on one of 1/{lambdas.COARSE}.",
        "The best λ is that of one orbit, time span and step: at another, errors of opposite sign cancel elsewhere.",
        f"A step counts as possible if it, and every shorter one tried, keeps the energy error below the size of H's terms "
        f"for {lambdas.SURVIVED} steps.",
        "Times are this machine's, medians of rounds taken in turns; a setting whose interval overlaps the cheapest's is tied "
        "with it.",
        f"A run of an energy-preserving method counts only if its relative energy error is at most {findings.KEPT:g} and every "
        "step had a solution.",
    ),
    command="pytest benchmarks/experiments/options",
)
