"""Options that change how a step is computed: quadrature nodes, stage solvers, sums, precision."""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import ROWS, Table, of
from phasebench.benchmarks.page.shared import picture, together, worst
from phasebench.benchmarks.page.study import Claim, Runs, Study, over
from phasebench.benchmarks.page.verdict import at_least, at_most
from phasebench.benchmarks.store.cells import ALONE, ProblemKey, states
from phasebench.integrators.driver import OK
from phasebench.integrators.registry import BY_ID

from . import arithmetic, nodes, solvers
from .arithmetic import ARITHMETICS, COMPENSATED, PLAIN, SINGLE
from .step_map import SAME, plot, times

#: Relative energy error up to which the energy counts as kept; largest time of AVF's own rule over the fewest nodes'.
FLOOR, DEAR = 1e-13, 2.0
CASE = "{scene}, h = {h:g}"


@of(nodes.TABLE)
def quadratures(rows: pd.DataFrame) -> pd.DataFrame:
    """The fewest nodes with which AVF keeps H at each orbit and step, beside one node and AVF's own choice."""
    out = []
    for (scene, h), part in rows[rows["status"] == OK].groupby(["scene", "h"], sort=False):
        by = part.drop_duplicates("nodes").sort_values("nodes").set_index("nodes")
        kept = by[(by["energy error"] <= FLOOR) & (by.index != nodes.CONFIRMED)]
        if len(kept) and {1, nodes.CONFIRMED} <= {*by.index}:
            few, cost, one = kept.iloc[0], by["ns per step"], by.loc[1]
            row = {"scene": scene, "h": h, "nodes": int(kept.index[0]), "energy error": few["energy error"]}
            row |= {"with one": one["energy error"], "cost": few["ns per step"] / one["ns per step"]}
            out.append(row | {"confirmed / fewest": cost[nodes.CONFIRMED] / few["ns per step"]})
    return pd.DataFrame(out)


@of(solvers.TABLE)
def solving(rows: pd.DataFrame) -> pd.DataFrame:
    """The loop's setting of the fewest evaluations at each orbit and step, and the engine's over it (``engine``).

    ``fixed`` and ``simplified`` are evaluations from the best start, NaN without convergence.
    """
    out = []
    for (scene, h), part in rows[rows["status"] == OK].groupby(["scene", "h"], sort=False):
        own, loop = part[part["solver"] == solvers.ENGINE], part[part["solver"] != solvers.ENGINE]
        exact = loop[loop["tol"] == solvers.ROUND_OFF]
        if len(exact) and len(own):
            best, fewest = exact.loc[exact["evaluations"].idxmin()], exact.groupby("solver")["evaluations"].min()
            row = {"scene": scene, "h": h, "solver": best["solver"], "start": best["start"]}
            row |= {"fewest": best["evaluations"], "engine": own.iloc[0]["evaluations"] / best["evaluations"]}
            row |= {"fixed": fewest.get(solvers.FIXED, np.nan), "simplified": fewest.get(solvers.SIMPLE, np.nan)}
            out.append(row | _loosest(loop))
    return pd.DataFrame(out)


def _loosest(loop: pd.DataFrame) -> dict[str, float]:
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


@of(arithmetic.ERRORS)
def sums(rows: pd.DataFrame) -> pd.DataFrame:
    """Round-off after the most steps, plain over compensated (``gain``), and errors in single and double, by orbit."""
    last = rows[rows["steps"] == rows["steps"].max()]
    off, error = (_by_arithmetic(last, ["scene"], column) for column in ("round-off rms", "error"))
    single = rows[rows["arithmetic"] == SINGLE].groupby("scene")["error"].min()
    found = {"gain": off[PLAIN] / off[COMPENSATED], "compensated": off[COMPENSATED], "single": single}
    found = pd.DataFrame(found | {"double": error[COMPENSATED]}).reindex(rows["scene"].unique())
    return found.dropna().rename_axis("scene").reset_index()


def _by_arithmetic(rows: pd.DataFrame, index: list[str], column: str) -> pd.DataFrame:
    return rows.pivot_table(index=index, columns="arithmetic", values=column).reindex(columns=ARITHMETICS)


def newton(rows: pd.DataFrame) -> pd.Series:
    """True where Newton's method ends where the engine does, with the same error to a percent."""
    own = rows[rows["solver"] == solvers.ENGINE].set_index(["scene", "h"])["error"]
    rows = rows[rows["solver"] == solvers.NEWTON].join(own.rename("own"), on=["scene", "h"])
    return (rows["status"] == OK) & ((rows["error"] / rows["own"] - 1).abs() < 1e-2)


def more_in_single(rows: pd.DataFrame) -> pd.Series:
    """True where single precision has more round-off than double."""
    off = _by_arithmetic(rows, ["scene", "steps"], "round-off rms")
    return off[SINGLE] > off[PLAIN]


@of(quadratures, solving, sums, arithmetic.COSTS)
def _table(rules: pd.DataFrame, stages: pd.DataFrame, ends: pd.DataFrame, costs: pd.DataFrame) -> Table:
    rows = []
    for r in rules.to_dict("records"):
        gives = f"energy error {number(r['energy error'], 2)}, with one {number(r['with one'], 2)}"
        rows.append(("nodes of AVF", CASE.format_map(r), str(r["nodes"]), gives, f"{times(r['cost'])} as long as one"))
    for r in stages.to_dict("records"):
        fixed, simple = (number(r[k]) or "does not converge" for k in ("fixed", "simplified"))
        gives = f"{number(r['fewest'])} evaluations a step: fixed point {fixed}, simplified Newton {simple}"
        looser = f"; a tolerance of {r['loosest']:.0e} saves {100 * r['saved']:.0f} %" if r["saved"] else ""
        dearer = f"its own takes {times(r['engine'])} as many{looser}"
        rows.append(
            (f"solver of {solvers.METHOD}", CASE.format_map(r), f"{r['solver']}, from {r['start']}", gives, dearer)
        )
    ratio = costs.set_index("scene")["ratio"]
    for r in ends.to_dict("records"):
        gives = f"round-off {number(r['compensated'], 2)}, plain {times(r['gain'])} that"
        dearer = f"{times(ratio[r['scene']])} as long as plain C" if r["scene"] in ratio else ""
        rows.append(("sums", r["scene"], "compensated", gives, dearer))
    caption = (
        f"Nodes: the fewest whose relative energy error is at most {FLOOR:g}. Solver: the one of the fewest "
        "evaluations among the loops, what the method's own takes over it, and the loosest tolerance that leaves the "
        "error as it is. Sums: round-off after the most steps."
    )
    return Table(pd.DataFrame(rows[:ROWS], columns=["option", "scene", "best setting", "gives", "costs"]), caption)


@picture(
    (nodes.TABLE, arithmetic.ERRORS), "options-floors", "nodes, sums and precision",
    "Left: AVF's energy error over the nodes of its quadrature. Right: the round-off of Störmer–Verlet, as distance "
    "from the same steps in long double.",
)  # fmt: skip
def _draw_floors(rules: pd.DataFrame, ends: pd.DataFrame) -> style.Figure:
    figure, ((left, right),) = style.panels(1, 2, 3.9)
    fixed = rules[rules["nodes"] != nodes.CONFIRMED]
    plot(left, fixed, ["scene", "h"], "nodes", "energy error", "{scene}, h = {h:g}")
    left.set(xlabel="nodes", ylabel="largest relative energy error", title="AVF", yscale="log")
    plot(right, ends, ["scene", "arithmetic"], "steps", "round-off rms", "{scene}, {arithmetic}")
    right.set(xlabel="steps", ylabel="rms round-off at the end", title=arithmetic.METHOD, xscale="log", yscale="log")
    for axes in (left, right):
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.12), ncols=1, handlelength=3.0)
    return figure


@picture(
    solvers.TABLE, "options-solvers", "solving to a tolerance",
    f"Error of {solvers.METHOD} against evaluations, its equations solved to tolerances from "
    f"{max(solvers.TOLERANCES):g} to round-off: where a curve is level, a looser tolerance loses nothing.",
)  # fmt: skip
def _draw_solvers(stages: pd.DataFrame) -> style.Figure | None:
    shown = stages[(stages["status"] == OK) & (stages["start"] == solvers.FIVE) & (stages["solver"] != solvers.NEWTON)]
    if shown.empty:
        return None
    figure, (panels,) = style.panels(1, shown["scene"].nunique(), 3.9, sharey=True)
    for axes, (scene, part) in zip(panels, shown.groupby("scene", sort=False), strict=True):
        part = part[part["h"] == part["h"].min()].replace({"solver": {solvers.ENGINE: "the integrator's own"}})
        plot(axes, part, ["solver"], "evaluations", "error", "{solver}")
        axes.set(xlabel="evaluations a step", title=scene, yscale="log")
    panels[0].set_ylabel("error at the end")
    style.legend_above(figure, panels[0], 3)
    return figure


def _needs(scene: str) -> tuple:
    made = ProblemKey(scene)
    return BY_ID[arithmetic.METHOD], made, states(made.id)


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
        Runs(nodes.TABLE, nodes.nodes, over(scene=tuple(nodes.SCENES)), where=ALONE, own=True,
             needs=lambda scene: (nodes.SCENES[scene], BY_ID[nodes.METHOD], ProblemKey(scene))),
        Runs(solvers.TABLE, solvers.solvers, over(scene=tuple(solvers.SCENES)), needs=lambda scene: (
             solvers.SCENES[scene], BY_ID[solvers.METHOD], BY_ID[solvers.FINE], ProblemKey(scene))),
        Runs(arithmetic.ERRORS, arithmetic.round_off, over(scene=arithmetic.SCENES), needs=_needs),
        Runs(arithmetic.COSTS, arithmetic.costs, over(scene=arithmetic.SCENES), needs=_needs, where=ALONE, own=True),
    ),
    claims={
        "keeps": Claim(
            "AVF's quadrature, which chooses its nodes by itself, keeps the energy",
            nodes.TABLE, "`energy error`", at_most(FLOOR), rows=f"nodes == {nodes.CONFIRMED}",
            unit="of the energy's terms", where=CASE, fault=True,
        ),
        "pays": Claim(
            "It takes little longer than the fewest nodes that keep the energy",
            quadratures, "`confirmed / fewest`", at_most(DEAR), unit="times as long", span=True, where=CASE,
        ),
        "solver": Claim(
            "The stage equations are solved in the fewest evaluations",
            solving, "engine", at_most(SAME), unit="times those of the best solver tried", span=True,
            where=CASE,
        ),
        "sums": Claim(
            "Compensated sums leave less round-off than plain ones",
            sums, "gain > 1", unit="scenes", where=worst("-gain", "{scene}: {gain:.2g} times less"), fault=True,
        ),
        "single": Claim(
            "Double precision reaches smaller errors than single precision",
            sums, "single > double", unit="scenes",
            where=worst("single", "{scene}: single precision ends at {single:.2g}"),
        ),
    },
    numbers={
        "gains": Claim("gain", sums, "gain", at_least(1), span=True),
        "nodes": Claim("nodes", quadratures, "nodes", at_least(2), span=True),
    },
    checks={
        "solved": Claim("Every step of AVF is solved", nodes.TABLE, "status == 'ok'", where="{scene}, {nodes} nodes"),
        "single": Claim("Single precision has more round-off", arithmetic.ERRORS, more_in_single),
        "ratio": Claim("Sums take a time", arithmetic.COSTS, "ratio > 0", where="{scene}"),
        "newton": Claim("Newton's method ends where the engine does", solvers.TABLE, newton, where="{scene}, h = {h}"),
    },
    figure=together(_draw_floors, _draw_solvers),
    shown=_table,
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
