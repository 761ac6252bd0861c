"""The knobs: the page."""

from __future__ import annotations

import pandas as pd

from phasebench.benchmarks.experiments.knobs import (
    arithmetic,
    figures,
    findings,
    ladders,
    lambdas,
    nodes,
    solvers,
    verdicts,
)
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import ROWS, Page, Table

TABLES = (
    lambdas.ERRORS,
    lambdas.COSTS,
    ladders.TABLE,
    nodes.TABLE,
    arithmetic.ERRORS,
    arithmetic.COSTS,
    solvers.TABLE,
)
#: The composition's lambda is in the table of all rows.
SHOWN = ("scheme-i", "scheme-iii")


def _line(knob: str, scene: str, setting: str, gives: str, costs: str) -> dict:
    return {"knob": knob, "scene": scene, "best setting": setting, "gives": gives, "costs": costs}


def _times(x: float) -> str:
    return f"{number(float(x), 2)} x"


def _lambdas(errors: pd.DataFrame, costs: pd.DataFrame | None) -> list[dict]:
    found = findings.best_lambdas(errors)
    found = found[(found["finer"] == found["finer"].min()) & found["method"].isin(SHOWN)] if len(found) else found
    out = []
    for _, r in found.iterrows():
        gives = f"error {number(r['least'], 2)}, at 1/2 {_times(r['gain'])}"
        out.append(_line(f"λ of {r['method']}", r["scene"], number(r["best"], 2), gives, _dearer(r, costs)))
    return out


def _dearer(row, costs: pd.DataFrame | None) -> str:
    """The gradients of a step at the lambda measured that is nearest to the best one, over those at 1/2."""
    if costs is None:
        return ""
    part = costs[(costs["scene"] == row["scene"]) & (costs["method"] == row["method"])]
    half = part[part["lam"] == findings.HALF]
    if half.empty:
        return ""
    near = part.loc[(part["lam"] - row["best"]).abs().idxmin()]
    return _times(near["gradients per step"] / half["gradients per step"].iloc[0])


def _ladders(rungs: pd.DataFrame) -> list[dict]:
    out = []
    for knob in (ladders.COMPOSITION, ladders.GENERATING, ladders.ENERGY):
        found = findings.cheapest(rungs, knob)
        for scene, part in found.groupby("scene", sort=False) if len(found) else ():
            last = part.iloc[-1]
            gives = f"error {findings.power(last['error'])} in {number(last['us'])} µs"
            others = len(last["costs"]) - 1
            dearest = f"the dearest {_times(last['dearest / cheapest'])}" if others else "no other gets there"
            out.append(_line(knob, scene, last["setting"], gives, dearest))
    return out


def _nodes(table: pd.DataFrame) -> list[dict]:
    found = findings.quadratures(table).drop_duplicates("scene") if len(table) else table
    return [
        _line(
            "nodes of AVF",
            r["scene"],
            f"{r['nodes']} at h = {number(r['h'])}",
            f"energy {number(r['energy error'], 2)}, with one {number(r['with one'], 2)}",
            f"{_times(r['cost'])} one node",
        )
        for _, r in found.iterrows()
    ]


def _sums(table: pd.DataFrame, costs: pd.DataFrame | None) -> list[dict]:
    times = {} if costs is None else dict(zip(costs["scene"], costs["ratio"], strict=True))
    return [
        _line(
            "sums",
            r["scene"],
            "compensated",
            f"round-off {number(r['compensated'], 2)}, plain {_times(r['gain'])}",
            f"{_times(times[r['scene']])} plain C" if r["scene"] in times else "",
        )
        for _, r in findings.sums(table).iterrows()
    ]


def _solvers(table: pd.DataFrame) -> list[dict]:
    """The two cases where the engine is the nearest to the fewest evaluations, and the farthest from it."""
    found = findings.solving(table)
    if found.empty:
        return []
    ends = found.loc[list(dict.fromkeys([found["engine"].idxmin(), found["engine"].idxmax()]))]
    return [
        _line(
            "solver",
            r["scene"],
            f"{r['solver']}, from {r['start']}, at h = {number(r['h'])}",
            f"{number(r['fewest'], 3)} evaluations a step",
            f"the engine {_times(r['engine'])}",
        )
        for _, r in ends.iterrows()
    ]


def summary(data) -> pd.DataFrame:
    """A row for each knob and scene."""
    tables = {name: data(name) for name in TABLES}
    read = {name: None if t is None or t.empty else t for name, t in tables.items()}
    rows = []
    if read[lambdas.ERRORS] is not None:
        rows += _lambdas(read[lambdas.ERRORS], read[lambdas.COSTS])
    if read[ladders.TABLE] is not None:
        rows += _ladders(read[ladders.TABLE])
    if read[nodes.TABLE] is not None:
        rows += _nodes(read[nodes.TABLE])
    if read[arithmetic.ERRORS] is not None:
        rows += _sums(read[arithmetic.ERRORS], read[arithmetic.COSTS])
    if read[solvers.TABLE] is not None:
        rows += _solvers(read[solvers.TABLE])
    return pd.DataFrame(rows)


def table(data) -> Table | None:
    """What turning each knob gives, and costs."""
    rows = summary(data)
    caption = (
        "The best setting of each knob on each scene: of λ that of the least trajectory error (costs: gradients of a step "
        f"over those at 1/2); of a ladder the cheapest at the smallest error reached of {findings.power(findings.ERRORS[0])} to "
        f"{findings.power(findings.ERRORS[-1])}; the fewest nodes whose energy error is at most {findings.FLOOR:g}; the sums; "
        "of the solver the two cases where the engine is nearest to the fewest evaluations, and farthest."
    )
    return None if rows.empty else Table(rows.head(ROWS), caption)


def whole(data) -> pd.DataFrame | None:
    """The cheapest setting at every error."""
    rungs = data(ladders.TABLE)
    if rungs is None or rungs.empty:
        return None
    found = [findings.cheapest(rungs, knob).assign(knob=knob) for knob in ladders.SETTINGS]
    out = pd.concat(found)
    if out.empty:
        return None
    return out.assign(ties=out["ties"].map(", ".join))[
        ["knob", "scene", "error", "setting", "ties", "us", "dearest / cheapest"]
    ]


PAGE = Page(
    id="knobs",
    question="What does turning a knob of a method give, and cost?",
    tables=TABLES,
    setting=(
        f"λ from {lambdas.LOW} to {lambdas.HIGH} at fixed h, Schemes I and III and a composition of III, an ensemble of orbits of which "
        f"each has its own λ: {', '.join(s.problem for s in lambdas.SCENES)}.",
        "Composition order 2 to 10 of Stormer-Verlet; the order r of a generating function, at λ = 1/3 and 1/2; methods that keep "
        "the energy: a ladder of steps each, error of the end state against a certified one, times in turns.",
        "AVF (the mean of the gradient over a step) by Gauss-Legendre rules of a fixed number of nodes, and by the rule that confirms itself.",
        f"Stormer-Verlet from {arithmetic.STARTS} starts by plain sums in single and in double, and compensated, against the same map in long double.",
        f"The engine's solver has no public knob (fixed point from five steps, Newton where that does not contract, to "
        f"round-off); a plain loop solves {solvers.METHOD} by either, from three starts, to several tolerances, and counts.",
    ),
    verdicts=(verdicts.best_lambda, verdicts.cheapest_settings, verdicts.round_off),
    figures=figures.draw,
    table=table,
    whole=whole,
    limits=(
        f"Errors within a factor SAME = {findings.SAME:g} are called the same; λ is on a grid of 1/{lambdas.PARTS_OF_ONE}, its costs on "
        f"one of 1/{lambdas.COARSE}. The best λ is that of one orbit, span and h, where errors of several signs cancel.",
        f"A step survives that keeps the energy error below the size of H's terms for {lambdas.SURVIVED} steps, and so do all shorter ones tried.",
        "Times are the machine's own, medians of rounds taken in turns; a setting whose interval overlaps the cheapest's is tied with it.",
        f"Of the methods that keep the energy only runs count whose energy error is at most KEPT = {findings.KEPT:g} and that had no fallback.",
        f"The confirmed rule is expected to take at most DEAR = {verdicts.DEAR:g} times as long as the fewest nodes that do; which "
        "these are is not known before. Times of a rule include keeping every step.",
        "The loop's fixed point is of the equations as they stand, the engine's of q'' = g(q) where H is separated, which "
        "contracts twice as fast; a Jacobian counts as many evaluations as variables, the linear algebra not at all.",
        "The C loop is bare: what a step takes beyond it is not the compensation alone. Single precision is run in NumPy, without a time.",
    ),
    command="pytest benchmarks/experiments/knobs",
)
