"""The report page on advice: does it meet the requested accuracy, and how far from the fastest integrator is it?"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.page.markdown import code, join_list, number
from phasebench.benchmarks.page.page import ROWS, Data, Page, Picture, Table, of
from phasebench.benchmarks.page.verdict import EVERY, FAIL, NONE, Count, Verdict, at_least
from phasebench.integrators.record import ROUND_OFF
from phasebench.integrators.registry import BY_ID

from . import brute, cells
from .asks import FORMULAS, REGISTERED, SEED
from .cells import LIMIT, ROUNDS, TABLE

if TYPE_CHECKING:
    from pathlib import Path

#: Advice counts as near the fastest up to this ratio of times; the share of requests that has to be near.
NEAR, OFTEN = 1.2, 0.9
#: The quantity that energy-preserving methods keep however wrong the orbit is.
ENERGY = "energy"


def true(column: pd.Series) -> pd.Series:
    """Convert a column of booleans, possibly read as text from a CSV file, to booleans."""
    return column.astype(str).str.lower().eq("true")


def _problem_text(problem: str, outside: bool | str) -> str:
    """Format a problem for the table: its name, or its formula as code if it is ``outside`` the registry."""
    return code(problem) if str(outside).lower() == "true" else problem


def _keeps_energy(id: str) -> bool:
    """True if a method keeps the energy to round-off by construction."""
    return id in BY_ID and BY_ID[id].energy == ROUND_OFF


def _with_advice(table: pd.DataFrame) -> pd.DataFrame:
    """Select the requests that were given advice."""
    return table[table["choice"].notna()]


def _with_brute_force(table: pd.DataFrame) -> pd.DataFrame:
    """Select the requests whose advised integration was timed against the fastest one that brute force found."""
    return table[table["ratio"].notna()] if "ratio" in table else table.head(0)


@of(TABLE)
def met(table: pd.DataFrame) -> Verdict | None:
    """Judge whether every advised command meets its accuracy when it is run again; None if there is no advice."""
    advised = _with_advice(table)
    if advised.empty:
        return None
    good = true(advised["met"])
    failed = [f"{r.ask} ({r.problem})" for r in advised[~good].itertuples()]
    return Verdict(
        "The printed command meets the accuracy when another process runs it",
        Count(int(good.sum()), len(advised)),
        EVERY,
        "requests",
        where=join_list(failed, 3) if failed else "",
        otherwise=FAIL,
    )


@of(TABLE)
def near(table: pd.DataFrame) -> Verdict | None:
    """Judge whether the advised integrations take about the time of the fastest that a brute-force search finds.

    None if no request was compared.
    """
    compared = _with_brute_force(table)
    if compared.empty:
        return None
    worst = compared.loc[compared["ratio"].idxmax()]
    return Verdict(
        "The advised integration is about as fast as the fastest that brute force finds",
        Count(int((compared["ratio"] <= NEAR).sum()), len(compared)),
        at_least(OFTEN),
        f"requests within {NEAR} times",
        where=f"{worst['choice']} on {worst['problem']}: {number(worst['ratio'])} times {worst['best']}",
    )


@of(TABLE)
def refusals(table: pd.DataFrame) -> Verdict | None:
    """Judge whether every request that the brute-force search can meet is given advice; None if it met none.

    ``table`` has a row for each request.
    """
    met = table[table["best"].notna()] if "best" in table else table.head(0)
    wrong = met[met["choice"].isna()]
    if met.empty:
        return None
    return Verdict(
        "No request is refused that brute force can meet",
        Count(len(wrong), len(met)),
        NONE,
        "requests",
        where=join_list(list(wrong["ask"].astype(str)), 3) if len(wrong) else "",
    )


def answer(data: Data) -> str | None:
    """Write the page's answer: how often advice meets its accuracy, and how often it is nearly the fastest."""
    table = data(TABLE)
    if table is None or table.empty:
        return None
    good, fast = met(data), near(data)
    text = f"Advice met the requested accuracy in {good.measured.n if good else 0} of {len(table)} random requests"
    if fast is not None:
        share = f"{fast.measured.n} of {fast.measured.of}"
        text += f"; in {share} that were compared it takes at most {NEAR} times the time of the fastest integrator"
    return f"{text}."


@of(TABLE)
def draw(table: pd.DataFrame, folder: Path) -> list[Picture] | None:
    """Draw the time of the advised integration over the fastest's, by requested accuracy; None without ratios."""
    told = _with_brute_force(table)
    if told.empty:
        return None
    with style.settings():
        figure, ((axes,),) = style.panels(1, 1, 3.2)
        for k, (name, part) in enumerate((("registered", ~true(told["outside"])), ("formula", true(told["outside"])))):
            look = style.curve(k) | {"linestyle": "none"}
            axes.semilogx(told[part]["accuracy"], told[part]["ratio"], label=name, **look)
        axes.axhline(NEAR, color=style.GREY, linewidth=0.8, linestyle=":")
        axes.set(xlabel="requested accuracy", ylabel="time over the fastest's", ylim=(0, None))
        axes.invert_xaxis()
        style.legend_above(figure, axes, 2)
    beaten = int((told["ratio high"] < 1).sum()) if "ratio high" in told else 0
    caption = (
        f"Time of the advised integration over that of the fastest that brute force found; dotted: {NEAR}. Below 1 the "
        f"advice is faster than brute force: certainly so (whole interval of the ratio) in {beaten} of {len(told)}."
    )
    return [Picture(style.save(figure, folder, "advice.png"), "advice against the fastest", caption)]


@of(TABLE)
def table(found: pd.DataFrame) -> Table:
    """Make the page's table: requests refused or with a missed accuracy, then those farthest from the fastest.

    How far is the ratio of the advised integration's time to that of the fastest.  ``found`` has a row for each
    request.
    """
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
    shown = shown.assign(problem=[_problem_text(r.problem, r.outside) for r in place.head(ROWS).itertuples()])
    caption = (
        "Requests that were refused or not met, then those with the largest ratio of the time to that of the fastest "
        "(`best`), then others; `conserve`: the structure that was asked for."
    )
    return Table(shown, caption + _by_construction(_with_advice(found)))


def _by_construction(advised: pd.DataFrame) -> str:
    """Write how many requests for an accurate energy are advised a method that keeps the energy at any step size.

    Such a method keeps it even on a wrong orbit.  The text is empty if there is no such request.
    """
    energy = advised[advised["quantity"] == ENERGY] if "quantity" in advised else advised.head(0)
    conserved = sum(map(_keeps_energy, energy["choice"]))
    return (
        f" {conserved} of the {len(energy)} about the energy get a method that keeps it on any orbit."
        if conserved
        else ""
    )


@of(TABLE)
def _full_table(found: pd.DataFrame) -> pd.DataFrame:
    """Return the measured table "advice" unchanged: a row for each request, with its advice, errors and times."""
    return found


PAGE = Page(
    id="advice",
    question="Does the advice meet the requested accuracy, and how close to the fastest is it?",
    tables=(TABLE,),
    setting=(
        f"Requests: {REGISTERED} on registered problems and {FORMULAS} on formulas that are in no registry; problem, "
        f"span, quantity, accuracy and what to conserve are drawn at random (seed {SEED}).",
        "Advice: `phasebench advise` tries integrators in the order of stored measurements, each at the widest step that "
        "meets the accuracy, and times the cheapest in turns.",
        "Met: another process, which knows nothing of the advice, runs the printed command, `phasebench integrate ... "
        "--error`; its error is at most the accuracy.",
        f"Fastest: brute force over every integrator on a fine ladder of steps or tolerances (factors {brute.COARSE} and "
        f"{brute.FINE}), for every {cells.EVERY}rd request; then both run {ROUNDS} rounds in turns.",
    ),
    verdicts=(met, near, refusals),
    answer=answer,
    figures=draw,
    table=table,
    whole=_full_table,
    limits=(
        f"A search gets {LIMIT:g} seconds of the processor; where kernels have to be compiled first it tries fewer.",
        "Errors are deterministic on one machine; on another the last digits round otherwise, and an error close to the "
        "accuracy may exceed it.",
        "The reference is heyoka's, in long double, and heyoka may be advised: an integrator of another kind has to come "
        "near the reference too.",
        f"Brute force leaves out packages that loop over steps in Python, and what costs more than {brute.DEAR:g} times "
        f"the cheapest so far. Its steps are a factor {brute.FINE} apart, so it may miss the best one: its time is no lower "
        "bound.",
    ),
    command="pytest benchmarks/experiments/advice",
)
