"""Options that change how a step is computed: quadrature nodes, stage solvers, sums, precision."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import ROWS, Picture, Table, of
from phasebench.benchmarks.page.study import Claim, Runs, Study, over
from phasebench.benchmarks.page.verdict import EVERY, at_least, at_most
from phasebench.benchmarks.store.cells import ALONE
from phasebench.integrators.driver import OK

from . import arithmetic, nodes, solvers
from .step_map import SAME, plot, times

#: Relative energy error up to which the energy counts as kept; largest time of AVF's own rule over the fewest nodes'.
FLOOR, DEAR = 1e-13, 2.0


def quadratures(rows: pd.DataFrame) -> pd.DataFrame:
    """The fewest nodes with which AVF keeps H, by "orbit, step", beside one node and AVF's own choice."""
    out = []
    for (scene, h), part in rows[rows["status"] == OK].groupby(["scene", "h"], sort=False):
        by = part.drop_duplicates("nodes").sort_values("nodes").set_index("nodes")
        fixed = by.drop(index=nodes.CONFIRMED, errors="ignore")
        kept = fixed[fixed["energy error"] <= FLOOR]
        if kept.empty or not {1, nodes.CONFIRMED} <= {*by.index}:
            continue
        few, own, one = kept.iloc[0], by.loc[nodes.CONFIRMED], by.loc[1]
        row = {"scene": scene, "h": h, "nodes": int(kept.index[0]), "energy error": few["energy error"]}
        row |= {"with one": one["energy error"], "cost": few["ns per step"] / one["ns per step"]}
        out.append(row | {"confirmed / fewest": own["ns per step"] / few["ns per step"]})
    return by_case(out)


def by_case(rows: list[dict]) -> pd.DataFrame:
    """The rows by "orbit, step"."""
    return pd.DataFrame(rows, index=[f"{r['scene']}, h = {number(r['h'])}" for r in rows])


def solving(rows: pd.DataFrame) -> pd.DataFrame:
    """The loop's setting of the fewest evaluations, by "orbit, step", with those of the engine (``engine``) over it.

    ``fixed`` and ``simplified`` are evaluations from the best start, NaN without convergence.
    """
    out = []
    for (scene, h), part in rows[rows["status"] == OK].groupby(["scene", "h"], sort=False):
        own, loop = part[part["solver"] == solvers.ENGINE], part[part["solver"] != solvers.ENGINE]
        exact = loop[loop["tol"] == solvers.ROUND_OFF]
        if exact.empty or own.empty:
            continue
        best = exact.loc[exact["evaluations"].idxmin()]
        row = {"scene": scene, "h": h, "solver": best["solver"], "start": best["start"], "fewest": best["evaluations"]}
        row["engine"] = own.iloc[0]["evaluations"] / best["evaluations"]
        for name, solver in (("fixed", solvers.FIXED), ("simplified", solvers.SIMPLE)):
            row[name] = exact[exact["solver"] == solver]["evaluations"].min()
        out.append(row | loosest(loop))
    return by_case(out)


def column(found: Callable[[pd.DataFrame], pd.DataFrame], name: str) -> Callable[[pd.DataFrame], pd.Series]:
    """A column of what is found in the rows; empty if nothing is."""
    return lambda rows: found(rows).get(name, pd.Series(dtype=float))


def loosest(loop: pd.DataFrame) -> dict[str, float]:
    """The loosest tolerance that leaves the error unchanged, and the share of the evaluations that it saves."""
    found = {"loosest": np.nan, "saved": 0.0}
    for _, part in loop[loop["start"] == solvers.FIVE].groupby("solver", sort=False):
        exact = part[part["tol"] == solvers.ROUND_OFF]
        if exact.empty:
            continue
        error, most = exact.iloc[0]["error"], exact.iloc[0]["evaluations"]
        same = part[(part["tol"] > 0) & (part["error"] <= SAME * error) & (part["error"] >= error / SAME)]
        if len(same) and not same["tol"].max() <= found["loosest"]:
            last = same.loc[same["tol"].idxmax()]
            found = {"loosest": last["tol"], "saved": 1 - last["evaluations"] / most}
    return found


def sums(rows: pd.DataFrame) -> pd.DataFrame:
    """Round-off after the most steps, plain over compensated (``gain``), and errors in single and double, by orbit."""
    last = rows[rows["steps"] == rows["steps"].max()]
    off, error = (by_arithmetic(last, column, ["scene"]) for column in ("round-off rms", "error"))
    ours, floor = off[arithmetic.COMPENSATED], by_arithmetic(rows, "error", ["scene"], "min")[arithmetic.SINGLE]
    found = {"gain": off[arithmetic.PLAIN] / ours, "compensated": ours, "single": floor}
    found = pd.DataFrame(found | {"double": error[arithmetic.COMPENSATED]})
    return found.reindex(rows["scene"].unique()).dropna()


def by_arithmetic(rows: pd.DataFrame, column: str, index: list[str], of_several: str = "mean") -> pd.DataFrame:
    """A column of the rows with a column for each arithmetic."""
    found = rows.pivot_table(index=index, columns="arithmetic", values=column, aggfunc=of_several)
    return found.reindex(columns=[arithmetic.SINGLE, arithmetic.PLAIN, arithmetic.COMPENSATED])


def least_gain(rows: pd.DataFrame) -> str:
    """The orbit on which compensation gains least."""
    gain = sums(rows)["gain"]
    return f"{gain.idxmin()}: {number(gain.min(), 2)} times less"


def single_floor(rows: pd.DataFrame) -> str:
    """The orbit on which single precision ends at the largest error."""
    floor = sums(rows)["single"]
    return f"{floor.idxmax()}: single precision ends at {number(floor.max(), 2)}"


def newton(rows: pd.DataFrame) -> pd.Series:
    """True where Newton's method ends where the engine does, with the same error to a percent."""
    own = rows[rows["solver"] == solvers.ENGINE].set_index(["scene", "h"])["error"]
    rows = rows[rows["solver"] == solvers.NEWTON].join(own.rename("own"), on=["scene", "h"])
    return (rows["status"] == OK) & ((rows["error"] / rows["own"] - 1).abs() < 1e-2)


def more_in_single(rows: pd.DataFrame) -> pd.Series:
    """True where single precision has more round-off than double."""
    off = by_arithmetic(rows, "round-off rms", ["scene", "steps"])
    return off[arithmetic.SINGLE] > off[arithmetic.PLAIN]


# -- what is shown -----------------------------------------------------------------------------------------------------


@of(nodes.TABLE, solvers.TABLE, arithmetic.ERRORS, arithmetic.COSTS)
def table(rules: pd.DataFrame, stages: pd.DataFrame, ends: pd.DataFrame, costs: pd.DataFrame) -> Table:
    """The best setting of each option in each case, its gain and its cost."""
    rows = []
    for case, r in quadratures(rules).iterrows():
        gives = f"energy error {number(r['energy error'], 2)}, with one {number(r['with one'], 2)}"
        rows.append(("nodes of AVF", case, str(r["nodes"]), gives, f"{times(r['cost'])} as long as one"))
    for case, r in solving(stages).iterrows():
        fixed, simple = (number(r[k]) or "does not converge" for k in ("fixed", "simplified"))
        gives = f"{number(r['fewest'])} evaluations a step: fixed point {fixed}, simplified Newton {simple}"
        looser = f"; a tolerance of {r['loosest']:.0e} saves {100 * r['saved']:.0f} %" if r["saved"] else ""
        dearer = f"its own takes {times(r['engine'])} as many{looser}"
        rows.append((f"solver of {solvers.METHOD}", case, f"{r['solver']}, from {r['start']}", gives, dearer))
    ratio = costs.set_index("scene")["ratio"]
    for scene, r in sums(ends).iterrows():
        gives = f"round-off {number(r['compensated'], 2)}, plain {times(r['gain'])} that"
        dearer = f"{times(ratio[scene])} as long as plain C" if scene in ratio else ""
        rows.append(("sums", scene, "compensated", gives, dearer))
    caption = (
        f"Nodes: the fewest whose relative energy error is at most {FLOOR:g}. Solver: the one of the fewest "
        "evaluations among the loops, what the method's own takes over it, and the loosest tolerance that leaves the "
        "error as it is. Sums: round-off after the most steps."
    )
    return Table(pd.DataFrame(rows[:ROWS], columns=["option", "scene", "best setting", "gives", "costs"]), caption)


@of(nodes.TABLE, arithmetic.ERRORS, solvers.TABLE)
@style.styled
def draw(rules: pd.DataFrame, ends: pd.DataFrame, stages: pd.DataFrame, folder: Path) -> list[Picture]:
    """Energy errors over nodes beside round-off over steps; errors over evaluations of each solver."""
    figure, ((left, right),) = style.panels(1, 2, 3.9)
    fixed = rules[rules["nodes"] != nodes.CONFIRMED]
    plot(left, fixed, ["scene", "h"], "nodes", "energy error", "{scene}, h = {h:g}")
    left.set(xlabel="nodes", ylabel="largest relative energy error", title="AVF", yscale="log")
    plot(right, ends, ["scene", "arithmetic"], "steps", "round-off rms", "{scene}, {arithmetic}")
    right.set(xlabel="steps", ylabel="rms round-off at the end", title=arithmetic.METHOD, xscale="log", yscale="log")
    for axes in (left, right):
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.12), ncols=1, handlelength=3.0)
    caption = (
        "Left: AVF's energy error over the nodes of its quadrature. Right: the round-off of Störmer–Verlet, as "
        "distance from the same steps in long double."
    )
    floors = Picture(style.save(figure, folder, "options-floors.png"), "nodes, sums and precision", caption)
    shown = stages[(stages["status"] == OK) & (stages["start"] == solvers.FIVE) & (stages["solver"] != solvers.NEWTON)]
    if shown.empty:
        return [floors]
    figure, (panels,) = style.panels(1, shown["scene"].nunique(), 3.9, sharey=True)
    for axes, (scene, part) in zip(panels, shown.groupby("scene", sort=False), strict=True):
        part = part[part["h"] == part["h"].min()].replace({"solver": {solvers.ENGINE: "the integrator's own"}})
        plot(axes, part, ["solver"], "evaluations", "error", "{solver}")
        axes.set(xlabel="evaluations a step", title=scene, yscale="log")
    panels[0].set_ylabel("error at the end")
    style.legend_above(figure, panels[0], 3)
    caption = (
        f"Error of {solvers.METHOD} against evaluations, its equations solved to tolerances from "
        f"{max(solvers.TOLERANCES):g} to round-off: where a curve is level, a looser tolerance loses nothing."
    )
    return [floors, Picture(style.save(figure, folder, "options-solvers.png"), "solving to a tolerance", caption)]


STUDY = Study(
    id="options-numerics",
    place=70,
    within="options",
    question="What do quadrature nodes, stage solvers, compensated sums and precision give, and cost?",
    answer=f"Compensated sums leave {{gains}} times less round-off; {{nodes}} nodes keep AVF's energy to {FLOOR:g}; "
    f"{solvers.METHOD}'s solver takes {{solver}} times the best other's evaluations.",
    setting=(
        "AVF, the mean of the gradient over a step, by Gauss–Legendre rules of a fixed number of nodes, and by its own "
        "rule, which adds nodes until two results agree.",
        f"{solvers.METHOD}, a Gauss method of {solvers.STAGES} stages, by its own solver (fixed point from the last "
        "five steps, Newton where that does not contract), and by a plain loop of either from three starts, to several "
        "tolerances.",
        f"Störmer–Verlet from {arithmetic.STARTS} starts by plain sums in single and double precision, and by "
        "compensated sums; round-off is the distance from the same steps in long double.",
    ),
    runs=(
        Runs(nodes.TABLE, nodes.nodes, over(scene=tuple(nodes.SCENES)), needs=nodes.needs, where=ALONE, own=True),
        Runs(solvers.TABLE, solvers.solvers, over(scene=tuple(solvers.SCENES)), needs=solvers.needs),
        Runs(arithmetic.ERRORS, arithmetic.round_off, over(scene=arithmetic.SCENES), needs=arithmetic.needs),
        Runs(arithmetic.COSTS, arithmetic.costs, over(scene=arithmetic.SCENES), needs=arithmetic.needs, where=ALONE,
             own=True),
    ),
    claims={
        "keeps": Claim(
            "AVF's quadrature, which chooses its nodes by itself, keeps the energy",
            nodes.TABLE, "`energy error`", at_most(FLOOR), rows=f"nodes == {nodes.CONFIRMED}",
            unit="of the energy's terms", where="{scene}, h = {h:g}", fault=True,
        ),
        "pays": Claim(
            "It takes little longer than the fewest nodes that keep the energy",
            nodes.TABLE, column(quadratures, "confirmed / fewest"), at_most(DEAR), unit="times as long",
            span=True,
        ),
        "solver": Claim(
            "The stage equations are solved in the fewest evaluations",
            solvers.TABLE, column(solving, "engine"), at_most(SAME),
            unit="times those of the best solver tried", span=True,
        ),
        "sums": Claim(
            "Compensated sums leave less round-off than plain ones",
            arithmetic.ERRORS, lambda rows: sums(rows)["gain"] > 1, EVERY, unit="scenes", where=least_gain, fault=True,
        ),
        "single": Claim(
            "Double precision reaches smaller errors than single precision",
            arithmetic.ERRORS, lambda rows: sums(rows)["single"] > sums(rows)["double"], EVERY, unit="scenes",
            where=single_floor,
        ),
    },
    numbers={
        "gains": Claim("gain", arithmetic.ERRORS, column(sums, "gain"), at_least(1), span=True),
        "nodes": Claim("nodes", nodes.TABLE, column(quadratures, "nodes"), at_least(2), span=True),
    },
    checks={
        "solved": Claim("Every step of AVF is solved", nodes.TABLE, "status == 'ok'", where="{scene}, {nodes} nodes"),
        "single": Claim("Single precision has more round-off", arithmetic.ERRORS, more_in_single),
        "ratio": Claim("Sums take a time", arithmetic.COSTS, "ratio > 0", where="{scene}"),
        "newton": Claim("Newton's method ends where the engine does", solvers.TABLE, newton, where="{scene}, h = {h}"),
    },
    figure=draw,
    shown=table,
    limits=(
        "Times are this machine's, medians of rounds taken in turns; those of a quadrature include storing every step.",
        "How many nodes are enough is not known before: AVF's own rule pays for finding out.",
        "The loop solves the equations as they stand, the method's own solver those of q'' = g(q) where H is "
        "separable, which contract twice as fast.",
        "A Jacobian counts as many evaluations as there are variables, the linear algebra as none.",
        "The time of compensated sums is over that of a bare C loop of plain sums, which does nothing else. Single "
        "precision is run in NumPy, without a time.",
    ),
)  # fmt: skip
