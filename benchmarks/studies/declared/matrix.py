"""Every method on every problem: measured and declared order, structure and energy behaviour."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.judge.evidence import GATE, NO_DEFECT
from phasebench.benchmarks.measure import every_problem
from phasebench.benchmarks.measure.conservation import too_few_nodes
from phasebench.benchmarks.page.markdown import join_list
from phasebench.benchmarks.page.page import ROWS, Table, of, once
from phasebench.benchmarks.page.shared import picture
from phasebench.benchmarks.page.study import Claim, Runs, Study, over
from phasebench.benchmarks.page.verdict import EVERY, NONE
from phasebench.benchmarks.problems import PROBLEMS
from phasebench.benchmarks.store.cells import UNCOMPILED, ProblemKey
from phasebench.integrators.record import ROUND_OFF
from phasebench.integrators.registry import BY_ID, METHODS

TABLE = "matrix"
#: An energy error in doubles of at most this many units of round-off counts as round-off.
UNITS = 200
#: Problems of which every run measures what has changed: of each kind one; the others are measured on request.
EVERY_RUN = ("pendulum", "henon-heiles", "perturbed-kepler", "lotka-volterra", "charged-particle", "spherical-pendulum",
             "rigid-body", "kerr")  # fmt: skip
#: Problems whose rows the page has in full.
SMALL = ("henon-heiles", "kepler", "pendulum", "outer-solar-system", "lotka-volterra")
#: Kind of a pair -> its colour.
KINDS = {
    "cannot run": "#ffffff",
    "as declared": "#cfe3f2",
    "order above": style.GREEN,
    "explained": style.ORANGE,
    "contradicted": style.BLACK,
    "stopped": style.GREY,
}


def contradictions(row: dict) -> list[str]:
    """What of a row contradicts the method's declarations; a missing number contradicts nothing."""
    found = []
    order = row.get("order")
    if order is not None and order == order and not order > row["declared_order"] - GATE:
        found.append(f"order {order:.2f}, declared {row['declared_order']}")
    for name, declared in (("symplecticity", row["symplectic"]), ("reversibility", row["symmetric"])):
        defect = row.get(name)
        if declared and defect is not None and not defect <= NO_DEFECT:
            found.append(f"{name} defect {defect:.1e}")
    for name, what in (("energy", "energy"), ("quadratic", "q.D p")):
        error = row.get(name)
        if row[f"{name}_class"] == ROUND_OFF and error is not None and not error <= UNITS * np.finfo(float).eps:
            found.append(f"{what} error {error:.1e} of its terms, declared {ROUND_OFF}")
    return found


def explanation(row: dict, contradiction: str) -> str:
    """The known reason for a contradiction; "" if none is known."""
    if row["method"].endswith("-relaxation") and contradiction.startswith("order"):
        return (
            "over few steps the relaxed time's offset at the end competes with the error; from 8 steps on it does not"
        )
    if row["method"].endswith(("-adaptive", "-field")) and contradiction.startswith("order"):
        inside = row["low"] <= row["declared_order"] <= row["high"]
        return "a row is reached by a shorter step: the declared order is within the interval" if inside else ""
    if not contradiction.startswith("energy"):
        return ""
    if row.get("fallbacks"):
        return "steps without a root, which the run counts as fallbacks, do not keep the energy"
    if too_few_nodes(row["method"], every_problem.build(row["problem"]).system):
        return "HBVM(k, s) keeps a polynomial H of degree at most 2k/s, and this one is none"
    return ""


@of(TABLE)
@once
def pairs(frame: pd.DataFrame) -> pd.DataFrame:
    """The pairs that run, with their ``kind``; the other problems lack what the method requires.

    ``short`` has each contradiction with its explanation, ``open`` those without one, and ``missing`` the measurements
    without a number or a reason.
    """
    out = []
    for r in frame.astype(object).where(frame.notna(), None).to_dict("records"):
        if r.get("reason"):
            continue
        short = tuple((c, explanation(r, c)) for c in contradictions(r))
        left = [c for c, why in short if not why]
        missing = [k for k in every_problem.MEASURED if r.get(k) is None and not r.get(f"{k}_reason")]
        above = r.get("order") is not None and r["order"] > r["declared_order"] + GATE
        stopped = bool(r.get("energy_reason")) and not short
        kind = "contradicted" if left else "explained" if short else "stopped" if stopped else "order above"
        row = {"method": r["method"], "problem": r["problem"], "order": r.get("order"), "declared": r["declared_order"]}
        row |= {"kind": kind if short or stopped or above else "as declared", "short": short, "above": above}
        row |= {"contradicted": bool(left), "open": "; ".join(left), "missing": ", ".join(missing)}
        out.append(row | {"ended": not stopped, "why": r.get("energy_reason")})
    return pd.DataFrame(out)


def tried(frame: pd.DataFrame) -> pd.Series:
    """True for a pair of a method and a problem that has a row, by the pair; of the problems that have some."""
    there = {*zip(frame["method"], frame["problem"], strict=True)}
    begun = [name for name in PROBLEMS if name not in _waiting(frame)]
    return pd.Series({f"{m.id} on {name}": (m.id, name) in there for name in begun for m in METHODS})


def _waiting(frame: pd.DataFrame) -> list[str]:
    """The problems of which nothing is measured yet: a new problem's rows are dear."""
    return [name for name in PROBLEMS if name not in {*frame["problem"]}]


@of(pairs, TABLE)
def _answer(found: pd.DataFrame, frame: pd.DataFrame) -> str:
    n, waiting = Counter(found["kind"]), _waiting(frame)
    short = n["explained"] + n["contradicted"]
    return (
        f"{len(found) - short - n['stopped']} of {len(found)} pairs of a method and a problem are as the method "
        f"declares; {short} fall short ({n['explained']} for a known reason); the runs of {n['stopped']} stopped"
        + (f"; unmeasured: {join_list(waiting, 3)}." if waiting else ".")
    )


@picture(
    TABLE, "matrix", "every method on every problem",
    "Every method (columns, by declared order) on every problem (rows): as declared in order, symplecticity, "
    "reversibility, energy and quadratic invariants; of higher order; short of it for a known reason, or for none; "
    "or with a run that stopped. White: the problem lacks what the method requires.",
)  # fmt: skip
def _draw(frame: pd.DataFrame) -> style.Figure:
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    frame = frame.sort_values(["declared_order"], kind="stable")
    methods, problems = list(dict.fromkeys(frame["method"])), list(dict.fromkeys(frame["problem"]))
    kind = pairs({TABLE: frame}.get).pivot(index="problem", columns="method", values="kind")
    seen = kind.reindex(index=problems, columns=methods).astype(object).fillna("cannot run").map([*KINDS].index)
    orders = frame.drop_duplicates("method")["declared_order"].to_numpy()
    first = np.flatnonzero(np.diff(orders, prepend=-1))
    last = np.append(first[1:], len(orders))
    figure, ((axes,),) = style.panels(1, 1, 3.9)
    axes.pcolormesh(seen.to_numpy(float), cmap=ListedColormap([*KINDS.values()]), vmin=0, vmax=len(KINDS) - 1)
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
    figure.legend(handles=patches, loc="outside upper center", ncols=len(KINDS))
    return figure


@of(pairs)
def _table(found: pd.DataFrame) -> Table | None:
    short = [(r.method, r.problem, c, why or "NOT EXPLAINED") for r in found.itertuples() for c, why in r.short]
    short.sort(key=lambda x: x[3] != "NOT EXPLAINED")
    above = found[found["above"]]
    above = above.iloc[(above["declared"] - above["order"]).argsort(kind="stable")]
    higher = [
        (r.method, r.problem, f"order {r.order:.2f}, declared {r.declared}", "more than declared")
        for r in above.itertuples()
    ]
    lines: dict[tuple[str, str, str], list[tuple[str, str]]] = {}
    for method, name, measured, why in short + higher:
        lines.setdefault((method, measured.split()[0], why), []).append((name, measured))
    shown = [
        {"method": method, "problems": join_list([n for n, _ in of], 4), "measured": of[0][1], "why": why}
        for (method, _, why), of in lines.items()
    ]
    caption = (
        f"The {len(short)} quantities that fall short, then the {len(higher)} orders above the declared ones, where "
        "leading terms of the error vanish. The measured value is that of the first problem named."
    )
    return Table(pd.DataFrame(shown[:ROWS]), caption) if shown else None


@of(TABLE)
def _whole(frame: pd.DataFrame) -> pd.DataFrame:
    rows = frame[frame["reason"].isna() & frame["problem"].isin(SMALL)].rename(columns={"declared_order": "declared"})
    return rows[["method", "problem", "declared", "order", "symplecticity", "reversibility", "energy"]]


STUDY = Study(
    id="matrix",
    place=140,
    question="Does every method have, on every problem, the properties that it declares?",
    answer=_answer,
    setting=(
        "Order, symplecticity |ω(Mu, Mv) − ω(u, v)| and reversibility |ρΦₕρΦₕ(y) − y| in multiprecision, without "
        "round-off.",
        f"Energy and the invariants q·Dp: the largest error over {every_problem.RUN} steps in double precision, over "
        "the size of H's terms.",
        "Runs start from a state that the published orbit reaches a little later, since at a turning point errors "
        "cancel by symmetry.",
        f"Systems of more than {every_problem.LARGEST} degrees of freedom are measured in double precision alone; "
        "lattices have four points.",
    ),
    runs=(
        Runs(
            TABLE, every_problem.row, over(method=tuple(m.id for m in METHODS), problem=tuple(PROBLEMS)),
            needs=lambda method, problem: (
                BY_ID[method], ProblemKey(problem, tuple(every_problem.SMALL.get(problem, {}).items())),
            ),
            where=UNCOMPILED, dear=lambda method, problem: problem not in EVERY_RUN,
        ),
    ),
    claims={
        "declarations": Claim(
            "No pair falls short of what its method declares without a known reason",
            pairs, "contradicted", NONE, unit="pairs", where="{method} on {problem}: {open}", names=3, fault=True,
        ),
        "ended": Claim(
            "Every run came to its end",
            pairs, "ended", EVERY, unit="pairs", where="{method} on {problem} ({why})", names=3,
        ),
        "complete": Claim(
            "Every method was tried on every problem that is measured",
            TABLE, tried, EVERY, unit="pairs", names=3, fault=True, whole=True,
        ),
    },
    checks={
        "accounted": Claim(
            "Every measurement is there or has a reason",
            pairs, "missing == ''", where="{method} on {problem}: {missing}", names=3,
        ),
    },
    figure=_draw,
    shown=_table,
    whole=_whole,
    limits=(
        f"An order is measured over {len(every_problem.LADDER)} step sizes, and above or below the declared one if it "
        f"is {GATE} off; errors up to {every_problem.EXACT:g} units of round-off, or {every_problem.DOUBTS} times the "
        "reference's uncertainty, count as none.",
        f"A defect of at most {NO_DEFECT:g} counts as none, and an energy error of at most {UNITS} units of "
        "round-off.",
        f"{every_problem.RUN} steps show no slow drift; [long runs](invariants.md) do.",
    ),
)  # fmt: skip
