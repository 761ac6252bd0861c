"""The report's page "start": times to a first result, of cold starts, which compile all code, and of warm ones."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.page.page import ROWS, Data, Page, Picture, Table, of
from phasebench.benchmarks.page.shared import case
from phasebench.benchmarks.page.verdict import Range, Verdict, at_most

from . import start

if TYPE_CHECKING:
    from pathlib import Path

#: Largest seconds wanted for a first integration, and for a warm command.
COLD_WANTED, WARM_WANTED = 5.0, 0.6


@of(start.COLD)
def first(cold: pd.DataFrame) -> Verdict:
    """Judge whether every first integration takes at most `COLD_WANTED` seconds; a failed one counts as infinite.

    ``cold`` has a row for each first integration, which compiles all its code.
    """
    seconds = cold["seconds"].where(cold["status"] == "ok").fillna(np.inf)
    longest = cold.loc[seconds.idxmax()]
    return Verdict(
        "Every first integration arrives in the processor time wanted",
        Range(seconds.min(), seconds.max()),
        at_most(COLD_WANTED),
        "s",
        where=case(longest),
    )


@of(start.WARM)
def warm_start(warm: pd.DataFrame) -> Verdict | None:
    """Judge whether every command takes at most `WARM_WANTED` seconds when all code is compiled.

    ``warm`` has a row for each command, and one for the import of Numba.
    """
    commands = _commands(warm)
    if commands.empty:
        return None
    return Verdict(
        "Every command that finds its code compiled ends in the time wanted",
        Range(commands.min(), commands.max()),
        at_most(WARM_WANTED),
        "s",
        where=commands.idxmax(),
    )


def _commands(warm: pd.DataFrame) -> pd.Series:
    """Return the seconds of each command, timed with all code compiled, by its text; infinite if not measured.

    The row of the import of Numba alone is left out.
    """
    return warm[warm["what"] != start.FLOOR].set_index("what")["seconds"].fillna(np.inf)


@of(start.COLD, start.WARM)
def answer(cold: pd.DataFrame, warm: pd.DataFrame) -> str | None:
    """Return the page's answer, a sentence: the median first integration, and the slowest command with compiled code.

    ``cold`` has a row for each first integration, ``warm`` one for each command and one for the import of Numba; None
    if the commands or the import were not timed.
    """
    commands, floor = _commands(warm), warm.loc[warm["what"] == start.FLOOR, "seconds"]
    if commands.empty or floor.empty:
        return None
    return (
        f"With an empty cache a first integration takes {cold['seconds'].median():.1f} s of processor time (median); "
        f"compiled, a command ends within {commands.max():.2f} s, {floor.iloc[0]:.2f} s of it importing Numba."
    )


@of(start.COLD)
def draw(cold: pd.DataFrame, folder: Path) -> list[Picture]:
    """Draw the seconds of the first integrations with an empty cache, a bar for each; save it in ``folder``."""
    cold = cold.sort_values("seconds", ascending=False)
    y = np.arange(len(cold))
    with style.settings():
        figure, ((axes,),) = style.panels(1, 1, 1.0 + 0.2 * len(cold))
        axes.barh(y, cold["seconds"], height=0.6, color=style.BLUE)
        axes.axvline(COLD_WANTED, color=style.VERMILION, linewidth=1.2)
        axes.set_yticks(y, [f"{r['method']}, d = {r['d']}" for _, r in cold.iterrows()])
        axes.set_ylim(len(cold) - 0.5, -0.5)
        axes.set_xlabel("seconds of the processor in the first integration")
        axes.set_axisbelow(True)
        axes.grid(axis="x", color="0.93", linewidth=0.5)
    caption = f"First integrations with an empty cache; the line: the most that is wanted, {COLD_WANTED:g} s."
    return [Picture(style.save(figure, folder, "start.png"), "first integrations", caption)]


def table(data: Data) -> Table | None:
    """Return the page's table: seconds of the cold starts (which compile), longest first, then of the warm ones.

    None if neither was measured.
    """
    cold, warm = data(start.COLD), data(start.WARM)
    parts = []
    if warm is not None and len(warm):
        part = pd.DataFrame({"start": "warm", "what": warm["what"], "d": "", "seconds": warm["seconds"]})
        part["interval"] = [f"{low:.2f} to {high:.2f}" for low, high in zip(warm["low"], warm["high"], strict=True)]
        parts.append(part)
    if cold is not None and len(cold):
        longest = cold.sort_values("seconds", ascending=False).head(ROWS - sum(map(len, parts)))
        part = pd.DataFrame({"start": "cold", "what": longest["method"] + " on " + longest["problem"]})
        part[["d", "seconds"]] = longest[["d", "seconds"]].astype({"d": object})
        parts.insert(0, part)
    if not parts:
        return None
    caption = (
        "Cold: seconds of the processor, measured once. Warm: seconds by the clock of a whole process, the median "
        "of rounds with its interval."
    )
    return Table(pd.concat(parts, ignore_index=True).head(ROWS).fillna(""), caption)


@of(start.COLD)
def _full_table(cold: pd.DataFrame) -> pd.DataFrame:
    return cold


PAGE = Page(
    id="start",
    question="How long until the first result?",
    tables=(start.COLD, start.WARM),
    setting=(
        f"A run of {start.STEPS} steps, so that nearly all of its time is to get ready.",
        "Cold: a fresh process with an empty cache, from the call of `integrate` on, after imports and the making "
        "of the problem; a method of each kernel, with 4 degrees of freedom where it can, and the slowest on other "
        "systems.",
        f"Warm: whole processes of `phasebench integrate` with a filled cache, {start.ROUNDS} rounds in turns with a "
        "process that imports Numba and does nothing.",
    ),
    verdicts=(first, warm_start),
    answer=answer,
    figures=draw,
    table=table,
    whole=_full_table,
    limits=(
        "Times are the machine's own, and a busy machine lengthens them, those by the clock most.",
        "Methods of one kernel share its compiled code: a second method, or a second problem with the same degrees of "
        "freedom, starts faster than what is shown.",
        "For other degrees of freedom, up to 20, a kernel is compiled anew, and the longer the more there are.",
    ),
    command="pytest benchmarks/experiments/start",
)
