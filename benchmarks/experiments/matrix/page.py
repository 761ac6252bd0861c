"""The report page on every method on every problem: measured and declared order, structure and energy behaviour."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.page.markdown import join_list
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, of, once
from phasebench.benchmarks.page.verdict import EVERY, FAIL, NONE, Count, Verdict

from . import matrix

if TYPE_CHECKING:
    from pathlib import Path

#: Kind of a cell -> its colour.
KINDS = {
    "cannot run": "#ffffff",
    "as declared": "#cfe3f2",
    "order above": style.GREEN,
    "explained": style.ORANGE,
    "contradicted": style.BLACK,
    "stopped": style.GREY,
}


@once
def _cells(frame: pd.DataFrame) -> list[dict]:
    rows = frame.astype(object).where(frame.notna(), None).to_dict("records")
    return [{"reason": None} | r for r in rows]


@once
def _shortfalls(frame: pd.DataFrame) -> list[tuple[dict, str, str]]:
    """List (row, contradiction, explanation) for every contradiction with a method's declaration.

    The explanation is "" if none is known.
    """
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


@once
def _stopped(frame: pd.DataFrame) -> list[dict]:
    """List the table's rows whose run stopped, so that its energy was not measured.

    Rows with a measurement that contradicts a declaration of the method are left out.
    """
    short = _short(frame, explained=True)
    cells = [r for r in _cells(frame) if not r["reason"] and r.get("energy_reason")]
    return [r for r in cells if (r["method"], r["problem"]) not in short]


def _ran(frame: pd.DataFrame) -> int:
    """Count the (method, problem) pairs that run; in the others the problem lacks what the method requires."""
    return sum(not r["reason"] for r in _cells(frame))


@of("matrix")
def declarations(frame: pd.DataFrame) -> Verdict:
    """Judge whether every contradiction with a method's declaration has a known reason.

    ``frame`` is the table of measurements, a row for each method and problem.
    """
    open_ = [f"{r['method']} on {r['problem']}: {c}" for r, c, why in _shortfalls(frame) if not why]
    return Verdict(
        "No pair falls short of what its method declares without a known reason",
        Count(len(_short(frame, explained=False)), _ran(frame)),
        NONE,
        "pairs",
        where=join_list(open_, 3) if open_ else "",
        otherwise=FAIL,
    )


def _short(frame: pd.DataFrame, explained: bool) -> set[tuple[str, str]]:
    """Return the (method, problem) pairs with a measurement that contradicts a declaration of the method.

    Without ``explained``, pairs whose contradictions all have a known reason are left out.
    """
    return {(r["method"], r["problem"]) for r, _, why in _shortfalls(frame) if explained or not why}


@of("matrix")
def ended(frame: pd.DataFrame) -> Verdict:
    """Judge whether every run for the energy came to its end; ``frame`` is the table of measurements."""
    stopped = _stopped(frame)
    return Verdict(
        "Every run came to its end",
        Count(_ran(frame) - len(stopped), _ran(frame)),
        EVERY,
        "pairs",
        where=join_list([f"{r['method']} on {r['problem']} ({r['energy_reason']})" for r in stopped], 3),
    )


@of("matrix")
def complete(frame: pd.DataFrame) -> Verdict:
    """Judge whether every method was tried on every problem; ``frame`` is the table of measurements.

    Methods and problems are those of today's registries, so that one without a row is missed.
    """
    tried = set(zip(frame["method"], frame["problem"], strict=True))
    left = [f"{m.id} on {name}" for name in matrix.PROBLEMS for m in matrix.METHODS if (m.id, name) not in tried]
    pairs = len(matrix.METHODS) * len(matrix.PROBLEMS)
    return Verdict(
        "Every method was tried on every problem",
        Count(pairs - len(left), pairs),
        EVERY,
        "pairs",
        where=join_list(left, 3) if left else "",
        otherwise=FAIL,
    )


@of("matrix")
def answer(frame: pd.DataFrame) -> str:
    """Write the page's answer: how many (method, problem) pairs are as declared, and how many others are explained."""
    ran, short, stopped = _ran(frame), len(_short(frame, explained=True)), len(_stopped(frame))
    known = short - len(_short(frame, explained=False))
    return (
        f"{ran - short - stopped} of {ran} pairs of a method and a problem are as the method declares; {short} fall short "
        f"({known} for a known reason); the runs of {stopped} stopped."
    )


@of("matrix")
def draw(frame: pd.DataFrame, folder: Path) -> list[Picture]:
    """Draw a map of all pairs (method, problem), coloured by kind: a line for each problem, a column for each method.

    The kinds, such as "as declared" or "contradicted", are the keys of `KINDS`.
    """
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    frame = frame.sort_values(["declared_order"], kind="stable")
    methods, problems = list(dict.fromkeys(frame["method"])), list(dict.fromkeys(frame["problem"]))
    kinds = list(KINDS)
    seen = np.zeros((len(problems), len(methods)))

    def put(r: dict, kind: str) -> None:
        seen[problems.index(r["problem"]), methods.index(r["method"])] = kinds.index(kind)

    for r in _cells(frame):
        if not r["reason"]:
            put(r, "as declared")
    for r in _higher(frame):
        put(r, "order above")
    for r in _stopped(frame):
        put(r, "stopped")
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
        "reversibility, energy and quadratic invariants; of higher order; short of it for a known reason, or for none; or with a "
        "run that stopped. White: the problem lacks what the method requires."
    )
    return [Picture(style.save(figure, folder, "matrix.png"), "every method on every problem", caption)]


def _group(exceptions: list[tuple[str, str, str, str]]) -> list[dict]:
    """Make table lines of exceptions: one for each method and reason, which names its problems and one measurement.

    Each exception is a tuple (method, problem, measured, why).
    """
    lines: dict[tuple[str, str, str], list[tuple[str, str]]] = {}
    for method, name, measured, why in exceptions:
        lines.setdefault((method, measured.split()[0], why), []).append((name, measured))
    return [
        {"method": method, "problems": join_list([n for n, _ in cells], 4), "measured": cells[0][1], "why": why}
        for (method, _, why), cells in lines.items()
    ]


@of("matrix")
def table(frame: pd.DataFrame) -> Table | None:
    """Make the page's table, of exceptions: pairs that contradict a declaration, then orders above the declared ones.

    None if there are none.
    """
    short = sorted(_shortfalls(frame), key=lambda x: bool(x[2]))
    lines = _group([(r["method"], r["problem"], c, why or "NOT EXPLAINED") for r, c, why in short])
    above = sorted(_higher(frame), key=lambda r: r["declared_order"] - r["order"])
    lines += _group(
        [
            (r["method"], r["problem"], f"order {r['order']:.2f}, declared {r['declared_order']}", "more than declared")
            for r in above
        ]
    )
    if not lines:
        return None
    caption = (
        f"The {len(short)} quantities that fall short, then the {len(above)} orders above the declared ones, where "
    )
    caption += "leading terms of the error vanish. The measured value is that of the first problem named."
    return Table(pd.DataFrame(lines[:ROWS]), caption)


@of("matrix")
def _full_table(frame: pd.DataFrame) -> pd.DataFrame:
    """Make the page's longer table: measured order, defects and energy error of every method on five problems."""
    ran = frame[frame["reason"].isna()] if "reason" in frame else frame
    columns = ["method", "problem", "declared_order", "order", "symplecticity", "reversibility", "energy"]
    small = ran[ran["problem"].isin(["henon-heiles", "kepler", "pendulum", "outer-solar-system", "lotka-volterra"])]
    return small.reindex(columns=columns).rename(columns={"declared_order": "declared"})


PAGE = Page(
    id="matrix",
    question="Does every method have, on every problem, the properties that it declares?",
    tables=("matrix",),
    setting=(
        "Order, symplecticity |ω(Mu, Mv) − ω(u, v)| and reversibility |ρΦₕρΦₕ(y) − y| in multiprecision, without round-off.",
        f"Energy and the invariants q·Dp: the largest error over {matrix.RUN} steps in double precision, over the size of H's terms.",
        "Runs start from a state that the published orbit reaches a little later, since at a turning point errors cancel by symmetry.",
        f"Systems of more than {matrix.LARGEST} degrees of freedom are measured in double precision alone; lattices have four points.",
    ),
    verdicts=(declarations, ended, complete),
    answer=answer,
    figures=draw,
    table=table,
    whole=_full_table,
    limits=(
        f"An order is measured over {len(matrix.LADDER)} step sizes, and above or below the declared one if it is {matrix.GATE} off; "
        f"errors up to {matrix.EXACT:g} units of round-off, or {matrix.DOUBTS} times the reference's uncertainty, count as none.",
        f"A defect of at most {matrix.NOTHING:g} counts as none, and an energy error of at most {matrix.UNITS_OF_ROUND_OFF} units "
        "of round-off.",
        f"{matrix.RUN} steps show no slow drift; [long runs](invariants.md) do.",
    ),
    command="pytest benchmarks/experiments/matrix",
)
