"""The matrix: every method on every problem, what was measured beside what is declared."""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks.page import style
from phasebench.benchmarks.page.markdown import listed
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, Verdict, of, once

from . import matrix

#: What a cell is -> (its colour, its letter for readers without colours)
KINDS = {
    "cannot run": "#ffffff",
    "as declared": "#cfe3f2",
    "order above": style.GREEN,
    "explained": style.ORANGE,
    "contradicted": style.BLACK,
}


@once
def _cells(frame: pd.DataFrame) -> list[dict]:
    rows = frame.astype(object).where(frame.notna(), None).to_dict("records")
    return [{"reason": None} | r for r in rows]


@once
def _shortfalls(frame: pd.DataFrame) -> list[tuple[dict, str, str]]:
    """(cell, contradiction, explanation or "") of every cell that falls short of its method's declaration."""
    return [
        (r, c, matrix.explanation(r, c)) for r in _cells(frame) if not r["reason"] for c in matrix.contradictions(r)
    ]


@once
def _higher(frame: pd.DataFrame) -> list[dict]:
    return [
        r
        for r in _cells(frame)
        if not r["reason"] and r.get("order") is not None and r["order"] > r["declared_order"] + matrix.GATE
    ]


@of("matrix")
def declared(frame: pd.DataFrame) -> Verdict:
    """Whether every cell is as declared, or explained."""
    short = _shortfalls(frame)
    open_ = [f"{r['method']} on {r['problem']}: {c}" for r, c, why in short if not why]
    counts = f"{len(short)} cells fall short of their declaration"
    said = f"{counts}, {len(short) - len(open_)} of them for a known reason (in the table)"
    return Verdict(
        f"{said}" + (f"; not so {listed(open_, 3)}." if open_ else "."),
        not open_,
        f"{len(open_) or 'None'} of {len(frame)} pairs contradicts its declaration without a known reason.",
    )


@of("matrix")
def complete(frame: pd.DataFrame) -> Verdict:
    """Whether a pair is missing."""
    methods, problems = frame["method"].nunique(), frame["problem"].nunique()
    missing = methods * problems - len(frame.drop_duplicates(["method", "problem"]))
    cannot = sum(bool(r["reason"]) for r in _cells(frame))
    return Verdict(
        f"{methods} methods on {problems} problems: {len(frame) - cannot} pairs run, in {cannot} the problem lacks what "
        f"the method requires, {missing or 'none'} {'are' if missing > 1 else 'is'} missing.",
        missing == 0,
        f"{missing} pairs are missing.",
    )


@of("matrix")
def superconvergent(frame: pd.DataFrame) -> Verdict | None:
    """Where the order is higher than declared."""
    higher = _higher(frame)
    if not higher:
        return None
    problems = pd.Series([r["problem"] for r in higher]).value_counts()
    where = listed([f"{name} {n}" for name, n in problems.items()], 5)
    text = f"On {len(higher)} pairs the order is higher than declared, where leading terms vanish: {where}."
    return Verdict(text, True, text)


@of("matrix")
def draw(frame: pd.DataFrame, folder) -> list[Picture]:
    """What every pair is, as a map: a line for each problem, a column for each method."""
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    frame = frame.sort_values(["declared_order"], kind="stable")
    methods, problems = list(dict.fromkeys(frame["method"])), list(dict.fromkeys(frame["problem"]))
    kinds = list(KINDS)
    seen = np.zeros((len(problems), len(methods)))

    def put(r, kind):
        seen[problems.index(r["problem"]), methods.index(r["method"])] = kinds.index(kind)

    for r in _cells(frame):
        if not r["reason"]:
            put(r, "as declared")
    for r in _higher(frame):
        put(r, "order above")
    for r, _, why in _shortfalls(frame):
        put(r, "explained" if why else "contradicted")
    orders = frame.drop_duplicates("method")["declared_order"].to_numpy()
    first = np.flatnonzero(np.diff(orders, prepend=-1))
    last = np.append(first[1:], len(orders))
    with style.settings():
        figure, ((axes,),) = style.panels(1, 1, 3.9)
        colours = ListedColormap(list(KINDS.values()))
        axes.pcolormesh(seen, cmap=colours, vmin=0, vmax=len(kinds) - 1)
        axes.hlines(np.arange(len(problems)), 0, len(methods), color="white", linewidth=1.2)
        axes.set_yticks(np.arange(len(problems)) + 0.5, problems)
        axes.invert_yaxis()
        for x in first[1:]:
            axes.axvline(x, color="0.35", linewidth=0.7)
        wide = [(a, b) for a, b in zip(first, last, strict=True) if b - a > 2]
        axes.set_xticks([(a + b) / 2 for a, b in wide], [str(orders[a]) for a, _ in wide])
        axes.tick_params(length=0)
        axes.set_xlabel(f"{len(methods)} methods, by declared order")
        patches = [Patch(facecolor=c, edgecolor="0.6", linewidth=0.5, label=k) for k, c in KINDS.items()]
        figure.legend(handles=patches, loc="outside upper center", ncols=len(kinds))
    caption = (
        "Every method (columns, by declared order) on every problem (rows): as declared in order, symplecticity, "
        "reversibility, energy and quadratic invariants; of higher order; short of it with a known reason; contradicted."
    )
    return [Picture(style.save(figure, folder, "matrix.png"), "every method on every problem", caption)]


def _grouped(exceptions: list[tuple[str, str, str, str]]) -> list[dict]:
    """Exceptions (method, problem, measured, why), one line for each method and reason; the first measured is shown."""
    lines: dict[tuple[str, str, str], list[tuple[str, str]]] = {}
    for method, name, measured, why in exceptions:
        lines.setdefault((method, measured.split()[0], why), []).append((name, measured))
    return [
        {"method": method, "problems": listed([n for n, _ in cells], 4), "measured": cells[0][1], "why": why}
        for (method, _, why), cells in lines.items()
    ]


@of("matrix")
def table(frame: pd.DataFrame) -> Table | None:
    """The exceptions: cells that fall short, then orders above the declared ones."""
    short = sorted(_shortfalls(frame), key=lambda x: bool(x[2]))
    lines = _grouped([(r["method"], r["problem"], c, why or "NOT EXPLAINED") for r, c, why in short])
    above = sorted(_higher(frame), key=lambda r: r["declared_order"] - r["order"])
    lines += _grouped(
        [
            (r["method"], r["problem"], f"order {r['order']:.2f}, declared {r['declared_order']}", "more than declared")
            for r in above
        ]
    )
    if not lines:
        return None
    caption = f"The {len(short)} cells that fall short, then the {len(above)} orders above the declared ones; "
    caption += "`measured` is that of the first problem named."
    return Table(pd.DataFrame(lines[:ROWS]), caption)


@of("matrix")
def _whole(frame: pd.DataFrame) -> pd.DataFrame:
    """The cells that were run, without what is the same in all."""
    ran = frame[frame["reason"].isna()] if "reason" in frame else frame
    columns = ["method", "problem", "declared_order", "order", "symplecticity", "reversibility", "energy"]
    small = ran[ran["problem"].isin(["henon-heiles", "kepler", "pendulum", "outer-solar-system", "lotka-volterra"])]
    return small.reindex(columns=columns).rename(columns={"declared_order": "declared"})


PAGE = Page(
    id="matrix",
    question="Is every method, on every problem, what its record declares?",
    tables=("matrix",),
    setting=(
        "Order, symplecticity |ω(Mu, Mv) − ω(u, v)| and reversibility |ρΦₕρΦₕ(y) − y|: in MPFR's numbers, no round-off.",
        f"Energy and the invariants q·Dp: the largest error over {matrix.RUN} steps in doubles, in units of H's terms.",
        "From a state that the published orbit reaches a little later: a turning point superconverges.",
        f"Systems of more than {matrix.LARGEST} degrees of freedom are measured in doubles alone; lattices have four points.",
    ),
    verdicts=(declared, complete, superconvergent),
    figures=draw,
    table=table,
    whole=_whole,
    limits=(
        f"An order counts as above or below the declared one from {matrix.GATE} on, over {len(matrix.LADDER)} step sizes; a "
        f"method is exact within {matrix.EXACT:g} units of round-off and {matrix.DOUBTS} times the reference's uncertainty.",
        f"A defect of at most {matrix.NOTHING:g} is the differences' own; energy errors up to "
        f"{matrix.UNITS_OF_ROUND_OFF} units are round-off.",
        f"{matrix.RUN} steps show no slow drift: that is the page on invariants.",
    ),
    command="pytest benchmarks/experiments/matrix",
)
