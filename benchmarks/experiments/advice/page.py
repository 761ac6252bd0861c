"""Is the advice what was asked for: met when run again, and how far from the best of everything."""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks.page import style
from phasebench.benchmarks.page.markdown import code, listed, number
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, Verdict, of
from phasebench.integrators.record import ROUND_OFF
from phasebench.integrators.registry import BY_ID

from . import brute
from .asks import FORMULAS, REGISTERED, SEED
from .cells import EVERY, LIMIT, ROUNDS, TABLE

#: The advised is as good as the best where its time is at most so many times it; so often it has to be.
NEAR, OFTEN = 1.2, 0.9
#: The quantity that some methods keep whatever the orbit.
ENERGY = "energy"


def true(column: pd.Series) -> pd.Series:
    """A column of truths, as tables on disk hold them."""
    return column.astype(str).str.lower().eq("true")


def _named(problem: str, outside) -> str:
    """A problem by its name, a formula as code."""
    return code(problem) if str(outside).lower() == "true" else problem


def _keeps_energy(id: str) -> bool:
    """Whether a method keeps the energy to round-off by its construction."""
    return id in BY_ID and BY_ID[id].energy == ROUND_OFF


def _advised(table: pd.DataFrame) -> pd.DataFrame:
    return table[table["choice"].notna()]


@of(TABLE)
def met(table: pd.DataFrame) -> Verdict | None:
    """Whether every advised integration met its accuracy when it was run again."""
    advised = _advised(table)
    if advised.empty:
        return None
    good = true(advised["met"])
    outside = true(advised["outside"])
    text = (
        f"Of {len(table)} random asks {len(advised)} were advised on ({int(outside.sum())} on problems that are in no "
        f"registry), and {int(good.sum())} of these met the accuracy when a process of its own ran the printed command"
    )
    failed = [f"{r.ask} ({_named(r.problem, r.outside)})" for r in advised[~good].itertuples()]
    text += f"; not met: {listed(failed, 3)}." if failed else "."
    energy = advised[advised["quantity"] == ENERGY] if "quantity" in advised else advised.iloc[:0]
    by_itself = energy[energy["choice"].map(_keeps_energy)]
    if len(by_itself):
        text += (
            f" Of the {len(energy)} asks of the energy {len(by_itself)} are met by a method that keeps it by construction, "
            f"whatever the orbit: {listed(list(dict.fromkeys(by_itself['choice'])), 3)}."
        )
    return Verdict(text, bool(good.all()), f"Advice met when run again: {int(good.sum())} of {len(advised)}.")


@of(TABLE)
def near(table: pd.DataFrame) -> Verdict | None:
    """How far the advised are from the best of everything."""
    if "ratio" not in table:
        return None
    told = table[table["ratio"].notna()]
    if told.empty:
        return None
    share, worst = (told["ratio"] <= NEAR).mean(), told.loc[told["ratio"].idxmax()]
    within = f"{int((told['ratio'] <= NEAR).sum())} of {len(told)}"
    beaten = told[told["ratio high"] < 1].sort_values("ratio")
    text = (
        f"Against the cheapest of everything, found by brute force on {len(told)} of them, the advised take at most "
        f"{NEAR} times as long in {within}, in the median {number(told['ratio'].median(), 3)} times; the farthest is "
        f"{worst['choice']} on {_named(worst['problem'], worst['outside'])} at {number(worst['ratio'], 3)} times {worst['best']}."
    )
    if len(beaten):
        names = [
            f"{r['choice']} on {_named(r['problem'], r['outside'])} takes {number(r['ratio'], 2)} of {r['best']}'s time"
            for _, r in beaten.iterrows()
        ]
        text += f" Brute force is itself beaten in {len(beaten)} of {len(told)}, and is no lower bound there: {listed(names, 4)}."
    short = f"At most {NEAR} times the best in {within}; brute force is beaten in {len(beaten)}."
    return Verdict(text, bool(share >= OFTEN), short)


@of(TABLE)
def refused(table: pd.DataFrame) -> Verdict | None:
    """Whether anything was refused that somebody can do."""
    none = table[table["choice"].isna()]
    if none.empty:
        return Verdict("No ask was refused.", True, "No ask was refused.")
    wrong = none[none["best"].notna()] if "best" in none else none.iloc[:0]
    text = f"{len(none)} were refused"
    text += f", and brute force meets {listed(list(wrong['ask'].astype(str)), 3)} of them." if len(wrong) else "."
    return Verdict(text, wrong.empty, f"Refused: {len(none)}.")


@of(TABLE)
def draw(table: pd.DataFrame, folder) -> list[Picture] | None:
    """The advised one's time over the best's, by accuracy."""
    if "ratio" not in table or table["ratio"].notna().sum() == 0:
        return None
    told = table[table["ratio"].notna()]
    with style.settings():
        figure, ((axes,),) = style.panels(1, 1, 3.2)
        for k, (name, part) in enumerate((("registered", ~true(told["outside"])), ("formula", true(told["outside"])))):
            look = style.curve(k) | {"linestyle": "none"}
            axes.semilogx(told[part]["accuracy"], told[part]["ratio"], label=name, **look)
        axes.axhline(NEAR, color=style.GREY, linewidth=0.8, linestyle=":")
        axes.set(xlabel="accuracy that was asked for", ylabel="time over the best's", ylim=(0, None))
        axes.invert_xaxis()
        style.legend_above(figure, axes, 2)
    caption = f"The advised one's time over that of the best of everything, run in turns; dotted: {NEAR}."
    return [Picture(style.save(figure, folder, "advice.png"), "advice against the best", caption)]


@of(TABLE)
def table(found: pd.DataFrame) -> Table:
    """The asks that are not met or refused, then those farthest from the best."""
    ratio = found["ratio"] if "ratio" in found else pd.Series(np.nan, found.index)
    wrong = ~true(found["met"]) if "met" in found else pd.Series(True, found.index)
    place = found.assign(wrong=wrong, far=ratio.fillna(0.0)).sort_values(
        ["wrong", "far"], ascending=False, kind="stable"
    )
    columns = [
        "ask",
        "problem",
        "t_end",
        "quantity",
        "accuracy",
        "conserve",
        "choice",
        "error",
        "seconds",
        "best",
        "ratio",
    ]
    shown = place[[c for c in columns if c in place]].head(ROWS)
    shown = shown.assign(problem=[_named(r.problem, r.outside) for r in place.head(ROWS).itertuples()])
    return Table(shown, "The asks that were refused or not met, then those whose time is farthest from the best's.")


@of(TABLE)
def _whole(found: pd.DataFrame) -> pd.DataFrame:
    return found


PAGE = Page(
    id="advice",
    question="Is what is advised what was asked for?",
    tables=(TABLE,),
    setting=(
        f"Asks: {REGISTERED} on registered problems and {FORMULAS} on formulas that are in no registry, drawn with seed {SEED}: problem, span, quantity, accuracy, what to conserve.",
        "Advice: integrators are tried in the order of stored measurements, each at the widest step that meets the accuracy; the cheapest run in turns.",
        "Met: a process that has seen nothing of the advice runs the printed command, `phasebench integrate ... --error`, and its error is at most the accuracy.",
        f"Best: every integrator on a fine ladder of steps or tolerances (factors {brute.COARSE} and {brute.FINE}), for every {EVERY}rd ask; then both run {ROUNDS} rounds in turns.",
    ),
    verdicts=(met, near, refused),
    figures=draw,
    table=table,
    whole=_whole,
    limits=(
        f"A search was given {LIMIT:g} seconds of the processor; with kernels that have yet to be compiled it tries fewer.",
        "An error is deterministic on one machine: on another the last digits may round otherwise, and an error that is close to the accuracy may leave it.",
        "The reference is heyoka's in long double, heyoka is among the advised: an integrator of another kind has to come near the reference as well.",
        "Brute force leaves out the packages whose loops over steps are Python's, and what costs more than "
        f"{brute.DEAR:g} times the cheapest so far: of rungs a factor {brute.FINE} apart the luckiest may be missed, and an integrator whose first rungs are dear is dropped. "
        "It is beaten where the whole interval of the ratio is below 1.",
        f"NEAR = {NEAR} and OFTEN = {OFTEN} are the goals.",
    ),
    command="pytest benchmarks/experiments/advice",
)
